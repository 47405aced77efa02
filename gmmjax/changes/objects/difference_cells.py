"""Differences between two surfaces, cell by cell: their noise, the cells without one, and what is hidden from view."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError, cKDTree

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
    difference: Float64[np.ndarray, "r c"], footprint: Bool[np.ndarray, "r c"], count: int = 8
) -> tuple[Float64[np.ndarray, "r c"], float]:
    """The differences with the mean of the nearest cells where there is none, and the variance of their sum."""
    missing = footprint & ~np.isfinite(difference)
    if not missing.any():
        return difference, 0.0
    known = np.argwhere(footprint & np.isfinite(difference))
    values, cells = difference[tuple(known.T)], np.argwhere(missing)
    near = values[nearest_neighbours(cKDTree(known), cells.astype(float), count)[1]]
    means = near.mean(axis=1)
    between = _interpolated(difference, missing)
    values = np.where(np.isfinite(between), between, means)
    spread = np.maximum(near.std(axis=1), np.abs(values - means))
    if np.nansum(difference[footprint]) < 0:
        # What the rim of a pit hides lies below the line of sight, on which the differences fall evenly.
        deepest = _deepest(near, ndimage.label(missing, SQUARE)[0][missing])
        room = np.maximum(values - deepest, 0)
        values, spread = values - room / 2, np.maximum(spread, room / np.sqrt(12))
    whole = difference.copy()
    whole[missing] = values
    # Of one gap all is wrong together: by how its neighbours differ, or it from them.
    of_gaps = np.bincount(ndimage.label(missing, SQUARE)[0][missing], spread)
    return whole, float((of_gaps**2).sum())


def _deepest(near: Float64[np.ndarray, "m k"], gaps: Int[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
    """For each missing cell the middle of the deepest half of what lies about its gap."""
    found = np.zeros(len(near))
    for gap in np.unique(gaps):
        own = gaps == gap
        found[own] = np.quantile(near[own], 0.25)
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
        volume: to be added for it, signed as the differences, or the other way where the last cells count too much.
        error: its standard error.
    """

    volume: float
    error: float


def hidden(
    difference: Float64[np.ndarray, "r c"],
    shown: Bool[np.ndarray, "r c"],
    footprint: Bool[np.ndarray, "r c"],
    foreign: Bool[np.ndarray, "r c"],
    widest: int,
) -> Hidden:
    """What may be hidden behind a change: between its outline and the surface that is seen behind it.

    What a steep side hides lies below the line of sight, on which the differences fall evenly to those behind. At the
    least the change ends where the last cells that were seen begin, at the most it fills all below that line: the
    volume is uniform between both.

    Args:
        difference: of each cell.
        shown: the cells where the scan in which the surface is higher has points.
        footprint: the cells of the change.
        foreign: those of other changes.
        widest: how far behind the change it may be, in cells.
    """
    known = np.isfinite(difference)
    near = ndimage.distance_transform_edt(~footprint) <= widest
    missing = ~known & ~footprint & ~foreign & near
    shadow = ndimage.binary_propagation(ndimage.binary_dilation(footprint, SQUARE) & missing, mask=missing)
    if not shadow.any():
        return Hidden(0.0, 0.0)
    sense = np.sign(np.nansum(difference[footprint]))
    last = footprint & known & ndimage.binary_dilation(shadow & ~shown, CROSS > 0)
    room = np.maximum(sense * np.nan_to_num(_interpolated(difference, shadow)), 0).sum()
    of_last = np.maximum(sense * difference[last], 0).sum()
    return Hidden(float(sense * (room - of_last) / 2), float((room + of_last) / np.sqrt(12)))


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
