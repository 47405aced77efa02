"""Partial transport: moving mass, or leaving it behind at a price."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float, Int

from gmmjax._host import float64_on_host
from gmmjax._typing import Array
from gmmjax.transport.balanced import balanced_transport, pivot_limit
from gmmjax.transport.embedding import check_shapes, checked
from gmmjax.transport.result import TransportResult, TransportStatus, trusted_cost


@float64_on_host
def partial_transport(
    mass_before: Float[Array, " k0"],
    mass_after: Float[Array, " k1"],
    cost: Float[Array, "k0 k1"],
    penalty: Float[Array, ""] | float,
    *,
    max_pivots: int | None = None,
) -> TransportResult:
    r"""Minimise $\sum_{ij} P_{ij} C_{ij} + \lambda \, (\text{mass that stays, on both sides})$ over all partial plans.

    Mass moves only where that costs less than $2 \lambda$, the price of leaving both ends behind. Masses are taken as
    they are and never normalised: taking a component away changes nothing for the others. The problem is solved
    exactly, by giving either side one more component that takes what the other side leaves, at the price of the
    penalty.

    Reference: Caffarelli and McCann, "Free boundaries in optimal transport and Monge-Ampère obstacle problems", Annals
    of Mathematics 171 (2010), section 2; Guittet's extension of the cost matrix by a point at infinity.

    Args:
        mass_before: nonnegative masses, such as counts of points; 0 marks a dead component.
        mass_after: masses in the same unit; the totals may differ.
        cost: ground costs, finite, in any unit.
        penalty: the price of a unit of mass that stays, finite and nonnegative, in the unit of the ground costs.
        max_pivots: give up after this number of pivots of the simplex; by default far more than were ever seen to be
            needed.

    Returns:
        The result as of `exact_transport`, except that `cost` is the minimised objective itself, not divided by any
        flow (mass times ground cost), and that a side without mass is no error. Its derivatives: the plan with respect
        to the costs, the potentials with respect to the masses, all unmatched mass with respect to the penalty.
    """
    check_shapes(mass_before, mass_after, cost)
    limit = pivot_limit(*cost.shape) if max_pivots is None else max_pivots
    given = jnp.asarray(mass_before), jnp.asarray(mass_after), jnp.asarray(cost), jnp.asarray(penalty)
    return _solve(given, jnp.asarray(limit, dtype=jnp.int32))


@eqx.filter_jit
def _solve(given: tuple[Array, Array, Array, Array], max_pivots: Int[Array, ""]) -> TransportResult:
    problem = checked(*given)
    penalty = jnp.where(problem.valid, given[3].astype(problem.cost.dtype), 0)
    before, after = problem.mass_before, problem.mass_after
    extended = jnp.pad(problem.cost, ((0, 1), (0, 1)), constant_values=penalty).at[-1, -1].set(0)
    supply, demand = jnp.append(before, after.sum()), jnp.append(after, before.sum())
    solved = balanced_transport(supply, demand, extended, jnp.full_like(demand, jnp.inf), max_pivots)
    plan, unmatched = solved.plan[:-1, :-1], (solved.plan[:-1, -1], solved.plan[-1, :-1])
    # More mass before also means a larger component for it to stay with, hence the other side's last potential.
    potentials = (
        jnp.minimum(solved.row_potentials[:-1] + solved.column_potentials[-1], penalty),
        jnp.minimum(solved.column_potentials[:-1] + solved.row_potentials[-1], penalty),
    )
    stays = penalty * (unmatched[0].sum() + unmatched[1].sum())
    status = problem.status(solved.optimal, TransportStatus.pivot_limit, needs_mass=False)
    objective = jnp.where(problem.valid, problem.work(plan, potentials) + stays, jnp.inf)
    return TransportResult(
        cost=trusted_cost(objective, status, given),
        plan=plan,
        potentials=potentials,
        unmatched=unmatched,
        result=status,
    )
