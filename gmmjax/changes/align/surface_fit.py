"""The fit of two scanned surfaces by a rigid transform."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int

from gmmjax.geometry import MEAN_NEIGHBOURS, MEDIAN_TO_DEVIATION, PLANE_NEIGHBOURS, LocalSurface, rotated, transformed
from gmmjax.pair import Pair

# A point overlaps the other cloud within this many spacings of it.
OVERLAP_SPACINGS = 3.0


class SurfaceFit(NamedTuple):
    """The fit of two surfaces by a transform.

    Attributes:
        score: mean over the points of one, where the other surface passes through in the same direction, to 0; of the
            cloud where it is less.
        overlap: fraction of the points with a counterpart, likewise.
        residual: robust standard deviation of the offsets of these points, along the normal.
        noise: median of what the scatter about the local planes makes of it.
        contradicted: fraction of the points that the other cloud covers without a counterpart; of the cloud where it is
            more.
        significance: offset of each point of either cloud's sample, in standard deviations; infinite without a
            counterpart.
    """

    score: float
    overlap: float
    residual: float
    noise: float
    contradicted: float = 0.0
    significance: Float[np.ndarray, " n"] = np.zeros(0)

    @property
    def consistency(self) -> float:
        """The score among the points in places that both surveys cover."""
        return self.score / max(self.overlap + self.contradicted, np.finfo(np.float64).tiny)

    @property
    def agreement(self) -> float:
        """Fraction of the points with a counterpart whose offset is noise: three standard deviations, at most."""
        paired = np.isfinite(self.significance)
        return float((self.significance <= 3).sum() / max(paired.sum(), 1))

    def contradiction(self, other: "SurfaceFit") -> float:
        """Points that agree by the other transform and not by this one, by those that agree by this one only.

        0: all that fits by the other one fits by this one as well; 1: either explains as much as the other. What agrees
        by one is within the level of detection at 95 %, and what does not is beyond three standard deviations.
        """
        lost = (other.significance <= 1.96) & (self.significance > 3)
        gained = (other.significance > 3) & (self.significance <= 1.96)
        return float((lost.sum() + 0.5) / (gained.sum() + 0.5))


class _OneSidedFit(NamedTuple):
    """`SurfaceFit` by the points of one cloud; offset and noise of those that overlap, significance of all."""

    score: float
    overlap: float
    contradicted: float
    offsets: Float[np.ndarray, " m"]
    noise: Float[np.ndarray, " m"]
    significance: Float[np.ndarray, " n"]


def surface_fit(
    surfaces: Pair[LocalSurface],
    transform: Float64[np.ndarray, "4 4"],
    spacing: float,
    points: int = 3_000,
) -> SurfaceFit:
    """Measure how two surfaces fit by a transform of the after cloud, judged from both of them.

    Args:
        surfaces: of both clouds.
        transform: rigid transform [4, 4].
        spacing: of the points, in the sparser cloud.
        points: of either cloud that it is judged by, at most.
    """
    sides = (
        _one_sided_fit(surfaces.after, surfaces.before, transform, spacing, points),
        _one_sided_fit(surfaces.before, surfaces.after, np.linalg.inv(transform), spacing, points),
    )
    score, overlap = min(side.score for side in sides), min(side.overlap for side in sides)
    offsets = np.concatenate([side.offsets for side in sides])
    contradicted = max(side.contradicted for side in sides)
    significance = np.concatenate([side.significance for side in sides])
    if not len(offsets):
        return SurfaceFit(score, overlap, float("inf"), float("inf"), contradicted, significance)
    residual = MEDIAN_TO_DEVIATION * float(np.median(offsets))
    noise = float(np.median(np.concatenate([side.noise for side in sides])))
    return SurfaceFit(score, overlap, residual, noise, contradicted, significance)


def _one_sided_fit(
    own: LocalSurface, other: LocalSurface, transform: np.ndarray, spacing: float, points: int
) -> _OneSidedFit:
    chosen = random_sample(len(own), points)
    means = transformed(own.means(chosen), transform)
    there = other.nearest(means)
    normals = other.normals[there]
    offsets = np.abs(((means - other.centres[there]) * normals).sum(axis=1))
    distances = np.linalg.norm(means - other.points[there], axis=1)
    cosines = np.abs((rotated(own.normals[chosen], transform) * normals).sum(axis=1))
    spacings = distances / np.maximum(spacing, other.spacing(there))
    overlapping = spacings < OVERLAP_SPACINGS
    # So near the other survey covers the place, and saw no counterpart.
    contradicts = ~overlapping & (spacings < 2 * OVERLAP_SPACINGS)
    # Geman and McClure's weight, at half a spacing a quarter; cosines' fourth power falls to a half at 33 degrees.
    scores = overlapping * cosines**4 / (1 + (2 * offsets / spacing) ** 2) ** 2
    noise = np.sqrt(own.variances[chosen, 0] / MEAN_NEIGHBOURS + other.variances[there, 0] / PLANE_NEIGHBOURS)
    # Point-to-plane ICP on points without noise ends some thousandths of a spacing off.
    significance = np.where(overlapping, offsets / np.maximum(noise, 0.003 * spacing), np.inf)
    score, overlap, contradicted = (float(own.mean()) for own in (scores, overlapping, contradicts))
    return _OneSidedFit(score, overlap, contradicted, offsets[overlapping], noise[overlapping], significance)


def random_sample(count: int, size: int) -> Int[np.ndarray, " m"]:
    """The indices of at most this number of points, at random, the same each time."""
    return np.arange(count) if count <= size else np.random.default_rng(0).choice(count, size, replace=False)
