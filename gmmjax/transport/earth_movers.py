"""The earth mover's distance between two mixtures (thesis 2.2.3)."""

import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._typing import Array
from gmmjax.errors import InputError
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.transport.exact import exact_transport
from gmmjax.transport.ground_cost import bures_wasserstein, euclidean
from gmmjax.transport.result import TransportResult
from gmmjax.transport.sinkhorn import sinkhorn


def earth_movers_distance(
    before: GaussianMixture,
    after: GaussianMixture,
    *,
    solver: str = "exact",
    ground_cost: str = "euclidean",
    epsilon: Float[Array, ""] | float | None = None,
) -> TransportResult:
    """Solve (2.21) between the components of two mixtures, with their weights as masses; `cost` is the EMD (2.22).

    Weights need not sum to one, nor to the same on both sides. Dead slots change nothing.

    Args:
        before: the mixture of the first survey.
        after: the mixture of the second survey, in the same unit and dimension.
        solver: "exact" for the linear programme, "sinkhorn" for the entropic one.
        ground_cost: "euclidean" for the distance between means (the thesis's), "bures_wasserstein" for that between
            Gaussians, shape included.
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
    cost = _ground_cost(before, after, ground_cost)
    masses = [jnp.where(mixture.live, mixture.weights, 0) for mixture in (before, after)]
    if solver == "sinkhorn":
        return sinkhorn(masses[0], masses[1], cost, epsilon=epsilon)
    if solver != "exact":
        raise InputError(f'solver is {solver!r}: choose "exact" or "sinkhorn".')
    if epsilon is not None:
        raise InputError('epsilon is of use to solver="sinkhorn" only: leave it out, or choose that solver.')
    return exact_transport(masses[0], masses[1], cost)


def _ground_cost(before: GaussianMixture, after: GaussianMixture, name: str) -> Float[Array, "k0 k1"]:
    means = jnp.asarray(before.means), jnp.asarray(after.means)
    if name == "euclidean":
        return euclidean(*means)
    if name == "bures_wasserstein":
        return bures_wasserstein(means[0], jnp.asarray(before.covariances), means[1], jnp.asarray(after.covariances))
    raise InputError(f'ground_cost is {name!r}: choose "euclidean" or "bures_wasserstein".')
