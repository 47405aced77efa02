"""The volume of a closed object, such as a boulder or a box: its convex hull, down to what it stands on."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import ConvexHull, QhullError, cKDTree

from gmmjax.geometry import hull_area


@dataclasses.dataclass(frozen=True)
class HullVolumeSettings:
    """How uncertain the volume of a hull is.

    All values are empirical: they come from development on the scenes of `tests/benchmarks/volumes`.

    Attributes:
        seen: distance from a point, in spacings, up to which a side of the hull was seen. Infinite: all of it, and the
            uncertainty is that of noise.
        bulge: standard deviation of the volume behind a side that was not seen, in that of the half-sphere on it. 0:
            the far side of a boulder is taken for flat.
        surface: standard deviation of where a side lies that was seen, in spacings: a hull ends at the outermost
            points. 0: sparse points show edges exactly.
        quantile: half-width of the interval in standard deviations. 1.96: 95 % if the errors are normal.
    """

    seen: float = 3.0
    bulge: float = 0.5
    surface: float = 0.25
    quantile: float = 1.96


class HullVolume(NamedTuple):
    """The volume of a closed object.

    Attributes:
        area: of its outline from above.
        volume: of the hull.
        error: half-width of its interval.
        registration_error: the part of it, likewise, that is common to all points.
    """

    area: float
    volume: float
    error: float
    registration_error: float


def hull_measures(
    points: Float64[np.ndarray, "n 3"],
    feet: Float64[np.ndarray, "m 3"],
    up: Float64[np.ndarray, " 3"],
    spacing: float,
    registration_error: float,
    settings: HullVolumeSettings = HullVolumeSettings(),
    *,
    hangs: bool = False,
) -> HullVolume | None:
    """The volume of the convex hull of an object with its feet; None where it has none.

    Args:
        points: of the object, relative to it.
        feet: where it stands: below its points. None where that is not known: no rows.
        up: unit vector from its feet to it.
        spacing: of its points.
        registration_error: between the scan that shows the object and the one that shows what it stands on.
        settings: of the uncertainty.
        hangs: whether it hangs before a surface: the side towards that was not seen, even where points are near it.
    """
    try:
        hull = ConvexHull(np.concatenate([points, feet]))
    except (QhullError, ValueError):
        return None
    corners = hull.points[hull.simplices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    unseen = ~_seen(corners, points, settings.seen * spacing) & ~(hull.simplices >= len(points)).all(axis=1)
    outline = hull_area(hull.points[hull.vertices] @ np.linalg.svd(up[None])[2][1:].T)
    hidden, shown = float(areas[unseen].sum()) + hangs * outline, float(areas[~unseen].sum())
    behind = settings.bulge * 2 / 3 * hidden * np.sqrt(hidden / np.pi)
    # Two sides of a box are off by one error each, not by that of all points.
    surface = settings.surface * spacing * shown / 2
    common = settings.quantile * outline * registration_error * (len(feet) > 0)
    error = np.hypot(common, settings.quantile * np.hypot(behind, surface))
    return HullVolume(outline, float(hull.volume), float(error), float(common))


def _seen(
    corners: Float64[np.ndarray, "f 3 3"], points: Float64[np.ndarray, "n 3"], reach: float
) -> Bool[np.ndarray, " f"]:
    """The faces of a hull whose middle is near a point."""
    return np.isfinite(cKDTree(points).query(corners.mean(axis=1), distance_upper_bound=reach)[0])
