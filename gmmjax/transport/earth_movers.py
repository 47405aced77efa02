"""The earth mover's distance between two mixtures (thesis 2.2.3)."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.distance import cdist

from gmmjax._host import float64_on_host, is_numpy, is_traced
from gmmjax._typing import Scalar
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport.exact import exact_transport
from gmmjax.transport.ground_cost import GROUND_COSTS, GroundCost, distance_of_means
from gmmjax.transport.result import TransportResult
from gmmjax.transport.sinkhorn import sinkhorn


def earth_movers_distance(
    before: GaussianMixture,
    after: GaussianMixture,
    *,
    solver: str = "exact",
    ground_cost: str | GroundCost = "euclidean",
    epsilon: Scalar | None = None,
) -> TransportResult:
    """Solve (2.21) between the components of two mixtures, with their weights as masses; `cost` is the EMD (2.22).

    Weights need not sum to one, nor to the same on both sides. Dead slots change nothing. Mixtures of NumPy arrays, as
    `fit_mixture` returns them, are compared in float64 whatever JAX's setting, and the result is NumPy's; JAX arrays
    are compared in their own precision, under any transformation.

    Args:
        before: the mixture of the first survey.
        after: the mixture of the second survey, in the same unit and dimension.
        solver: "exact" for the linear programme, "sinkhorn" for the entropic one.
        ground_cost: "euclidean" for the distance between means (the thesis's), "bures_wasserstein" for that between
            Gaussians, shape included; or a function of the two mixtures.
        epsilon: entropy of the Sinkhorn solver, in the unit of the means; by default 5 % of the mean ground cost.

    Returns:
        The result; cost and potentials are in the unit of the means, plan and unmatched mass in that of the weights.

    Raises:
        InputError: for an unknown solver or ground cost, for an epsilon that the exact solver cannot use, and for
            mixtures of different dimensions.
    """
    if before.dimension != after.dimension:
        raise InputError(
            f"before has dimension {before.dimension} and after has dimension {after.dimension}: "
            "give two mixtures of the same dimension."
        )
    check_choice("solver", solver, ("exact", "sinkhorn"))
    if isinstance(ground_cost, str):
        check_choice("ground_cost", ground_cost, tuple(GROUND_COSTS))
        ground_cost = GROUND_COSTS[ground_cost]
    if epsilon is not None and solver != "sinkhorn":
        raise InputError('epsilon is of use to solver="sinkhorn" only: leave it out, or choose that solver.')
    if solver == "exact" and ground_cost is distance_of_means and is_numpy(before, after) and not is_traced():
        supply, demand = (np.where(mixture.live, mixture.weights, 0) for mixture in (before, after))
        return exact_transport(supply, demand, cdist(before.means, after.means))
    return _earth_movers_distance(before, after, solver, ground_cost, epsilon)


@float64_on_host
def _earth_movers_distance(
    before: GaussianMixture, after: GaussianMixture, solver: str, ground_cost: GroundCost, epsilon: Scalar | None
) -> TransportResult:
    cost = ground_cost(before, after)
    masses = [jnp.where(mixture.live, mixture.weights, 0) for mixture in (before, after)]
    if solver == "sinkhorn":
        return sinkhorn(masses[0], masses[1], cost, epsilon=epsilon)
    return exact_transport(masses[0], masses[1], cost)
