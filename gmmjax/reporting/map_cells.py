"""Map of the changes from above: signed distance, probability and change in each cell of a grid."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes import NAMES, Changes
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.geometry import evenly_chosen, nearest_neighbours
from gmmjax.pair import Pair
from gmmjax.reporting.camera import initial_camera
from gmmjax.reporting.quantities import rounded_up

# Edge of a cell, in median spacings of the points seen from above: with less, many cells are empty, with more, small
# changes are a cell or two.
SPACINGS = 2.0
# Neighbours by which the spacing is measured, as fewer lie along one line of a scanner, and points at which it is.
NEIGHBOURS, SAMPLE = 16, 5000
# Share of the points at each edge that may lie outside of the map: at 0 one stray point far out makes all else tiny.
STRAYS = 0.0002
# A bound on memory and file.
MAX_CELLS = 16_000_000


class ChangeMap(NamedTuple):
    """A map, x to the right and y upwards: the first row is the upper one, with the greatest y.

    Attributes:
        left: x of the left edge of the first column, in the frame of the before cloud.
        top: y of the upper edge of the first row.
        cell: edge of a cell.
        distance: signed distance of the after surface from the before surface; NaN where nothing was compared.
        probability: that something in the cell changed, the greatest of its points; NaN where there are no points.
        label: the change of the cell, -1 where it has none, NaN where there are no points.
        level_of_detection: of a point's distance, the mean of the same points; the mean distance of a cell of several
            points is detected from less on. NaN where nothing was compared.
        unit: of lengths; None where it is not known.
        crs: as of `Changes`.
    """

    left: float
    top: float
    cell: float
    distance: Float[np.ndarray, "r c"]
    probability: Float[np.ndarray, "r c"]
    label: Float[np.ndarray, "r c"]
    level_of_detection: Float[np.ndarray, "r c"]
    unit: str | None
    crs: str | None

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper edge."""
        rows, columns = self.distance.shape
        return self.left, self.left + columns * self.cell, self.top - rows * self.cell, self.top


def check_upright(points: Float[np.ndarray, "n 3"]) -> None:
    """Check that a cloud can be seen from above, along z.

    Raises:
        InputError: it is that of a depth camera, which looks along z.
    """
    if len(points) and initial_camera(points).up[2] == 0:
        raise InputError(
            "the scans look like those of a depth camera, in whose frame z points forward: there is no map from above; "
            "transform them into a frame in which z points upwards"
        )


def change_map(changes: Changes, clouds: Pair[PointCloud], cell: float | None = None) -> ChangeMap:
    """Make the map of what changed.

    A cell shows what changed in it, where anything did: the mean distance of the points of that change that has most
    points there. Elsewhere it shows the after scan's mean distance or, where that has no points, the before scan's.

    Args:
        changes: what was found, with a label for each point.
        clouds: both, as they were given to the detection.
        cell: edge of a cell, in the unit of the clouds; None: from the spacing of the points.

    Raises:
        InputError: the scans have no upward direction along z; they fill volumes, and have no distances; a cell that
            is not positive, or so small that there are too many.
    """
    if changes.distance_before is None or changes.distance_after is None:
        raise InputError("a map shows signed distances, which only scans of surfaces have, by the method joint")
    check_upright(clouds.after.points)
    places = np.concatenate([clouds.before.points[:, :2], changes.registration.apply(clouds.after.points)[:, :2]])
    corner, edge, shape = _grid(places, cell)
    points = _points(changes, (places - corner) / edge, shape)
    label = _labels(points, shape[0] * shape[1])
    probability = np.full(len(label), -np.inf)
    np.maximum.at(probability, points.cell, points.probability)
    probability[np.isneginf(probability)] = np.nan
    distance, detection = (_means(points, label, own) for own in (points.distance, points.level_of_detection))
    # Rows count downwards.
    distance, probability, label, detection = (
        np.flipud(band.reshape(shape)) for band in (distance, probability, label, detection)
    )
    top = float(corner[1] + shape[0] * edge)
    return ChangeMap(float(corner[0]), top, edge, distance, probability, label, detection, changes.unit, changes.crs)


class _Points(NamedTuple):
    """The points of both clouds that lie in the grid, and what was found about them."""

    cell: Int[np.ndarray, " n"]
    after: Bool[np.ndarray, " n"]
    label: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    level_of_detection: Float[np.ndarray, " n"]


def _points(changes: Changes, cells: Float64[np.ndarray, "n 2"], shape: tuple[int, int]) -> _Points:
    """Gather the points in the grid; cells are numbered row by row from below."""
    column, row = np.floor(cells).astype(int).T
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    names = ("labels", "probability", "distance", "level_of_detection")
    found = [[getattr(changes, f"{name}_{side}") for side in NAMES] for name in names]
    # Records of earlier versions have no level of detection.
    found[3] = [np.full(len(own), np.nan) if one is None else one for own, one in zip(found[0], found[3], strict=True)]
    after = np.repeat([False, True], [len(own) for own in found[0]])
    values = [after, *(np.concatenate(own) for own in found)]
    return _Points((row * shape[1] + column)[inside], *(own[inside] for own in values))


def _grid(
    places: Float64[np.ndarray, "n 2"], cell: float | None
) -> tuple[Float64[np.ndarray, " 2"], float, tuple[int, int]]:
    """Return the lower left corner, the edge of the cells, rows and columns; corners are multiples of the edge."""
    lower, upper = np.quantile(places, [STRAYS, 1 - STRAYS], axis=0)
    area = float(np.prod(np.maximum(upper - lower, np.finfo(np.float64).tiny)))
    if cell is None:
        edge = rounded_up(max(SPACINGS * _spacing(places), np.sqrt(area / MAX_CELLS)))
    elif not 0 < cell < np.inf:
        raise InputError(f"cell={cell}: must be a positive length")
    else:
        edge = float(cell)
    first, last = np.floor(lower / edge), np.floor(upper / edge)
    columns, rows = (int(count) for count in last - first + 1)
    if rows * columns > 2 * MAX_CELLS:
        raise InputError(f"cell={edge:g}: the map would have {rows:,} x {columns:,} cells; choose a larger one")
    return first * edge, edge, (rows, columns)


def _spacing(places: Float64[np.ndarray, "n 2"]) -> float:
    """Measure the median spacing of the points seen from above."""
    chosen = places[evenly_chosen(len(places), SAMPLE)]
    # So many neighbours of all points, and not of those that were chosen.
    count = min(NEIGHBOURS, len(places) - 1)
    reach = nearest_neighbours(cKDTree(places), chosen, count + 1)[0][:, -1]
    spacing = float(np.median(reach) * np.sqrt(np.pi / max(count, 1)))
    extent = float(np.ptp(places, axis=0).max())
    return spacing or extent or 1.0


def _labels(points: _Points, count: int) -> Float[np.ndarray, " c"]:
    """Find the change with most points in each cell; -1 where there is none, NaN without points."""
    label = np.full(count, np.nan)
    label[points.cell] = -1
    changed = points.label >= 0
    pairs, numbers = np.unique(np.stack([points.cell[changed], points.label[changed]]), axis=1, return_counts=True)
    # The last one that is written stays: that with most points.
    order = np.argsort(numbers, kind="stable")
    label[pairs[0, order]] = pairs[1, order]
    return label


def _means(points: _Points, label: Float[np.ndarray, " c"], values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " c"]:
    """Average the values of the points whose distance each cell shows; NaN without any."""
    known, found = np.isfinite(values), np.full(len(label), np.nan)
    of_change = (points.label >= 0) & (points.label == label[points.cell])
    for layer in (of_change, points.after, ~points.after):
        cells, own = points.cell[known & layer], values[known & layer]
        sums, counts = np.bincount(cells, own, len(label)), np.bincount(cells, minlength=len(label))
        missing = np.isnan(found) & (counts > 0)
        found[missing] = sums[missing] / counts[missing]
    return found
