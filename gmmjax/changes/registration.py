"""Whether two clouds must be aligned before they are compared, and by which rigid motion."""

import dataclasses
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.changes.component_consensus import consensus_displacement
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.local_difference import MEDIAN_TO_DEVIATION, local_difference
from gmmjax.changes.scales import WorkingPair
from gmmjax.changes.settling import settled
from gmmjax.clouds.local_surface import LocalSurface
from gmmjax.mixtures import FitSettings, GaussianMixture, best_fit, fit_restarts

# Points of the after cloud that are laid onto the before cloud.
SAMPLE = 3000
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


def register(pair: WorkingPair, before: LocalSurface, after: LocalSurface, config: DetectionConfig) -> Registration:
    """The motion that the pair needs; the identity with "never", or where "auto" finds that none is needed.

    Args:
        pair: both clouds.
        before: the surface of the before cloud.
        after: that of the after cloud.
        config: whether to align.
    """
    if config.registration == "never":
        residual, overlap = _fit_of(before, after, pair)
        return Registration(np.eye(4), False, 0.0 if pair.volumetric else residual, residual, overlap)
    if pair.volumetric:
        return _registered_volumes(pair, before, after, config)
    return _registered_surfaces(before, after, pair, config)


def _registered_surfaces(
    before: LocalSurface, after: LocalSurface, pair: WorkingPair, config: DetectionConfig
) -> Registration:
    """Closest points along the normals; where that overlaps poorly, from the components' displacement as well."""
    residual_before, overlap_before = _fit_of(before, after, pair)
    best = _candidate(before, after, np.eye(4), pair, residual_before)
    if best[2] < POOR_OVERLAP:
        start = np.eye(4)
        start[:3, 3] = consensus_displacement(*_mixtures(pair, config)).displacement
        coarse = _candidate(before, after, start, pair, residual_before)
        # Overlap decides: a few counterparts fit well anywhere.
        best = max(best, coarse, key=lambda candidate: candidate[2])
    transform, residual, overlap = best
    needed = residual < NEEDED * residual_before or overlap > overlap_before + (1 - NEEDED)
    if config.registration == "always" or needed:
        return Registration(transform, True, residual, residual_before, overlap)
    return Registration(np.eye(4), False, residual_before, residual_before, overlap_before)


def _candidate(
    before: LocalSurface, after: LocalSurface, start: np.ndarray, pair: WorkingPair, residual: float
) -> tuple[np.ndarray, float, float]:
    first, last = FIRST_REACH * pair.spacing, LAST_REACH * min(residual, pair.spacing / 2)
    transform = settled(after.means(_sample(len(after))), before, start, first, last, STEPS)
    return (transform, *_fit_of(before, after.moved(transform), pair))


def _registered_volumes(
    pair: WorkingPair, before: LocalSurface, after: LocalSurface, config: DetectionConfig
) -> Registration:
    """The displacement on which most components agree, where it exceeds its standard error."""
    consensus = consensus_displacement(*_mixtures(pair, config))
    if consensus.share < LEAST_AGREEMENT:
        return Registration(np.eye(4), False, 0.0, 0.0, _fit_of(before, after, pair)[1])
    length = float(np.linalg.norm(consensus.displacement))
    errors = float(np.linalg.norm(consensus.displacement / consensus.standard_error))
    applied = config.registration == "always" or errors > SIGNIFICANT
    transform = np.eye(4)
    if applied:
        transform[:3, 3] = consensus.displacement
    overlap = max(consensus.share, _fit_of(before, after.moved(transform), pair)[1])
    error = float(np.sqrt((consensus.standard_error**2).mean()))
    return Registration(transform, applied, error if applied else 0.0, length, overlap)


def _fit_of(before: LocalSurface, after: LocalSurface, pair: WorkingPair) -> tuple[float, float]:
    """The usual offset where the clouds overlap, and the lesser share that does."""
    offsets, shares = [], []
    for own, other in ((before, after), (after, before)):
        difference = local_difference(own, other, _sample(len(own)))
        overlapping = difference.distance < OVERLAP_SPACINGS * np.maximum(pair.spacing, difference.spacing)
        shares.append(float(overlapping.mean()))
        offsets.append(difference.offset[overlapping])
    together = np.concatenate(offsets)
    return MEDIAN_TO_DEVIATION * float(np.median(together)) if len(together) else float("inf"), min(shares)


def _mixtures(pair: WorkingPair, config: DetectionConfig) -> tuple[GaussianMixture, GaussianMixture, float, float]:
    """A mixture of each cloud, with their numbers of points."""
    mixtures = []
    for cloud, key in zip((pair.before, pair.after), jax.random.split(jax.random.key(config.seed), 2), strict=True):
        points = cloud.points[_sample(len(cloud.points), COMPONENT_POINTS)]
        fits = fit_restarts(
            points,
            key=key,
            max_components=max(1, min(COMPONENTS, len(points) // 10)),
            restarts=2,
            settings=FitSettings(patience=0.05),
        )
        mixtures.append(best_fit(fits).mixture)
    return mixtures[0], mixtures[1], float(len(pair.before.points)), float(len(pair.after.points))


def _sample(count: int, size: int = SAMPLE) -> np.ndarray:
    """The indices of so many points at random, the same each time; all where there are no more."""
    return np.arange(count) if count <= size else np.random.default_rng(0).choice(count, size, replace=False)
