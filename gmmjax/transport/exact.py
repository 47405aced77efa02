"""The earth mover's distance between two weighted sets, exactly (thesis 2.2.3)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float, Int

from gmmjax._typing import Array
from gmmjax.transport.balanced import balanced_transport, pivot_limit
from gmmjax.transport.embedding import checked
from gmmjax.transport.result import TransportResult, TransportStatus, trusted_cost


def exact_transport(
    mass_before: Float[Array, " k0"],
    mass_after: Float[Array, " k1"],
    cost: Float[Array, "k0 k1"],
    *,
    start: Float[Array, " k1"] | None = None,
    max_pivots: int | None = None,
) -> TransportResult:
    r"""Solve (2.21): move $\min(\sum_i w_i, \sum_j w'_j)$ of mass at the least work, and report work over flow (2.22).

    Work and plan agree with other exact solvers to rounding in float64; see `dual_simplex` for what ties between costs
    can do in single precision (1.4e-5 of the largest cost). Under any composition of `jax.jit`, `jax.vmap` and
    `jax.grad` the answer is the same, and a `vmap` is solved as one batch.

    Derivatives of `cost` are those of the linear programme: the plan with respect to the costs, the potentials with
    respect to the masses, both through (2.22). Where totals are equal they hold in directions that keep them equal;
    where the optimal plan or potentials are not unique they are one of the subgradients. A component of mass 0 changes
    nothing, whatever its finite costs; its potential tells what its first mass would change.

    Args:
        mass_before: nonnegative masses, in any unit; 0 marks a dead component.
        mass_after: masses in the same unit; the totals may differ.
        cost: ground costs, finite, in any unit.
        start: potentials of the after side to start from, such as those of the same problem before a component was
            removed: they save half of the time and change nothing but the choice among equal optima.
        max_pivots: give up after this number of pivots of the simplex, or of paths of the compiled kernel; by default
            far more than were ever seen to be needed.

    Returns:
        The result, in double precision if any input is. It is `invalid_input` for masses that are negative and for
        anything that is not finite, `no_mass` when either side is empty, and `pivot_limit` when the pivots did not
        suffice: then the plan is the last one tried and must not be used.
    """
    limit = pivot_limit(*cost.shape) if max_pivots is None else max_pivots
    given = jnp.asarray(mass_before), jnp.asarray(mass_after), jnp.asarray(cost)
    return _solve(given, None if start is None else jnp.asarray(start), jnp.asarray(limit, dtype=jnp.int32))


@eqx.filter_jit
def _solve(
    given: tuple[Array, Array, Array], start: Float[Array, " k1"] | None, max_pivots: Int[Array, ""]
) -> TransportResult:
    problem = checked(*given)
    start = jnp.full_like(problem.mass_after, jnp.inf) if start is None else start.astype(problem.cost.dtype)
    balanced = problem.with_dummies()
    # The dummy of a surplus has the potential 0, see `Balanced.centred`. Potentials that are not finite are no start.
    prices = jnp.where(jnp.isfinite(start).all(), jnp.append(start, jnp.zeros((), start.dtype)), jnp.inf)
    solved = balanced_transport(balanced.supply, balanced.demand, balanced.cost, prices, max_pivots)
    potentials = balanced.centred(solved.row_potentials, solved.column_potentials)
    plan = solved.plan[:-1, :-1]
    status = problem.status(solved.optimal, TransportStatus.pivot_limit)
    return TransportResult(
        cost=trusted_cost(problem.per_flow(problem.work(plan, potentials)), status, given),
        plan=plan,
        potentials=potentials,
        unmatched=(
            problem.mass_before - balanced.supply[:-1] + solved.plan[:-1, -1],
            problem.mass_after - balanced.demand[:-1] + solved.plan[-1, :-1],
        ),
        result=status,
    )
