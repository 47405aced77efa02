"""What every transport solver returns."""

import equinox as eqx
from jaxtyping import Float

from gmmjax._typing import Array


class TransportStatus(eqx.Enumeration):
    """How a transport problem ended, one for each problem of a batch."""

    optimal: "TransportStatus" = "The plan is optimal."  # type: ignore[assignment]
    pivot_limit: "TransportStatus" = "The pivot limit was reached before the optimum: allow more pivots."  # type: ignore[assignment]
    not_converged: "TransportStatus" = (
        "The Sinkhorn iteration did not converge: allow more iterations, or take a larger epsilon."  # type: ignore[assignment]
    )
    invalid_input: "TransportStatus" = "A mass, cost or penalty is negative or not finite: correct the input."  # type: ignore[assignment]
    no_mass: "TransportStatus" = "One side has no mass, so nothing can be moved and the distance is undefined."  # type: ignore[assignment]


class TransportResult(eqx.Module):
    """An optimal plan, what it costs, and the prices that prove it.

    Only `cost` carries derivatives. It is infinite where `result` says that it is undefined (`invalid_input`,
    `no_mass`); no field is ever NaN.

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
