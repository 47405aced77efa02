"""Whether two clouds must be aligned before they are compared, and by which rigid motion."""

import dataclasses
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.component_consensus import consensus_displacement
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.local_difference import MEDIAN_TO_DEVIATION, local_difference
from gmmjax.changes.scales import WorkingPair
from gmmjax.changes.settling import moved_points, settled
from gmmjax.mixtures import FitSettings, GaussianMixture, best_fit, fit_restarts

# Points of the after cloud that are laid onto the before cloud.
SAMPLE = 4000
STEPS = 16
# The reach of the residuals: first of all in spacings, in the end in standard deviations of the usual offsets.
FIRST_REACH, LAST_REACH = 6.0, 3.0
# The motion is made when the usual offset falls to this share of what it was.
NEEDED = 0.9
# A point overlaps the other cloud when it is within so many spacings of it.
OVERLAP_SPACINGS = 3.0
# With less overlap after the fine alignment, the clouds are first aligned by their components.
POOR_OVERLAP = 0.6
# With less than this there is too little to compare.
LEAST_OVERLAP = 0.25
# Volumetric clouds: a displacement is real when it is so many standard errors long.
SIGNIFICANT = 4.0
# And when the components that agree on it hold so much of the mass: two alike by chance do not.
LEAST_AGREEMENT = 0.4
COMPONENTS, COMPONENT_POINTS = 25, 6000


@dataclasses.dataclass(frozen=True)
class Registration:
    """How the after cloud was laid onto the before cloud.

    Attributes:
        transform: rigid motion [4, 4] of the after cloud; the identity where none was needed.
        applied: whether there was one.
        residual: usual offset between the clouds' surfaces afterwards, standard deviation (for volumetric clouds, the
            standard error of the displacement).
        residual_before: the same before the motion (for volumetric clouds, the displacement).
        overlap: share of the points that have a counterpart afterwards, in the cloud where it is less.
    """

    transform: Float[np.ndarray, "4 4"]
    applied: bool
    residual: float
    residual_before: float
    overlap: float

    def to_dict(self) -> dict[str, Any]:
        """The record as plain values, for the diagnostics."""
        rotation = Rotation.from_matrix(self.transform[:3, :3])
        return {
            "applied": self.applied,
            "transform": self.transform.tolist(),
            "rotation_degrees": float(np.degrees(rotation.magnitude())),
            "residual": self.residual,
            "residual_before": self.residual_before,
            "overlap": self.overlap,
        }


def register(pair: WorkingPair, config: DetectionConfig) -> Registration:
    """The motion that the pair needs; the identity with "never", or where "auto" finds that none is needed.

    Args:
        pair: both clouds.
        config: whether to align.
    """
    before, after = pair.before.points, pair.after.points
    if config.registration == "never":
        residual, overlap = _fit_of(before, after, pair)
        return Registration(np.eye(4), False, 0.0 if pair.volumetric else residual, residual, overlap)
    if pair.volumetric:
        return _registered_volumes(pair, config)
    return _registered_surfaces(before, after, pair, config)


def _registered_surfaces(
    before: np.ndarray, after: np.ndarray, pair: WorkingPair, config: DetectionConfig
) -> Registration:
    """Closest points along the normals; where that overlaps poorly, from the components' displacement as well."""
    residual_before, overlap_before = _fit_of(before, after, pair)
    source = _sample(after)
    best = _candidate(before, after, source, np.eye(4), pair, residual_before)
    if best[2] < POOR_OVERLAP:
        start = np.eye(4)
        start[:3, 3] = consensus_displacement(*_mixtures(pair, config)).displacement
        coarse = _candidate(before, after, source, start, pair, residual_before)
        # Overlap decides: a few counterparts fit well anywhere.
        best = max(best, coarse, key=lambda candidate: candidate[2])
    transform, residual, overlap = best
    needed = residual < NEEDED * residual_before or overlap > overlap_before + (1 - NEEDED)
    if config.registration == "always" or needed:
        return Registration(transform, True, residual, residual_before, overlap)
    return Registration(np.eye(4), False, residual_before, residual_before, overlap_before)


def _candidate(
    before: np.ndarray, after: np.ndarray, source: np.ndarray, start: np.ndarray, pair: WorkingPair, residual: float
) -> tuple[np.ndarray, float, float]:
    first, last = FIRST_REACH * pair.spacing, LAST_REACH * min(residual, pair.spacing / 2)
    transform = settled(source, before, start, first, last, STEPS)
    return (transform, *_fit_of(before, moved_points(after, transform), pair))


def _registered_volumes(pair: WorkingPair, config: DetectionConfig) -> Registration:
    """The displacement on which most components agree, where it exceeds its standard error."""
    consensus = consensus_displacement(*_mixtures(pair, config))
    if consensus.share < LEAST_AGREEMENT:
        return Registration(np.eye(4), False, 0.0, 0.0, _fit_of(pair.before.points, pair.after.points, pair)[1])
    length = float(np.linalg.norm(consensus.displacement))
    errors = float(np.linalg.norm(consensus.displacement / consensus.standard_error))
    applied = config.registration == "always" or errors > SIGNIFICANT
    transform = np.eye(4)
    if applied:
        transform[:3, 3] = consensus.displacement
    overlap = max(consensus.share, _fit_of(pair.before.points, moved_points(pair.after.points, transform), pair)[1])
    error = float(np.sqrt((consensus.standard_error**2).mean()))
    return Registration(transform, applied, error if applied else 0.0, length, overlap)


def _fit_of(before: np.ndarray, after: np.ndarray, pair: WorkingPair) -> tuple[float, float]:
    """The usual offset where the clouds overlap, and the lesser share that does."""
    trees = cKDTree(before), cKDTree(after)
    offsets, shares = [], []
    for own, other in (trees, trees[::-1]):
        difference = local_difference(_sample(own.data), own, other)
        overlapping = difference.distance < OVERLAP_SPACINGS * np.maximum(pair.spacing, difference.spacing)
        shares.append(float(overlapping.mean()))
        offsets.append(difference.offset[overlapping])
    together = np.concatenate(offsets)
    return MEDIAN_TO_DEVIATION * float(np.median(together)) if len(together) else float("inf"), min(shares)


def _mixtures(pair: WorkingPair, config: DetectionConfig) -> tuple[GaussianMixture, GaussianMixture, float, float]:
    """A mixture of each cloud, with their numbers of points."""
    mixtures = []
    for cloud, key in zip((pair.before, pair.after), jax.random.split(jax.random.key(config.seed), 2), strict=True):
        points = _sample(cloud.points, COMPONENT_POINTS)
        fits = fit_restarts(
            points,
            key=key,
            max_components=max(1, min(COMPONENTS, len(points) // 10)),
            restarts=2,
            settings=FitSettings(patience=0.05),
        )
        mixtures.append(best_fit(fits).mixture)
    return mixtures[0], mixtures[1], float(len(pair.before.points)), float(len(pair.after.points))


def _sample(points: np.ndarray, size: int = SAMPLE) -> np.ndarray:
    """Regularly spaced rows, in an order that knows nothing of the cloud's."""
    if len(points) <= size:
        return points
    return points[np.random.default_rng(0).choice(len(points), size, replace=False)]
