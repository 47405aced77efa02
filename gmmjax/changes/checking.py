"""The two clouds as given, checked: finite, enough, inside the crop box, and in one unit."""

import dataclasses
import warnings
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Bool, Float

from gmmjax.changes.config import DetectionConfig
from gmmjax.clouds import PointCloud, crop_box
from gmmjax.errors import InputError, InputWarning
from gmmjax.mixtures import parameters_per_component

SMALLEST_CLOUD = parameters_per_component(3) + 1
# Two clouds of one scene differ in extent by what one of them missed, hardly by more than this.
SUSPICIOUS_SCALE = 100.0


@dataclasses.dataclass(frozen=True)
class CheckedCloud:
    """One cloud that can be compared.

    Attributes:
        points: all finite points inside the crop box, in the caller's order and unit.
        used: which rows of the caller's cloud these are.
        cropped: how many finite points lie outside the crop box.
    """

    points: Float[np.ndarray, "n 3"]
    used: Bool[np.ndarray, " rows"]
    cropped: int

    def to_rows(self, values: np.ndarray, missing: int | float | bool) -> np.ndarray:
        """Values of the points in the rows that the caller gave; `missing` in the rows that are not used."""
        rows = np.full(len(self.used), missing, values.dtype)
        rows[self.used] = values
        return rows

    def diagnostics(self, given: ArrayLike | PointCloud) -> dict[str, Any]:
        """Where the cloud came from and what of it is used, as plain values for the record."""
        unplaced = len(self.used) - len(self.points) - self.cropped
        return {
            "source": given.source if isinstance(given, PointCloud) else None,
            "points": len(self.points),
            "rows_dropped": given.rows_dropped if isinstance(given, PointCloud) else unplaced,
            "cropped": self.cropped,
        }


def check_pair(
    before: ArrayLike | PointCloud, after: ArrayLike | PointCloud, config: DetectionConfig
) -> tuple[CheckedCloud, CheckedCloud]:
    """Checks the two clouds and crops them.

    Args:
        before: coordinates [n0, 3] or a `PointCloud`, in any unit.
        after: coordinates [n1, 3] or a `PointCloud`, in the same unit.
        config: has the crop box.

    Raises:
        InputError: a cloud that is not [n, 3], or has too few points or only equal ones.

    Warns:
        InputWarning: extents that do not overlap, or that differ so much that the units must differ.
    """
    checked = _checked("before", before, config), _checked("after", after, config)
    _warn_about_extents(checked[0].points, checked[1].points)
    return checked


def _checked(name: str, cloud: ArrayLike | PointCloud, config: DetectionConfig) -> CheckedCloud:
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
    return CheckedCloud(points, used, int(finite.sum() - used.sum()))


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
            "frame, and in the same unit?",
            InputWarning,
            stacklevel=2,
        )
