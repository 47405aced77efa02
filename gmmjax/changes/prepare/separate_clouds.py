"""From two clouds as given to two sets of weighted points that can be fitted: checked, filtered, reduced."""

import dataclasses
import logging

import numpy as np
from jaxtyping import ArrayLike, Float

from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.prepare.checking import (
    NAMES,
    SMALLEST_CLOUD,
    CheckedCloud,
    check_comparable,
    check_overlap,
    check_pair,
)
from gmmjax.changes.prepare.resolution import common_voxel_size, usual_spacing
from gmmjax.clouds import PointCloud, first_of_equals, statistical_outliers, voxel_grid
from gmmjax.errors import InputError
from gmmjax.mixtures import WeightedPoints
from gmmjax.pair import Pair, each

logger = logging.getLogger(__name__)

DEFAULT_COMPONENTS = 25
POINTS_PER_COMPONENT = 10


@dataclasses.dataclass(frozen=True)
class PreparedCloud(CheckedCloud):
    """One cloud on its way into a fit of its own.

    Attributes:
        weighted: what is fitted: outliers left out, one point a voxel with its count as mass.
        counted: the same with the outliers, without the scatter.
        outliers: how many points the outlier filter left out.
    """

    weighted: WeightedPoints
    counted: WeightedPoints
    outliers: int


@dataclasses.dataclass(frozen=True)
class PreparedPair:
    """Both clouds, and what was derived from them: the voxels' edge (None: not reduced) and K_max."""

    clouds: Pair[PreparedCloud]
    voxel_size: float | None
    max_components: int


def prepare_pair(clouds: Pair[ArrayLike | PointCloud], config: DetectionConfig) -> PreparedPair:
    """Checks, filters and reduces the two clouds.

    Args:
        clouds: coordinates [n, 3] or a `PointCloud`, in one unit, whichever that is.
        config: crop box, outlier filter, voxels and K_max.

    Raises:
        InputError: a cloud that is not [n, 3], has too few points or only equal ones, or fewer than `max_components`;
            clouds of which one is smaller than the resolution of the other, or that do not overlap.

    Warns:
        InputWarning: extents that differ so much that the units must differ.
    """
    checked = check_pair(clouds, config.crop)
    check_overlap(checked)
    inlying = checked.map(lambda cloud: _inliers(cloud.points, config))
    kept = each(lambda cloud, inliers: cloud.points[inliers], checked, inlying)
    size = config.voxel_size or common_voxel_size(kept, config.max_points)
    both = each(lambda cloud, inliers: _prepared(cloud, inliers, size), checked, inlying)
    fitted = both.map(lambda cloud: cloud.weighted.points)
    check_comparable(kept, fitted, max(size or 0.0, *fitted.map(usual_spacing)))
    pair = PreparedPair(both, size, _max_components(both, config))
    text = "fitted separately: %d and %d points after %d and %d outliers, voxel size %s, at most %d components"
    counts = (*both.map(lambda cloud: len(cloud.weighted.points)), *both.map(lambda cloud: cloud.outliers))
    logger.info(text, *counts, "none" if size is None else f"{size:.4g}", pair.max_components)
    return pair


def _prepared(cloud: CheckedCloud, inliers: np.ndarray, size: float | None) -> PreparedCloud:
    weighted, stray = reduced(cloud.points[inliers], size), cloud.points[~inliers]
    return PreparedCloud(**vars(cloud), weighted=weighted, counted=_with_points(weighted, stray), outliers=len(stray))


def _inliers(points: np.ndarray, config: DetectionConfig) -> np.ndarray:
    if config.outlier_neighbours == 0:
        return np.ones(len(points), bool)
    outliers = statistical_outliers(points, neighbours=config.outlier_neighbours, ratio=config.outlier_ratio)
    # A filter that leaves too little to fit was meant for another kind of cloud.
    enough = first_of_equals(points[~outliers]).sum() >= SMALLEST_CLOUD
    return ~outliers if enough else np.ones(len(points), bool)


def reduced(points: Float[np.ndarray, "n 3"], size: float | None) -> WeightedPoints:
    """The means of the voxels of this edge with counts as mass and the scatter within; None: the points, mass 1 each.

    Raises:
        InputError: a size that is not positive, or too small for the extent of the points.
    """
    if size is None:
        return WeightedPoints(points, np.ones(len(points)))
    grid = voxel_grid(points, size)
    return WeightedPoints(grid.points, grid.mass, grid.scatter(points))


def _with_points(weighted: WeightedPoints, points: np.ndarray) -> WeightedPoints:
    together = np.concatenate([weighted.points, points])
    return WeightedPoints(together, np.concatenate([weighted.mass, np.ones(len(points))]))


def default_components(points: int) -> int:
    """K_max where none is given: 25, or a tenth of the points that are fitted where that is less."""
    return max(1, min(DEFAULT_COMPONENTS, points // POINTS_PER_COMPONENT))


def _max_components(prepared: Pair[PreparedCloud], config: DetectionConfig) -> int:
    smallest, name = min((len(cloud.weighted.mass), name) for name, cloud in zip(NAMES, prepared, strict=True))
    if config.max_components is None:
        return default_components(smallest)
    if config.max_components > smallest:
        raise InputError(
            f"max_components={config.max_components} is more than the {smallest} points (or voxels) of the {name} "
            f"cloud; choose at most {max(1, smallest // POINTS_PER_COMPONENT)}"
        )
    return config.max_components
