"""The two clouds as given, checked: finite, enough, inside the crop box, and in one unit."""

import dataclasses
import logging
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float, Int

from gmmjax.changes.prepare.units import check_lengths, stated_systems
from gmmjax.changes.registration import Registration
from gmmjax.clouds import (
    PointCloud,
    as_points,
    box_text,
    canonical_order,
    crop_box,
    first_of_equals,
    scan_bounds,
    system_name,
    within,
)
from gmmjax.errors import InputError, warn
from gmmjax.geometry import LocalSurface, evenly_chosen
from gmmjax.mixtures import parameters_per_component
from gmmjax.pair import Pair, each

logger = logging.getLogger(__name__)

# One more point than a Gaussian has parameters.
SMALLEST_CLOUD = parameters_per_component(3) + 1

# What messages call the two clouds: the arguments that they came in.
NAMES = Pair("before", "after")


@dataclasses.dataclass(frozen=True)
class CheckSettings:
    """Limits of the clouds that can be compared.

    Attributes:
        suspicious_scale: ratio of the extents above which the user is asked for the unit: two clouds of one scene
            differ by what one of them missed, hardly by more than 100. Infinite: no warning.
        largest_extent: in the unit of the clouds; the smallest is one over this. Sixth powers of a length, as in the
            determinant of a covariance, and of a thousandth of it stay within the range of float64, 1e-308 to 1e308.
        apart: gap between the extents of clouds whose files state one coordinate reference system, in the larger
            extent, above which they are not of one place. 0: scans that a registration would move are refused;
            infinite: scans of two places that look alike are registered.
    """

    suspicious_scale: float = 100.0
    largest_extent: float = 1e45
    apart: float = 1.0


@dataclasses.dataclass(frozen=True)
class CheckedCloud:
    """One cloud that can be compared.

    Attributes:
        points: all finite points inside the crop box but stray ones, in the canonical order and the caller's unit.
        rows: which row of the caller's cloud each of them is.
        given: how many rows the caller's cloud has.
        cropped: how many finite points lie outside the crop box.
        stray: how many inside it are left out because they lie far from all others; see `scan_bounds`.
    """

    points: Float[np.ndarray, "n 3"]
    rows: Int[np.ndarray, " n"]
    given: int
    cropped: int
    stray: int = dataclasses.field(default=0, kw_only=True)

    def to_rows(self, values: np.ndarray, missing: int | float | bool) -> np.ndarray:
        """Values of the points in the rows that the caller gave; `missing` in the rows that are not used."""
        rows = np.full(self.given, missing, values.dtype)
        rows[self.rows] = values
        return rows

    def diagnostics(self, given: ArrayLike | PointCloud) -> dict[str, Any]:
        """The source of the cloud and the numbers of its points, as plain values for the record."""
        unplaced = self.given - len(self.points) - self.cropped - self.stray
        return {
            "source": given.source if isinstance(given, PointCloud) else None,
            "points": len(self.points),
            "rows_dropped": given.rows_dropped if isinstance(given, PointCloud) else unplaced,
            "cropped": self.cropped,
            "stray": self.stray,
        }


def check_pair(
    clouds: Pair[ArrayLike | PointCloud],
    crop: tuple[float, ...] | None = None,
    settings: CheckSettings = CheckSettings(),
) -> Pair[CheckedCloud]:
    """Checks the two clouds, crops them and leaves stray points out.

    Args:
        clouds: coordinates [n, 3] or a `PointCloud`, in one unit, whichever that is.
        crop: box that is looked at: x, y and z of its lower and then of its upper corner; None: all.
        settings: what clouds can be compared.

    Raises:
        InputError: a cloud that is not of real numbers [n, 3], has too few points or only equal ones, or an extent that
            is too large or too small for float64; angles; clouds of two places of one reference system.

    Warns:
        InputWarning: rows of an array without a position; stray points; extents that differ so much that the units
            must differ.
    """
    each(check_lengths, NAMES, clouds)
    checked = each(lambda name, cloud: _checked(name, cloud, crop, settings), NAMES, clouds)
    for name, own, given in zip(NAMES, checked, clouds, strict=True):
        about = own.diagnostics(given)
        text = "%s: %d points of %r, %d rows without a position, %d points outside the crop box"
        logger.info(text, name, *(about[key] for key in ("points", "source", "rows_dropped", "cropped")))
        if not isinstance(given, PointCloud) and (count := about["rows_dropped"]):
            warn(
                f"{count:,} of {own.given:,} rows of the {name} cloud had no finite position and were left out; "
                "labels and probabilities keep their rows"
            )
    check_same_place(checked.map(lambda own: own.points), stated_systems(clouds), settings)
    _warn_about_extents(checked.before.points, checked.after.points, settings)
    return checked


def check_same_place(
    points: Pair[Float[np.ndarray, "_ 3"]], systems: Pair[str | None], settings: CheckSettings = CheckSettings()
) -> None:
    """Checks that clouds in one coordinate reference system are not far apart.

    Registration brings together whatever looks alike. Coordinates without a reference system may differ by any
    displacement; those in one are those of a place.

    Args:
        points: of both clouds, in the frames that they were given in.
        systems: that their files state.
        settings: how far apart they may be.

    Raises:
        InputError: extents that are farther apart.
    """
    if systems.before is None or systems.before != systems.after:
        return
    boxes = points.map(_extent)
    gap = max(float((boxes.after[0] - boxes.before[1]).max()), float((boxes.before[0] - boxes.after[1]).max()))
    if gap > settings.apart * max(float(np.ptp(box, axis=0).max()) for box in boxes):
        raise InputError(
            f"before, after: the scans do not overlap ({_in_words(boxes)}), and both files state "
            f"{system_name(systems.before)}; "
            "compare scans of one place, or correct the reference system or the coordinates of one of them"
        )


def check_overlap(clouds: Pair[CheckedCloud], registration: Registration | None = None) -> None:
    """Checks that clouds have a place in common, unless a registration that is not in doubt brought them together.

    Args:
        clouds: both, in the frames that they were given in.
        registration: of the after cloud; None: none was made.

    Raises:
        InputError: extents that do not overlap.
    """
    if registration is not None and registration.applied and not registration.in_doubt:
        return
    boxes = clouds.map(lambda cloud: _extent(cloud.points))
    if (boxes.before[1] < boxes.after[0]).any() or (boxes.after[1] < boxes.before[0]).any():
        raise InputError(
            f"before, after: the scans do not overlap ({_in_words(boxes)}); they may be in different coordinate "
            "systems or units: bring them into one frame first, and leave stray points out with crop "
            "(DetectionConfig(crop=...), --crop)"
        )


def check_not_flat(
    points: Pair[Float[np.ndarray, "_ 3"]], given: Pair[ArrayLike | PointCloud], *, registered: bool
) -> None:
    """Checks that two clouds are not both flat, in one plane, unless they are equal: nothing can stand off a surface.

    Args:
        points: of both clouds, in one frame.
        given: both, as they were given.
        registered: whether the after cloud was moved there, so that its plane is that of the before cloud nearly.

    Raises:
        InputError: both are flat.
    """
    planes = points.map(_plane)
    if planes.before is None or planes.after is None or np.array_equal(*points):
        return
    centre, normal, rounding = planes.before
    # A registration takes one plane to the other but for a slight tilt.
    slack = rounding + 1e-3 * registered * _longest_side(points.before)
    if float(np.abs((points.after - centre) @ normal).max()) <= slack:
        labels = each(cloud_label, NAMES, given)
        raise InputError(
            f"{labels.before}, {labels.after}: both scans are flat, as those of a 2-D laser are: all points lie in one "
            "plane, where the method 'joint' can find no change. Give scans in 3-D, or compare them in the frame that "
            "they are given in by the mixtures alone (method='transport', --method transport)"
        )


def _plane(points: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray, float] | None:
    """A point of the plane that all points lie in, its normal, and how far they may be off it by rounding, or None."""
    some = points[evenly_chosen(len(points), 1000)]
    centre = some.mean(axis=0)
    normal = np.linalg.svd(some - centre, full_matrices=False)[2][2]
    for own in (some, points):
        rounding = _rounding(own) * float(np.abs(normal).sum())
        if np.abs((own - centre) @ normal).max() > rounding:
            return None
    return centre, normal, rounding


def warn_of_outlines(surfaces: Pair[LocalSurface]) -> None:
    """Warns of scans as of a 2-D laser that sways: both nearly flat, with points in lines and not on a floor.

    Args:
        surfaces: of both clouds.
    """
    if all(map(_is_outline, surfaces)) and not np.array_equal(surfaces.before.points, surfaces.after.points):
        warn(
            "both scans are flat, and their points lie in lines, as those of a 2-D laser do: the method 'joint' finds "
            "no change within the plane; compare them by method='transport' (--method transport)"
        )


def _is_outline(surface: LocalSurface) -> bool:
    """True where most points lie within a hundredth of the width of one plane, in rows a fifth as wide as long."""
    chosen = evenly_chosen(len(surface), 5000)
    points = surface.points[chosen]
    variances, axes = np.linalg.eigh(np.cov(points, rowvar=False))
    heights = np.abs((points - np.median(points, axis=0)) @ axes[:, 0])
    flat = np.quantile(heights, 0.99) <= 0.01 * np.sqrt(variances[2])
    return bool(flat and np.mean(surface.on_scan_lines(chosen, 0.2)) > 0.5)


def _rounding(points: Float[np.ndarray, "n 3"]) -> float:
    """The error of coordinates by float64, by float32, or by the decimals that they are given to."""
    largest, extent = float(np.abs(points).max()), _longest_side(points)
    exact = 8 * float(np.finfo(np.float64).eps) * largest
    with np.errstate(over="ignore"):
        single = bool((points.astype(np.float32) == points).all()) * float(np.finfo(np.float32).eps) * largest
    given = (10.0**-digits for digits in range(7) if np.abs(np.round(points, digits) - points).max() <= exact)
    return max(exact, single, 1e-6 * extent, 0.6 * next(given, 0.0))


def _extent(points: Float[np.ndarray, "_ 3"]) -> Float[np.ndarray, "2 3"]:
    """The lowest and the highest corner of the box around some points."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def _in_words(boxes: Pair[Float[np.ndarray, "2 3"]]) -> str:
    extents = boxes.map(lambda box: box_text(box, float(np.ptp(box, axis=0).max())))
    return f"before {extents.before}, after {extents.after}"


def check_comparable(
    points: Pair[Float[np.ndarray, "_ 3"]], compared: Pair[Float[np.ndarray, "_ 3"]], resolution: float
) -> None:
    """Checks that both clouds have an extent at the resolution that they are compared at.

    Args:
        points: of both clouds.
        compared: what they were reduced to.
        resolution: voxel size or spacing of the sparser one, in their unit.

    Raises:
        InputError: one cloud is but a few points, or smaller than the spacing of the other.
    """
    extents = points.map(_longest_side)
    if min(len(cloud) for cloud in compared) >= SMALLEST_CLOUD and min(extents) > resolution:
        return
    raise InputError(
        f"before and after: nothing can be compared, because at a resolution of {resolution:.4g} one of them is hardly "
        f"more than a point: the before cloud extends over {extents.before:.4g}, the after cloud over "
        f"{extents.after:.4g}. Give both in the same unit, leave stray points out with crop, or give a smaller "
        "voxel_size (DetectionConfig(crop=..., voxel_size=...), --crop, --voxel-size)"
    )


def _checked(
    name: str, cloud: ArrayLike | PointCloud, crop: tuple[float, ...] | None, settings: CheckSettings
) -> CheckedCloud:
    coordinates = cloud.points if isinstance(cloud, PointCloud) else as_points(cloud, name)
    label = cloud_label(name, cloud)
    finite = np.asarray(np.isfinite(coordinates).all(axis=1))
    used = finite if crop is None else finite & _inside(coordinates, crop)
    rows = np.flatnonzero(used)
    points = coordinates[rows]
    bounds = scan_bounds(points)
    kept = within(points, bounds)
    warn_of_stray_points(label, int((~kept).sum()), bounds)
    points, rows = points[kept], rows[kept]
    _check_points(label, points, crop, settings)
    order = canonical_order(points)
    points, rows = points[order], rows[order]
    places = int(first_of_equals(points).sum())
    if places < SMALLEST_CLOUD:
        raise InputError(
            f"{label}: its {len(points)} points lie in {places} places only; "
            f"at least {SMALLEST_CLOUD} are needed to fit a Gaussian"
        )
    return CheckedCloud(points, rows, len(coordinates), int(finite.sum() - used.sum()), stray=int((~kept).sum()))


def cloud_label(name: str, cloud: ArrayLike | PointCloud) -> str:
    """The name of a cloud in messages: the argument that it came in and, where it is known, its file."""
    return f"{name} ({cloud.source})" if isinstance(cloud, PointCloud) and cloud.source else name


def warn_of_stray_points(label: str, count: int, bounds: Float[np.ndarray, "2 3"] | None) -> None:
    """Warns of points that are left out.

    Args:
        label: of the cloud.
        count: of its stray points.
        bounds: of all others; None: there are no stray points.
    """
    if count and bounds is not None:
        points, lie, are = ("point", "lies", "is") if count == 1 else ("points", "lie", "are")
        warn(
            f"{label}: {count:,} stray {points} {lie} very far from all others and {are} left out; the others are in "
            f"{box_text(bounds, float(np.ptp(bounds, axis=0).max()) or 1.0)}"
        )


def _check_points(label: str, points: np.ndarray, crop: tuple[float, ...] | None, settings: CheckSettings) -> None:
    if len(points) < SMALLEST_CLOUD:
        raise InputError(
            f"{label}: has {len(points)} point{'s' * (len(points) != 1)} with finite coordinates"
            f"{'' if crop is None else ' inside the crop box'}; "
            f"at least {SMALLEST_CLOUD} are needed to fit a Gaussian"
        )
    # Halves, so that the difference of two numbers of either sign is finite.
    extent = 2 * _longest_side(points / 2)
    if extent <= 8 * np.finfo(np.float64).eps * np.abs(points).max():
        raise InputError(f"{label}: all {len(points)} points are equal; there is nothing to compare")
    if not 1 / settings.largest_extent <= extent <= settings.largest_extent:
        raise InputError(
            f"{label}: the points extend over {extent:.4g}, which cannot be computed with; give the coordinates in "
            "another unit, and leave stray points out with crop (DetectionConfig(crop=...), "
            "--crop)"
        )


def _longest_side(points: np.ndarray) -> float:
    """The longest side of the box along the axes around the points."""
    # Axis by axis: NumPy is many times as fast along single columns.
    return max(float(np.ptp(axis)) for axis in points.T)


def _inside(rows: np.ndarray, crop: tuple[float, ...]) -> np.ndarray:
    """Rows that are not finite count as outside."""
    return crop_box(np.where(np.isfinite(rows), rows, np.finfo(np.float64).max), np.array(crop[:3]), np.array(crop[3:]))


def _warn_about_extents(before: np.ndarray, after: np.ndarray, settings: CheckSettings) -> None:
    extent_before, extent_after = _longest_side(before), _longest_side(after)
    ratio = max(extent_before, extent_after) / min(extent_before, extent_after)
    if ratio > settings.suspicious_scale:
        warn(
            f"the clouds differ {ratio:.4g}-fold in extent ({extent_before:.4g} before, {extent_after:.4g} after): "
            "is one in millimetres and the other in metres? Both must have the same unit"
        )
    if all(map(_may_be_degrees, (before, after))):
        warn(
            "x and y of both clouds may be longitude and latitude in degrees: over them z is steeper than any ground. "
            "Distances need lengths: project both first, such as to the UTM zone of the place"
        )


def _may_be_degrees(points: np.ndarray) -> bool:
    """True where x and y are in the range of longitude and latitude, and z rises as no ground in lengths does.

    Either the cloud is a thousand times as high as it is wide, or z is a function of x and y, as on the ground, and
    a hundred times as steep as at 45 degrees.
    """
    width, depth, height = np.ptp(points, axis=0)
    x, y = np.abs(points[:, :2]).max(axis=0)
    if x > 180 or y > 90 or max(width, depth) > 10:
        return False
    if 1000 * max(width, depth) < height:
        return True
    cell, rise = _rise_in_cells(points[evenly_chosen(len(points), 100_000)])
    return bool(100 * cell < rise < height / 2)


def _rise_in_cells(points: np.ndarray) -> tuple[float, float]:
    """The edge of square cells seen from above with some 16 points each, and the median range of z in them."""
    low, extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)
    cell = max(4 * float(np.sqrt(extent.prod() / len(points))), float(extent.max()) / 1e4)
    columns, rows = np.floor((points[:, :2] - low) / cell).astype(np.int64).T
    keys = columns * (rows.max() + 1) + rows
    order = np.argsort(keys)
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    heights = points[order, 2]
    ranges = np.maximum.reduceat(heights, starts) - np.minimum.reduceat(heights, starts)
    return cell, float(np.median(ranges))
