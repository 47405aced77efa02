"""The displacement on which most components of two mixtures agree."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport import bures_wasserstein


class ComponentDisplacement(NamedTuple):
    """A displacement of the after cloud.

    Attributes:
        displacement: to be added to the after points, in their unit.
        standard_error: of each coordinate, in the same unit.
        share: of the mass whose components agree, in the mixture where it is less.
    """

    displacement: Float[np.ndarray, " 3"]
    standard_error: Float[np.ndarray, " 3"]
    share: float


def consensus_displacement(
    before: GaussianMixture, after: GaussianMixture, points_before: float, points_after: float
) -> ComponentDisplacement:
    """The displacement supported by most mass among components of the same shape.

    Every pair of components of the same shape proposes one; those that agree with it within the sampling errors of
    their means support it, each component once. Their mean, weighted by its precision, is the result.

    Args:
        before: mixture of the before cloud; NumPy leaves.
        after: mixture of the after cloud.
        points_before: observations in the before cloud.
        points_after: observations in the after cloud.
    """
    shape_distance = _shape_distance(before, after)
    before, after = before.live_part(), after.live_part()
    observations = np.minimum(before.weights[:, None] * points_before, after.weights[None] * points_after)
    # Of one shape: a fifth of its size apart, and what so few observations leave open.
    alike = (0.2 + 2 / np.sqrt(observations)) * _size(before)[:, None]
    same_shape = shape_distance < alike
    displacements = before.means[:, None] - after.means[None]
    errors = _mean_errors(before, points_before)[:, None] + _mean_errors(after, points_after)[None]
    weights = np.minimum(before.weights[:, None], after.weights[None]) * same_shape
    best, support = None, 0.0
    for i, j in np.argwhere(same_shape):
        agreeing = _agreeing(displacements, errors + errors[i, j], displacements[i, j], weights)
        if weights[agreeing].sum() > support:
            best, support = agreeing, float(weights[agreeing].sum())
    if best is None:
        return ComponentDisplacement(np.zeros(3), np.full(3, np.inf), 0.0)
    precision = 1 / errors[best]
    displacement = (precision * displacements[best]).sum(axis=0) / precision.sum(axis=0)
    return ComponentDisplacement(displacement, precision.sum(axis=0) ** -0.5, support)


def _agreeing(
    displacements: np.ndarray,
    errors: np.ndarray,
    proposed: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """The pairs within four standard errors of the proposed displacement; for each component the nearest."""
    deviation = ((displacements - proposed) ** 2 / errors).sum(axis=2)
    deviation = np.where((weights > 0) & (deviation < 4**2), deviation, np.inf)
    nearest = (deviation == deviation.min(axis=0)) & (deviation == deviation.min(axis=1)[:, None])
    return np.asarray(nearest & np.isfinite(deviation))


def _mean_errors(mixture: GaussianMixture, points: float) -> Float[np.ndarray, "k 3"]:
    """Variance of each component's estimated mean, for each coordinate."""
    variances = np.diagonal(mixture.covariances, axis1=1, axis2=2)
    return np.asarray(variances / (mixture.weights * points)[:, None])


def _size(mixture: GaussianMixture) -> Float[np.ndarray, " k"]:
    return np.sqrt(np.trace(mixture.covariances, axis1=1, axis2=2) / 3)


def _shape_distance(before: GaussianMixture, after: GaussianMixture) -> Float[np.ndarray, "k0 k1"]:
    """Distances between the shapes of live components; computed for all slots: one program serves all mixtures."""
    with jax.enable_x64(True):
        distances = np.asarray(_distances_of_slots(before.covariances, after.covariances))
    return distances[np.ix_(before.live, after.live)]


@lru_jit
def _distances_of_slots(before: Float[Array, "k0 3 3"], after: Float[Array, "k1 3 3"]) -> Float[Array, "k0 k1"]:
    return bures_wasserstein(jnp.zeros_like(before[:, 0]), before, jnp.zeros_like(after[:, 0]), after)
