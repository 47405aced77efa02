"""Shared parts of the solvers: checked input, and unequal totals as a balanced problem (2.21)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gmmjax._typing import Array
from gmmjax.errors import InputError
from gmmjax.transport.result import TransportStatus


class Problem(eqx.Module):
    """Masses and costs as JAX arrays of one precision; all zero where the input is not `valid`."""

    mass_before: Float[Array, " k0"]
    mass_after: Float[Array, " k1"]
    cost: Float[Array, "k0 k1"]
    valid: Bool[Array, ""]

    @property
    def flow(self) -> Float[Array, ""]:
        """The total flow of (2.21): what the lighter side has."""
        return jnp.minimum(self.mass_before.sum(), self.mass_after.sum())

    def per_flow(self, work: Float[Array, ""]) -> Float[Array, ""]:
        """Equation (2.22); infinite where it is undefined."""
        defined = self.flow > 0
        return jnp.where(defined, work / jnp.where(defined, self.flow, 1), jnp.inf)

    def status(
        self, succeeded: Bool[Array, ""], failure: TransportStatus, *, needs_mass: bool = True
    ) -> TransportStatus:
        """Status of a solver that succeeded, or else met `failure`."""
        solved = TransportStatus.where(succeeded, TransportStatus.optimal, failure)
        if needs_mass:
            solved = TransportStatus.where(self.flow > 0, solved, TransportStatus.no_mass)
        return TransportStatus.where(self.valid, solved, TransportStatus.invalid_input)

    def with_dummies(self) -> "Balanced":
        """A row and a column more, reached at no cost, that absorb the surplus of the heavier side.

        No component counts for more than twice the total flow: the rest could not move in any case, and beside it a
        small flow would drown in rounding. A surplus that rounding alone can explain counts as none.
        """
        before, after = (jnp.minimum(mass, 2 * self.flow) for mass in (self.mass_before, self.mass_after))
        surplus = before.sum() - after.sum()
        rounding = 16 * float(np.finfo(self.cost.dtype).eps) * jnp.maximum(before.sum(), after.sum())
        surplus = jnp.where(jnp.abs(surplus) > rounding, surplus, 0)
        return Balanced(
            supply=jnp.append(before, jnp.maximum(-surplus, 0)),
            demand=jnp.append(after, jnp.maximum(surplus, 0)),
            cost=jnp.pad(self.cost, ((0, 1), (0, 1))),
        )

    def work(
        self, plan: Float[Array, "k0 k1"], potentials: tuple[Float[Array, " k0"], Float[Array, " k1"]]
    ) -> Float[Array, ""]:
        r"""$\sum_{ij} f_{ij} d_{ij}$, with its derivatives by the envelope theorem: the plan, and the potentials.

        The optimum of a linear programme changes with its costs as the optimal plan says, and with its masses as the
        optimal potentials say; that plan and potentials change too has no effect of first order. Both are constants
        here, and the terms that carry the masses' derivatives are zero.
        """
        before, after = potentials
        change_before = self.mass_before - jax.lax.stop_gradient(self.mass_before)
        change_after = self.mass_after - jax.lax.stop_gradient(self.mass_after)
        return (plan * self.cost).sum() + (before * change_before).sum() + (after * change_after).sum()


class Balanced(eqx.Module):
    """A problem with a dummy as the last row and the last column; supply and demand have the same total."""

    supply: Float[Array, " rows"]
    demand: Float[Array, " columns"]
    cost: Float[Array, "rows columns"]

    def centred(
        self, rows: Float[Array, " rows"], columns: Float[Array, " columns"]
    ) -> tuple[Float[Array, " k0"], Float[Array, " k1"]]:
        """Fix the constant that may move from one side's potentials to the other's, and drop the dummies.

        With a surplus, the dummy's potential is 0: leaving mass where it is costs nothing. Without one, either side's
        potentials account for half of the work.
        """
        work_of_rows, work_of_columns = (self.supply * rows).sum(), (self.demand * columns).sum()
        total = self.supply.sum() + self.demand.sum()
        even = (work_of_columns - work_of_rows) / jnp.where(total > 0, total, 1)
        shift = jnp.where(self.supply[-1] > 0, -rows[-1], jnp.where(self.demand[-1] > 0, columns[-1], even))
        return rows[:-1] + shift, columns[:-1] - shift


def check_shapes(mass_before: Float[Array, "..."], mass_after: Float[Array, "..."], cost: Float[Array, "..."]) -> None:
    """Raises an `InputError` unless the costs have a row for each mass before and a column for each mass after."""
    shapes = [np.shape(array) for array in (mass_before, mass_after, cost)]
    if len(shapes[0]) != 1 or len(shapes[1]) != 1 or shapes[2] != shapes[0] + shapes[1]:
        raise InputError(
            "cost must be of shape [k0, k1] for mass_before of [k0] and mass_after of [k1], but they have "
            f"{list(shapes[2])}, {list(shapes[0])} and {list(shapes[1])}: give one problem, and map stacks by jax.vmap."
        )


def checked(
    mass_before: Float[Array, " k0"],
    mass_after: Float[Array, " k1"],
    cost: Float[Array, "k0 k1"],
    penalty: Float[Array, ""] | float = 0.0,
) -> Problem:
    """Find out whether masses and penalty are finite and nonnegative and costs finite, and keep what is not out."""
    arrays = [jnp.asarray(array) for array in (mass_before, mass_after, cost)]
    double = any(array.dtype == np.float64 for array in arrays)
    before, after, cost = (array.astype(np.float64 if double else np.float32) for array in arrays)
    price = jnp.asarray(penalty)
    valid = jnp.isfinite(price) & (price >= 0) & jnp.all(jnp.isfinite(cost))
    for mass in (before, after):
        valid &= jnp.isfinite(mass.sum()) & jnp.all(mass >= 0)
    before, after, cost = (jnp.where(valid, array, jnp.zeros((), array.dtype)) for array in (before, after, cost))
    return Problem(before, after, cost, valid)
