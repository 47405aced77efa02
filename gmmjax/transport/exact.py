"""The earth mover's distance between two weighted sets, exactly (thesis 2.2.3)."""

from types import ModuleType

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from gmmjax import native
from gmmjax._host import float64_on_host, is_numpy, is_traced
from gmmjax._typing import Array
from gmmjax.errors import InputError
from gmmjax.transport.balanced import balanced_transport, pivot_limit
from gmmjax.transport.embedding import check_shapes, checked
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

    NumPy arrays are solved in float64 whatever JAX's setting, by the compiled kernel without a JAX program around it,
    and the result is NumPy's; JAX arrays are solved in double precision if any of them is.

    Args:
        mass_before: nonnegative masses, in any unit; 0 marks a dead component.
        mass_after: masses in the same unit; the totals may differ.
        cost: ground costs, finite, in any unit.
        start: potentials of the after side to start from, such as those of the same problem before a component was
            removed: they save half of the time and change nothing but the choice among equal optima.
        max_pivots: give up after this number of pivots of the simplex, or of paths of the compiled kernel; by default
            far more than were ever seen to be needed.

    Returns:
        The result. It is `invalid_input` for masses that are negative and for
        anything that is not finite, `no_mass` when either side is empty, and `pivot_limit` when the pivots did not
        suffice: then the plan is the last one tried and must not be used.

    Raises:
        InputError: for shapes that do not fit together.
    """
    check_shapes(mass_before, mass_after, cost)
    if start is not None and np.shape(start) != np.shape(mass_after):
        raise InputError(f"start must have a potential for each of {len(mass_after)} masses after: {np.shape(start)}")
    limit = pivot_limit(*cost.shape) if max_pivots is None else max_pivots
    problem = mass_before, mass_after, cost, start, limit
    kernels = native.host_kernels()
    if kernels is not None and is_numpy(problem) and not is_traced(problem):
        return _solve_on_host(kernels, *problem)
    return _solve_in_jax(*problem)


def _solve_on_host(
    kernels: ModuleType, mass_before: Array, mass_after: Array, cost: Array, start: Array | None, max_pivots: int
) -> TransportResult:
    """As `_solve`, without the dispatch of a JAX program, which takes longer than a small problem does."""
    before, after, cost = (np.ascontiguousarray(own, np.float64) for own in (mass_before, mass_after, cost))
    given = None if start is None else np.ascontiguousarray(start, np.float64)
    plan, of_before, of_after = np.empty(cost.shape), np.empty((2, len(before))), np.empty((2, len(after)))
    price, status = kernels.exact_transport(before, after, cost, given, max_pivots, plan, of_before, of_after)
    return TransportResult(
        cost=np.array(price),
        plan=plan,
        potentials=(of_before[0], of_after[0]),
        unmatched=(of_before[1], of_after[1]),
        result=getattr(TransportStatus, status),
    )


@float64_on_host
def _solve_in_jax(
    mass_before: Array, mass_after: Array, cost: Array, start: Array | None, max_pivots: int
) -> TransportResult:
    given = jnp.asarray(mass_before), jnp.asarray(mass_after), jnp.asarray(cost)
    solved: TransportResult = _solve(
        given, None if start is None else jnp.asarray(start), jnp.asarray(max_pivots, dtype=jnp.int32)
    )
    return solved


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
