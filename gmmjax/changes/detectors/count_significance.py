"""Test by counts alone that one cloud has more points in a Gaussian's place than the other.

Mixtures of one cloud from other random starts, or of two samples of one surface, differ in how they cut it into
Gaussians. Optimal transport compares the Gaussians and finds differences where the points are the same.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from gmmjax.mixtures import GaussianMixture, WeightedPoints

# Fractions of a Gaussian's mass inside the ellipsoids that points are counted in: the wide one counts most of the
# points, the narrow one sees small displacements.
SHARES = (0.5, 0.9)
# Standard deviations of the counts, at least, by which a Gaussian's points must exceed those of the other cloud: above
# what two samples of one scene differ by.
SIGNIFICANCE = 4.0


def count_significance(
    mixtures: GaussianMixture, own: WeightedPoints, other: WeightedPoints
) -> Float[np.ndarray, "r k"]:
    """The significance of the excess of the points in each Gaussian's place over those that the other cloud has there.

    The standard deviation is that of both Poisson counts. The other cloud's counts are scaled by the ratio of the
    clouds' densities, which is the median over the Gaussians: most of a scene is unchanged.

    Args:
        mixtures: of the own cloud, with a leading axis of r restarts; NumPy leaves.
        own: all points of that cloud, outliers too: what is stray in the one cloud need not be so in the other.
        other: all points of the other cloud.

    Returns:
        The greatest excess of the ellipsoids, for each restart and slot; 0 in dead slots.
    """
    counts, there = (_counts(mixtures, points) for points in (own, other))
    density = np.array([_median_ratio(*of_restart) for of_restart in zip(there[0], counts[0], strict=True)])
    expected = there / density[None, :, None]
    variance = counts + expected / density[None, :, None]
    excess = (counts - expected) / np.sqrt(np.maximum(variance, 1.0))
    return np.asarray(np.where(mixtures.live, excess.max(axis=0), 0.0))


def _counts(mixtures: GaussianMixture, points: WeightedPoints) -> Float[np.ndarray, "s r k"]:
    """The points within each ellipsoid of each Gaussian."""
    # Quantiles of the chi-squared distribution; scipy.stats has them too, and takes a tenth of the import time.
    limits = 2 * gammaincinv(mixtures.means.shape[-1] / 2, SHARES)
    counts = np.zeros((len(limits), *mixtures.live.shape))
    for restart, slot in np.argwhere(mixtures.live):
        factor = np.linalg.cholesky(mixtures.covariances[restart, slot])
        standardised = np.linalg.solve(factor, (points.points - mixtures.means[restart, slot]).T)
        squared = (standardised**2).sum(axis=0)
        counts[:, restart, slot] = [points.mass[squared <= limit].sum() for limit in limits]
    return counts


def _median_ratio(there: Float[np.ndarray, " k"], here: Float[np.ndarray, " k"]) -> float:
    """The median of the ratios of counts, weighted by the lesser count; 1 where no Gaussian has points of both."""
    weights = np.minimum(there, here)
    if not weights.any():
        return 1.0
    both = weights > 0
    ratios, weights = there[both] / here[both], weights[both]
    order = np.argsort(ratios)
    cumulative = np.cumsum(weights[order])
    return float(ratios[order][np.searchsorted(cumulative, cumulative[-1] / 2)])
