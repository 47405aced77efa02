"""Entropic transport by Sinkhorn's iteration: a smooth stand-in for the exact solver."""

import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gmmjax._typing import Array
from gmmjax.transport.embedding import Problem, checked
from gmmjax.transport.result import TransportResult, TransportStatus

_DEAD_MASS = 1e-30
"""What stands in for no mass: the solver takes its logarithm."""


def sinkhorn(
    mass_before: Float[Array, " k0"],
    mass_after: Float[Array, " k1"],
    cost: Float[Array, "k0 k1"],
    *,
    epsilon: Float[Array, ""] | float | None = None,
    max_iterations: int = 2000,
) -> TransportResult:
    r"""Solve (2.21) with the entropy of the plan added, $\sum P C + \epsilon \sum P (\log P - 1)$, through ott-jax.

    Unlike the exact plan, this one changes smoothly with masses and costs, and so do its derivatives (reverse mode),
    which are those of the reported cost with all that follows from a changing plan. As epsilon falls the cost falls to
    the exact one, at the price of more iterations.

    Reference: Cuturi, "Sinkhorn distances: lightspeed computation of optimal transport", NIPS 2013.

    Args:
        mass_before: nonnegative masses, in any unit; 0 marks a dead component.
        mass_after: masses in the same unit; the totals may differ.
        cost: ground costs, finite, in any unit.
        epsilon: how much entropy, in the unit of the ground costs; by default 5 % of the live ones' mean.
        max_iterations: where to give up.

    Returns:
        The result as of `exact_transport`; `cost` is $\sum P C$ over the total flow, without the entropy. The
        potentials are those of the entropic problem, 0 for dead components. `not_converged` when the plan's masses are
        still off by more than 1e-6 (float64; 1e-4 in float32) of the total.
    """
    strength = None if epsilon is None else jnp.asarray(epsilon)
    return _solve(checked(mass_before, mass_after, cost), strength, max_iterations)


@eqx.filter_jit
def _solve(problem: Problem, epsilon: Float[Array, ""] | None, max_iterations: int) -> TransportResult:
    balanced = problem.with_dummies()
    supply, demand = balanced.supply, balanced.demand
    live = (supply > 0)[:, None] & (demand > 0)[None]
    total = jnp.where(problem.flow > 0, supply.sum(), 1)
    strength = _default_epsilon(problem, live[:-1, :-1]) if epsilon is None else epsilon.astype(problem.cost.dtype)
    scaling_before, scaling_after, converged = _scalings(
        jnp.where(supply > 0, supply / total, _DEAD_MASS),
        jnp.where(demand > 0, demand / total, _DEAD_MASS),
        jnp.where(live, balanced.cost, 0),
        jax.lax.stop_gradient(strength),
        max_iterations,
    )
    exponent = (scaling_before[:, None] + scaling_after[None] - balanced.cost) / strength
    plan = jnp.where(live, jnp.exp(jnp.where(live, exponent, 0)), 0) * total
    potentials = balanced.centred(jnp.where(supply > 0, scaling_before, 0), jnp.where(demand > 0, scaling_after, 0))
    return TransportResult(
        cost=problem.per_flow((plan[:-1, :-1] * problem.cost).sum()),
        plan=plan[:-1, :-1],
        potentials=(
            jnp.where(supply[:-1] > 0, potentials[0], 0),
            jnp.where(demand[:-1] > 0, potentials[1], 0),
        ),
        unmatched=(
            problem.mass_before - supply[:-1] + plan[:-1, -1],
            problem.mass_after - demand[:-1] + plan[-1, :-1],
        ),
        result=problem.status(converged, TransportStatus.not_converged),
    )


def _default_epsilon(problem: Problem, live: Bool[Array, "k0 k1"]) -> Float[Array, ""]:
    """5 % of the mean cost between live components; padding has no say in it."""
    mean = jnp.where(live, problem.cost, 0).sum() / jnp.maximum(live.sum(), 1).astype(problem.cost.dtype)
    return 0.05 * jnp.where(mean > 0, mean, 1)


def _scalings(
    supply: Float[Array, " rows"],
    demand: Float[Array, " columns"],
    cost: Float[Array, "rows columns"],
    epsilon: Float[Array, ""],
    max_iterations: int,
) -> tuple[Float[Array, " rows"], Float[Array, " columns"], Bool[Array, ""]]:
    """The potentials that ott-jax finds, and whether it converged."""
    geometry, linear_problem, solvers = _import_ott()
    solver = solvers.Sinkhorn(
        threshold=1e-6 if cost.dtype == np.float64 else 1e-4,
        max_iterations=max_iterations,
        # Unrolled: the implicit derivative of the plan raises in float32.
        implicit_diff=None,
    )
    # ott-jax relies on promotions that a caller may have forbidden.
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        solved = solver(linear_problem.LinearProblem(geometry.Geometry(cost, epsilon=epsilon), supply, demand))
        return solved.f, solved.g, jnp.asarray(solved.converged)


def _import_ott() -> tuple[Any, Any, Any]:
    """ott-jax takes seconds to import, and warns that jaxopt, which it imports in turn, has retired."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from ott.geometry import geometry
        from ott.problems.linear import linear_problem
        from ott.solvers.linear import sinkhorn as solver
    return geometry, linear_problem, solver
