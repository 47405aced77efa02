"""Stray points: a few that lie so far from all others that they, and not the scan, decide how large a cloud is."""

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

# Radii of all nearer points from which on a point is far: five extents of them. Near 1: the end of a corridor is far.
FAR = 10.0
# Fraction of a cloud's different places that may be stray, at most. Large: parts of a scan are left out.
FEW = 0.05
# Places, within a tenth of their distance from the scan, that are an object, an island or a wall. 1: nothing is stray.
HANDFUL = 5
# Radii of all nearer points beyond which there is nothing real: a sensor sees from a decimetre to kilometres.
BEYOND_SENSORS = 1e4
# What is written where nothing was measured, by grids and what is made of them.
NO_DATA = (-9999.0, -99999.0, -32768.0, *(float(np.finfo(np.float32).max) * sign for sign in (-1, 1)))


def scan_bounds(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "2 3"] | None:
    """The box around a cloud without its stray points.

    Points are stray where they are `FAR` times as far from the middle of the cloud as all nearer ones, are few, and no
    handful of them is together. Points at one place count as one. Coordinates that stand for no data are stray, however
    many there are, where they are outside of the range of all others.

    Args:
        points: coordinates, finite, in any unit and order.

    Returns:
        Its lowest and its highest corner; all points outside of it are stray. None: no point is.
    """
    kept = points
    while (stray := _without_data(kept)) is not None or (stray := _far(kept)) is not None:
        kept = kept[~stray]
    return None if len(kept) == len(points) else np.array([kept.min(axis=0), kept.max(axis=0)])


def within(points: Float64[np.ndarray, "n 3"], bounds: Float64[np.ndarray, "2 3"] | None) -> Bool[np.ndarray, " n"]:
    """Mask of the points in the box of `scan_bounds`."""
    if bounds is None:
        return np.ones(len(points), bool)
    return np.asarray(((points >= bounds[0]) & (points <= bounds[1])).all(axis=1))


def without_stray_points(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    """The points in the box of `scan_bounds`: all of them, where it is None."""
    return points[within(points, scan_bounds(points))]


def _without_data(points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"] | None:
    """Mask of the points with a coordinate that stands for no data; None: there are none."""
    for column in points.T:
        for value in (column.min(initial=np.inf), column.max(initial=-np.inf)):
            # Means of equal numbers differ from them by rounding.
            if np.isclose(value, NO_DATA, rtol=1e-9).any():
                missing = np.isclose(column, value, rtol=1e-9)
                known = column[~missing] / 2
                if len(known) > FEW * len(points) and np.abs(known - value / 2).min() > np.ptp(known):
                    return missing
    return None


def _far(points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"] | None:
    """Mask of the points far from all others; None: there are none."""
    if not len(points):
        return None
    radii, usual = _radii(points)
    order = np.flatnonzero(radii / FAR > usual)
    if not len(order):
        return None
    order = order[np.argsort(radii[order])]
    nearer = np.append(radii[radii / FAR <= usual].max(), radii[order[:-1]])
    first = len(order)
    for start in np.flatnonzero(radii[order] / FAR > nearer)[::-1]:
        if len(_places(points[order[start:]])) > FEW * (len(points) - len(order) + start):
            break
        distance = float(radii[order[start]])
        if distance / BEYOND_SENSORS <= nearer[start] and _are_together(points[order[start:first]] / distance):
            break
        first = int(start)
    return np.isin(np.arange(len(points)), order[first:]) if first < len(order) else None


def _radii(points: Float64[np.ndarray, "n 3"]) -> tuple[Float64[np.ndarray, " n"], float]:
    """The distance of each point from the middle of the cloud, along the axis where it is largest, and their median."""
    # Halves, so that the difference of two numbers of either sign is finite; axis by axis, which NumPy is fast along.
    columns, middle = np.ascontiguousarray(points.T) / 2, len(points) // 2
    centre = np.array([np.partition(column, middle)[middle] for column in columns])
    radii = np.abs(columns - centre[:, None]).max(axis=0)
    elsewhere = radii > 0
    # Placeholders at one place may be more than all that was measured.
    if 0 < 2 * elsewhere.sum() <= len(points):
        centre = np.median(columns[:, elsewhere], axis=1)
        radii = np.abs(columns - centre[:, None]).max(axis=0)
    return radii, float(np.median(radii[elsewhere])) if elsewhere.any() else 0.0


def _are_together(points: Float64[np.ndarray, "n 3"]) -> bool:
    """True where a handful of places is within a `FAR`th of their distance, which is 1, of one of them."""
    places = _places(points)
    tree = cKDTree(places)
    return int(tree.query_ball_point(places, 1 / FAR, p=np.inf, return_length=True).max()) >= HANDFUL


def _places(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    return np.unique(points, axis=0)
