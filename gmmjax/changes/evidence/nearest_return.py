"""The points of a survey that its sensors see first in each direction: they hide what is behind them.

A voxel is as large by angle as it is near the sensor: one of a quarter of a metre, at three metres, hides five degrees
of what lies behind it, where a scanner sees past at both sides. What hides, and what is seen behind a place, is
therefore told from the scan itself, as finely as its lines of sight.
"""

import dataclasses

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import cKDTree

from gmmjax.clouds import SensorViews


@dataclasses.dataclass(frozen=True)
class NearestReturnSettings:
    """How finely directions are told apart.

    Attributes:
        cell: edge of a cell of directions, degrees, of which the nearest point is kept. Small: more points, and memory;
            larger: what stands near a sensor hides what is beside it.
        max_points: that are kept of a survey, at most; of more, the cells are doubled. A bound on memory: a million
            take half a gigabyte.
        max_looks: number of points times that of views, at most; of more, evenly chosen points are taken. A bound on
            time, a tenth of a second for a million.
    """

    cell: float = 0.35
    max_points: int = 1_000_000
    max_looks: int = 200_000_000

    def step(self, points: int, views: int) -> int:
        """Which points are taken: every first, second, and so on."""
        return max(1, -(-points * views // self.max_looks))


def nearest_return(
    points: Float64[np.ndarray, "n 3"], views: SensorViews, settings: NearestReturnSettings = NearestReturnSettings()
) -> tuple[Int64[np.ndarray, " m"], float]:
    """Which points are the nearest ones in some cell of directions of some view.

    A depth buffer of the sphere of directions of each view.

    Args:
        points: of a survey, in the unit of the scan.
        views: where it was taken from, in the same frame.
        settings: how finely directions are told apart.

    Returns:
        The indices of the points, ascending, and the edge of the cells, degrees.
    """
    rows, cell = np.arange(0, len(points), settings.step(len(points), len(views))), settings.cell
    rows = rows[nearest_return_at(points[rows], views, cell)]
    while len(rows) > settings.max_points:
        cell *= 2
        rows = rows[nearest_return_at(points[rows], views, cell)]
    return rows, cell


def nearest_return_at(points: Float64[np.ndarray, "n 3"], views: SensorViews, cell: float) -> Int64[np.ndarray, " m"]:
    """The indices of the points that are the nearest ones in some cell of directions of some view, ascending.

    Those of all points are those of the ones that are found in parts of the points.

    Args:
        points: of a survey.
        views: where it was taken from.
        cell: edge of a cell, degrees.
    """
    first = np.zeros(len(points), bool)
    for view in range(len(views)):
        first[nearest_return_in(points, views, view, cell)] = True
    return np.flatnonzero(first)


def nearest_return_in(
    points: Float64[np.ndarray, "n 3"], views: SensorViews, view: int, cell: float
) -> Int64[np.ndarray, " m"]:
    """The indices of the points that are the nearest ones in some cell of directions of one view, ascending.

    Args:
        points: of a survey.
        views: where it was taken from.
        view: which of them.
        cell: edge of a cell, degrees.
    """
    places = views.in_camera(points, view)
    inside = np.flatnonzero(views.in_field_of_view(places))
    places = places[inside]
    ranges = np.linalg.norm(places, axis=1)
    cells, count = _cells(places, ranges, cell)
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, cells, ranges)
    candidates = np.flatnonzero(ranges == nearest[cells])
    return np.asarray(inside[candidates[np.unique(cells[candidates], return_index=True)[1]]])


def angles_between(places: Float64[np.ndarray, "n 3"], neighbour: int) -> Float64[np.ndarray, " n"]:
    """The angle between each point and a certain one of those that are nearest to it by direction, radians.

    Args:
        places: of points, from the sensor.
        neighbour: which one, from 1 for the nearest.
    """
    directions = places / np.maximum(np.linalg.norm(places, axis=1), np.finfo(float).tiny)[:, None]
    count = min(neighbour, len(places) - 1)
    if count < 1:
        return np.zeros(len(places))
    chords = cKDTree(directions).query(directions, k=[count + 1])[0][:, 0]
    return np.asarray(2 * np.arcsin(np.minimum(chords / 2, 1.0)))


def _cells(
    places: Float64[np.ndarray, "n 3"], ranges: Float64[np.ndarray, " n"], cell: float
) -> tuple[Int64[np.ndarray, " n"], int]:
    """The cell of each direction, and how many there are: of rows of one height, in which all are nearly as wide."""
    rows = int(np.ceil(180 / cell))
    middles = np.pi * ((np.arange(rows) + 0.5) / rows - 0.5)
    columns = np.maximum(np.ceil(2 * rows * np.cos(middles)), 1).astype(np.int64)
    firsts = np.cumsum(columns) - columns
    elevation = np.arcsin(np.clip(places[:, 1] / np.maximum(ranges, np.finfo(float).tiny), -1, 1))
    row = np.minimum(((elevation / np.pi + 0.5) * rows).astype(np.int64), rows - 1)
    turn = np.arctan2(places[:, 0], places[:, 2]) / (2 * np.pi) + 0.5
    column = np.minimum((turn * columns[row]).astype(np.int64), columns[row] - 1)
    return firsts[row] + column, int(columns.sum())
