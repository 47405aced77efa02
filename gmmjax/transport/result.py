"""Result of every transport solver."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._derivatives import nan_derivatives_unless
from gmmjax._typing import Array


class TransportStatus(eqx.Enumeration):
    """Outcome of a transport problem, one for each problem of a batch."""

    optimal: "TransportStatus" = "The plan is optimal."  # type: ignore[assignment]
    pivot_limit: "TransportStatus" = "The pivot limit was reached before the optimum: allow more pivots."  # type: ignore[assignment]
    not_converged: "TransportStatus" = (
        "The Sinkhorn iteration did not converge: allow more iterations, or take a larger epsilon."  # type: ignore[assignment]
    )
    invalid_input: "TransportStatus" = (
        "A mass, penalty or epsilon is negative, epsilon is 0, or a number is not finite: correct the input."  # type: ignore[assignment]
    )
    no_mass: "TransportStatus" = "One side has no mass, so nothing can be moved and the distance is undefined."  # type: ignore[assignment]


class TransportResult(eqx.Module):
    """An optimal plan, what it costs, and the prices that prove it.

    Only `cost` carries derivatives; they are NaN unless `result` is `optimal`. It is infinite where `result` says that
    it is undefined (`invalid_input`, `no_mass`), and NaN where the solver gave up (`pivot_limit`, `not_converged`); no
    other field is ever NaN.

    Attributes:
        cost: the solver's objective, in the unit of the ground cost (times mass, for the partial problem).
        plan: the mass moved from each component before to each component after.
        potentials: for either side, the derivative of the work with respect to each component's mass.
        unmatched: for either side, the mass that stays where it is.
        result: how the solver ended.
    """

    cost: Float[Array, ""]
    plan: Float[Array, "k0 k1"]
    potentials: tuple[Float[Array, " k0"], Float[Array, " k1"]]
    unmatched: tuple[Float[Array, " k0"], Float[Array, " k1"]]
    result: TransportStatus


def trusted_cost(cost: Float[Array, ""], status: TransportStatus, given: Any) -> Float[Array, ""]:
    """The cost as `TransportResult` has it: NaN where the solver gave up, as are its derivatives wherever it failed.

    Args:
        cost: of the last plan; infinite where it is undefined.
        status: how the solver ended.
        given: what the caller gave, before anything was replaced.
    """
    optimal = status == TransportStatus.optimal
    return nan_derivatives_unless(optimal, jnp.where(optimal | jnp.isinf(cost), cost, jnp.nan), given)
