"""Differences between two surfaces, cell by cell: their noise, the cells without one, and what is hidden from view."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from gmmjax.geometry import nearest_neighbours

# The four neighbours of a cell.
CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], float)
SQUARE = np.ones((3, 3), bool)


def smoothed(difference: Float64[np.ndarray, "r c"]) -> Float64[np.ndarray, "r c"]:
    """The median of each cell and its eight neighbours; NaN where none is known."""
    padded = np.pad(difference, 1, constant_values=np.nan)
    rows, columns = difference.shape
    shifted = [padded[row : row + rows, column : column + columns] for row in range(3) for column in range(3)]
    # Sorted, NaN comes last: the middle of those that are known.
    ordered = np.sort(np.stack(shifted), axis=0)
    known = np.isfinite(ordered).sum(axis=0)
    lower, upper = np.maximum(known - 1, 0) // 2, known // 2
    values = [np.take_along_axis(ordered, place[None], axis=0)[0] for place in (lower, np.minimum(upper, 8))]
    return np.where(known > 0, (values[0] + values[1]) / 2, np.nan)


def filled(
    thickness: Float64[np.ndarray, "r c"],
    crests: Float64[np.ndarray, "r c"],
    footprint: Bool[np.ndarray, "r c"],
    shown: Bool[np.ndarray, "r c"],
    count: int = 8,
) -> tuple[Float64[np.ndarray, "r c"], float]:
    """The cells of a change without points by those about them, and the variance of their sum.

    Args:
        thickness: by how much the higher surface is above the lower one in each cell.
        crests: likewise where upright sides end in it: between these an object whose top nobody saw is as high.
        footprint: the cells of the change, one of which at least is known.
        shown: the cells where the scan with the higher surface has points.
        count: of the nearest cells, whose mean is taken where the gap is not enclosed.
    """
    missing = footprint & ~np.isfinite(thickness)
    if not missing.any():
        return thickness, 0.0
    near, between = _nearest_known(thickness, footprint, missing, count), _interpolated(thickness, missing)
    covered = ~shown[missing]
    if covered.any():
        near[covered] = _nearest_known(crests, footprint, missing & ~shown, count)
        between[covered] = _interpolated(crests, missing)[covered]
    gaps, means = ndimage.label(missing, SQUARE)[0][missing], near.mean(axis=1)
    values = np.where(np.isfinite(between), between, means)
    spread = np.maximum(near.std(axis=1), np.abs(values - means))
    # What the rim of a pit hides lies below the line of sight, on which the differences fall evenly.
    room = np.where(covered, 0, np.maximum(_thickest(near, gaps) - values, 0))
    whole = thickness.copy()
    whole[missing] = values + room / 2
    # Of one gap all is wrong together: by how its neighbours differ, or it from them.
    of_gaps = np.bincount(gaps, np.maximum(spread, room / np.sqrt(12)))
    return whole, float((of_gaps**2).sum())


def _nearest_known(
    thickness: Float64[np.ndarray, "r c"],
    footprint: Bool[np.ndarray, "r c"],
    cells: Bool[np.ndarray, "r c"],
    count: int,
) -> Float64[np.ndarray, "m k"]:
    """For each of some cells the nearest ones of a footprint that have points."""
    known = np.argwhere(footprint & np.isfinite(thickness))
    near = nearest_neighbours(cKDTree(known), np.argwhere(cells).astype(float), count)[1]
    return np.asarray(thickness[tuple(known.T)][near])


def _thickest(near: Float64[np.ndarray, "m k"], gaps: Int[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
    """For each missing cell the middle of the thickest half of what lies about its gap."""
    found = np.zeros(len(near))
    for gap in np.unique(gaps):
        own = gaps == gap
        found[own] = np.quantile(near[own], 0.75)
    return found


def _interpolated(
    difference: Float64[np.ndarray, "r c"], missing: Bool[np.ndarray, "r c"]
) -> Float64[np.ndarray, " m"]:
    """The missing cells by linear interpolation between those about them; NaN where they are not enclosed."""
    border = ndimage.binary_dilation(missing, SQUARE, iterations=2) & np.isfinite(difference)
    try:
        return np.asarray(LinearNDInterpolator(np.argwhere(border), difference[border])(np.argwhere(missing)))
    except (QhullError, ValueError):
        return np.full(int(missing.sum()), np.nan)


class Hidden(NamedTuple):
    """What nobody saw behind a change, in areas of a cell times the unit of the differences.

    Attributes:
        volume: to be added for it; of the other sign where the last cells count too much.
        error: its standard error.
    """

    volume: float
    error: float


def hidden(
    thickness: Float64[np.ndarray, "r c"],
    shown: Bool[np.ndarray, "r c"],
    footprint: Bool[np.ndarray, "r c"],
    beside: Bool[np.ndarray, "r c"],
    least: float,
) -> Hidden:
    """What may be hidden behind a change: between its outline and the surface that is seen behind it.

    What a steep side hides lies below the line of sight, on which the differences fall evenly to those behind. Of an
    object that line is the most: at the least it ends where the last cells that were seen begin. Of a pit it is the
    least: at the most all that its rim hides is as deep as what is seen. The volume is uniform between both.

    Args:
        thickness: by how much the higher surface is above the lower one in each cell.
        shown: the cells where the scan with the higher surface has points: there the lower one is hidden, by the rim of
            a pit; elsewhere the higher one, by the crest of an object.
        footprint: the cells of the change.
        beside: the cells that may hide a part of it.
        least: thickness on the line of sight, at least; below it a cell without points hides nothing.
    """
    shadow = _beside(footprint, beside & ~np.isfinite(thickness) & ~footprint)
    line = np.zeros(thickness.shape)
    line[shadow] = np.nan_to_num(_interpolated(thickness, shadow))
    shadow = shadow & (line > least)
    behind_crest = _behind_crest(thickness, line, footprint, shadow & ~shown)
    below_rim = _below_rim(thickness, line, footprint, shadow & shown)
    return Hidden(behind_crest.volume + below_rim.volume, float(np.hypot(behind_crest.error, below_rim.error)))


def between_sides(
    crests: Float64[np.ndarray, "r c"],
    sides: Bool[np.ndarray, "r c"],
    cells: Bool[np.ndarray, "r c"],
    count: int = 4,
) -> tuple[Hidden, Bool[np.ndarray, "r c"]]:
    """What nobody saw between the upright sides of an object, of which a part was not seen either, and where that is.

    An object fills the convex hull of its sides; walls that meet leave it empty. The volume is uniform between all and
    the share of the hull's outline that is known to be a side.

    Args:
        crests: thickness of the object where its sides end.
        sides: the cells that have one.
        cells: those where nothing was seen.
        count: of the nearest sides, whose mean height is taken.

    Returns:
        What is hidden, and the cells in the hull.
    """
    hull, corners = np.zeros_like(cells), np.argwhere(sides)
    try:
        # The hull of its vertices is the same, and has few triangles.
        triangles = Delaunay(corners[ConvexHull(corners).vertices])
    except (QhullError, ValueError):
        # One straight wall, if any.
        return Hidden(0.0, 0.0), hull
    hull[:] = (triangles.find_simplex(np.argwhere(np.ones_like(cells)), tol=1e-6) >= 0).reshape(hull.shape)
    inside = hull & cells
    if not inside.any():
        return Hidden(0.0, 0.0), inside
    whole = float(_nearest_known(crests, sides, inside, count).mean(axis=1).sum())
    known = float(ndimage.binary_dilation(sides, SQUARE)[hull & ~ndimage.binary_erosion(hull, SQUARE)].mean())
    return Hidden(whole * (1 + known) / 2, whole * (1 - known) / np.sqrt(12)), inside


def with_sides(
    thickness: Float64[np.ndarray, "r c"], crests: Float64[np.ndarray, "r c"], covered: Bool[np.ndarray, "r c"]
) -> tuple[Float64[np.ndarray, "r c"], float]:
    """The thickness with half of the height of upright sides beside what nobody saw of an object, and its error.

    The floor before a side was seen, what is behind it was not. A side may be anywhere in its cells, uniformly, and is
    at the same place in all of them, because the grid is aligned with the object. The standard error of the sum is that
    of an object of four sides that are independent.

    Args:
        thickness: by how much the higher surface is above the lower one in each cell.
        crests: likewise where upright sides end in it.
        covered: the cells of the object in which nothing was seen.
    """
    sides = (crests > thickness) & ndimage.binary_dilation(covered, SQUARE)
    return np.where(sides, np.maximum(thickness, crests / 2), thickness), float(crests[sides].sum() / (2 * np.sqrt(12)))


def _beside(footprint: Bool[np.ndarray, "r c"], cells: Bool[np.ndarray, "r c"]) -> Bool[np.ndarray, "r c"]:
    """Those of the cells that are connected to the footprint."""
    return np.asarray(ndimage.binary_propagation(ndimage.binary_dilation(footprint, SQUARE) & cells, mask=cells))


def _behind_crest(
    thickness: Float64[np.ndarray, "r c"],
    line: Float64[np.ndarray, "r c"],
    footprint: Bool[np.ndarray, "r c"],
    shadow: Bool[np.ndarray, "r c"],
) -> Hidden:
    """What an object may hide of itself, below the line of sight."""
    last = footprint & np.isfinite(thickness) & ndimage.binary_dilation(shadow, CROSS > 0)
    room, of_last = line[shadow].sum(), np.maximum(thickness[last], 0).sum()
    return Hidden(float((room - of_last) / 2), float((room + of_last) / np.sqrt(12)))


def _below_rim(
    thickness: Float64[np.ndarray, "r c"],
    line: Float64[np.ndarray, "r c"],
    footprint: Bool[np.ndarray, "r c"],
    shadow: Bool[np.ndarray, "r c"],
    count: int = 8,
) -> Hidden:
    """What the near rim of a pit hides of it, below the line of sight."""
    if not shadow.any():
        return Hidden(0.0, 0.0)
    near = _nearest_known(thickness, footprint, shadow, count)
    thickest = _thickest(near, ndimage.label(shadow, SQUARE)[0][shadow])
    below = np.maximum(thickest - line[shadow], 0).sum()
    return Hidden(float(line[shadow].sum() + below / 2), float(below / np.sqrt(12)))


def noise(difference: Float64[np.ndarray, "r c"], footprint: Bool[np.ndarray, "r c"]) -> float:
    """The variance of the sum over the cells by how each differs from its neighbours: noise, and the steep rim."""
    known = np.isfinite(difference)
    values = np.where(known, difference, 0.0)
    number = ndimage.convolve(known.astype(float), CROSS, mode="constant")
    mean = np.divide(
        ndimage.convolve(values, CROSS, mode="constant"), number, out=np.zeros(values.shape), where=number > 0
    )
    chosen = footprint & known & (number > 0)
    return float(((values - mean)[chosen] ** 2 * number[chosen] / (number[chosen] + 1)).sum())


def steepness(thickness: Float64[np.ndarray, "r c"], footprint: Bool[np.ndarray, "r c"]) -> float:
    """What a volume gains when its steep sides are a cell further out: the thickness along these.

    Slopes count by how much of the whole thickness they rise in a cell: gentle ones not at all.
    """
    inside = np.where(footprint, np.nan_to_num(thickness), 0.0)
    slopes = np.hypot(*np.gradient(inside))
    return float((slopes**2).sum() / max(inside.max(), np.finfo(float).tiny))
