"""From two clouds as given to two sets of weighted points that can be fitted: checked, filtered, reduced."""

import dataclasses
import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Bool, Float

from gmmjax.changes.config import DetectionConfig
from gmmjax.clouds import PointCloud, crop_box, statistical_outliers, voxel_grid, voxel_size_for
from gmmjax.errors import InputError, InputWarning
from gmmjax.mixtures import WeightedPoints, parameters_per_component

SMALLEST_CLOUD = parameters_per_component(3) + 1
DEFAULT_COMPONENTS = 25
POINTS_PER_COMPONENT = 10
# Two clouds of one scene differ in extent by what one of them missed, hardly by more than this.
SUSPICIOUS_SCALE = 100.0


@dataclasses.dataclass(frozen=True)
class PreparedCloud:
    """One cloud on its way into the fit.

    Attributes:
        points: all finite points inside the crop box, in the caller's order and unit [n, 3].
        used: which rows of the caller's cloud these are.
        cropped: how many finite points lie outside the crop box.
        weighted: what is fitted: outliers left out, one point a voxel with its count as mass.
        outliers: how many points the outlier filter left out.
    """

    points: Float[np.ndarray, "n 3"]
    used: Bool[np.ndarray, " rows"]
    cropped: int
    weighted: WeightedPoints
    outliers: int


@dataclasses.dataclass(frozen=True)
class PreparedPair:
    """Both clouds, and what was derived from them: the voxels' edge (None: not reduced) and K_max."""

    before: PreparedCloud
    after: PreparedCloud
    voxel_size: float | None
    max_components: int


def prepare_pair(
    before: ArrayLike | PointCloud, after: ArrayLike | PointCloud, config: DetectionConfig
) -> PreparedPair:
    """Checks, filters and reduces the two clouds.

    Args:
        before: coordinates [n0, 3] or a `PointCloud`, in any unit.
        after: coordinates [n1, 3] or a `PointCloud`, in the same unit.
        config: crop box, outlier filter, voxels and K_max.

    Raises:
        InputError: a cloud that is not [n, 3], has too few points or only equal ones, or fewer than `max_components`.

    Warns:
        InputWarning: extents that do not overlap, or that differ so much that the units must differ.
    """
    checked = {name: _checked(name, cloud, config) for name, cloud in (("before", before), ("after", after))}
    _warn_about_extents(checked["before"].points, checked["after"].points)
    kept = {name: cloud.points[_inliers(cloud.points, config)] for name, cloud in checked.items()}
    size = config.voxel_size or _voxel_size(list(kept.values()), config)
    prepared = {
        name: PreparedCloud(
            **cloud._asdict(), weighted=reduced(kept[name], size), outliers=len(cloud.points) - len(kept[name])
        )
        for name, cloud in checked.items()
    }
    return PreparedPair(**prepared, voxel_size=size, max_components=_max_components(prepared, config))


class _Checked(NamedTuple):
    """The first fields of `PreparedCloud`."""

    points: np.ndarray
    used: np.ndarray
    cropped: int


def _checked(name: str, cloud: ArrayLike | PointCloud, config: DetectionConfig) -> _Checked:
    rows = cloud.points if isinstance(cloud, PointCloud) else _rows(name, cloud)
    label = f"{name} ({cloud.source})" if isinstance(cloud, PointCloud) and cloud.source else name
    finite = np.asarray(np.isfinite(rows).all(axis=1))
    used = finite if config.crop is None else finite & _inside(rows, config.crop)
    points = rows[used]
    if len(points) < SMALLEST_CLOUD:
        raise InputError(
            f"{label}: has {len(points)} point{'s' * (len(points) != 1)} with finite coordinates"
            f"{'' if config.crop is None else ' inside the crop box'}; "
            f"at least {SMALLEST_CLOUD} are needed to fit a Gaussian"
        )
    if np.ptp(points, axis=0).max() <= 8 * np.finfo(np.float64).eps * np.abs(points).max():
        raise InputError(f"{label}: all {len(points)} points are equal; there is nothing to compare")
    return _Checked(points, used, int(finite.sum() - used.sum()))


def _rows(name: str, array: ArrayLike) -> np.ndarray:
    try:
        rows = np.asarray(array, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: must be an array of numbers [n, 3] or a PointCloud ({error})") from error
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"{name}: must have the shape [n, 3], not {list(rows.shape)}")
    return rows


def _inside(rows: np.ndarray, crop: tuple[float, ...]) -> np.ndarray:
    """Rows that are not finite count as outside."""
    return crop_box(np.where(np.isfinite(rows), rows, np.finfo(np.float64).max), np.array(crop[:3]), np.array(crop[3:]))


def _warn_about_extents(before: np.ndarray, after: np.ndarray) -> None:
    extent_before, extent_after = np.ptp(before, axis=0).max(), np.ptp(after, axis=0).max()
    ratio = max(extent_before, extent_after) / min(extent_before, extent_after)
    if ratio > SUSPICIOUS_SCALE:
        warnings.warn(
            f"the clouds differ {ratio:.0f}-fold in extent ({extent_before:.4g} before, {extent_after:.4g} after): "
            "is one in millimetres and the other in metres? Both must have the same unit",
            InputWarning,
            stacklevel=2,
        )
    if (before.max(axis=0) < after.min(axis=0)).any() or (after.max(axis=0) < before.min(axis=0)).any():
        warnings.warn(
            "the extents of the clouds do not overlap at all, so what is found means little: are both in the same "
            "frame, and both in metres?",
            InputWarning,
            stacklevel=2,
        )


def _inliers(points: np.ndarray, config: DetectionConfig) -> np.ndarray:
    if config.outlier_neighbours == 0:
        return np.ones(len(points), bool)
    outliers = statistical_outliers(points, neighbours=config.outlier_neighbours, ratio=config.outlier_ratio)
    # A filter that leaves too little to fit was meant for another kind of cloud.
    return ~outliers if (~outliers).sum() >= SMALLEST_CLOUD else np.ones(len(points), bool)


def _voxel_size(clouds: list[np.ndarray], config: DetectionConfig) -> float | None:
    """One size for both clouds, so that both are seen at the same resolution."""
    sizes = [voxel_size_for(points, config.max_points) for points in clouds if len(points) > config.max_points]
    return max(sizes, default=None)


def reduced(points: Float[np.ndarray, "n 3"], size: float | None) -> WeightedPoints:
    """The means of the voxels of this edge with their counts as mass; None: the points themselves, mass 1 each.

    Raises:
        InputError: a size that is not positive, or too small for the extent of the points.
    """
    if size is None:
        return WeightedPoints(points, np.ones(len(points)))
    grid = voxel_grid(points, size)
    return WeightedPoints(grid.points, grid.mass)


def default_components(points: int) -> int:
    """K_max where none is given: 25, or a tenth of the points that are fitted where that is less."""
    return max(1, min(DEFAULT_COMPONENTS, points // POINTS_PER_COMPONENT))


def _max_components(prepared: dict[str, PreparedCloud], config: DetectionConfig) -> int:
    smallest, name = min((len(cloud.weighted.mass), name) for name, cloud in prepared.items())
    if config.max_components is None:
        return default_components(smallest)
    if config.max_components > smallest:
        raise InputError(
            f"max_components={config.max_components} is more than the {smallest} points (or voxels) of the {name} "
            f"cloud; choose at most {max(1, smallest // POINTS_PER_COMPONENT)}"
        )
    return config.max_components
