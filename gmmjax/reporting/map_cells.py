"""What changed, seen from above: the signed distance, the probability and the change in each cell of a grid."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes import NAMES, Changes
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.geometry import evenly_chosen, nearest_neighbours
from gmmjax.pair import Pair, each
from gmmjax.reporting.camera import initial_camera


@dataclasses.dataclass(frozen=True)
class ChangeMapSettings:
    """The grid of a map.

    Attributes:
        cell: edge of a cell, in the unit of the clouds; None: from the spacing of the points.
        spacings: that edge in median spacings of the points seen from above. Smaller: many cells are empty; larger:
            small changes are a cell or two.
        neighbours: number of neighbours by which the spacing is measured. Fewer: that along the lines of a scanner.
        sample: number of points, at most, by which it is.
        stray_share: share of the points at each edge that the map may leave out. 0: one stray point far out makes all
            else tiny.
        most_cells: of the map, at most: a bound on memory and file.
    """

    cell: float | None = None
    spacings: float = 2.0
    neighbours: int = 16
    sample: int = 5000
    stray_share: float = 0.0002
    most_cells: int = 16_000_000


class ChangeMap(NamedTuple):
    """A map, x to the right and y upwards: the first row is the upper one, with the greatest y.

    Attributes:
        left: x of the left edge of the first column, in the frame of the before cloud.
        top: y of the upper edge of the first row.
        cell: edge of a cell.
        distance: signed distance of the after surface from the before surface; NaN where nothing was compared.
        probability: that something in the cell changed, the greatest of its points; NaN where there are no points.
        label: the change of the cell, -1 where it has none, NaN where there are no points.
        level_of_detection: that of a point's distance, the mean of the same points: the mean distance of a cell of
            several is detected from less on. NaN where nothing was compared.
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
    """Whether a cloud can be seen from above, along z.

    Raises:
        InputError: it is that of a depth camera, which looks along z.
    """
    if len(points) and initial_camera(points).up[2] == 0:
        raise InputError(
            "the scans look like those of a depth camera, in whose frame z points forward: there is no map from above; "
            "transform them into a frame in which z points upwards"
        )


def change_map(
    changes: Changes, clouds: Pair[PointCloud], settings: ChangeMapSettings = ChangeMapSettings()
) -> ChangeMap:
    """The map of what changed.

    A cell shows what changed in it, where anything did: the mean distance of the points of that change that has most
    points there. Elsewhere it shows the after scan's mean distance or, where that has no points, the before scan's.

    Args:
        changes: what was found, with a label for each point.
        clouds: both, as they were given to the detection.
        settings: of the grid.

    Raises:
        InputError: the scans have no upward direction along z; they fill volumes, and have no distances; a cell that
            is not positive, or so small that there are too many.
    """
    if changes.distance_before is None or changes.distance_after is None:
        raise InputError("a map shows signed distances, which only scans of surfaces have, by the method joint")
    check_upright(clouds.after.points)
    points = Pair(clouds.before.points, changes.registration.apply(clouds.after.points))
    places = points.map(lambda own: own[:, :2])
    corner, cell, shape = _grid(np.concatenate([*places]), settings)
    sides = NAMES.map(lambda side: _side(changes, side))
    cells = places.map(lambda own: _cells(own, corner, cell, shape))
    label = _labels(cells, sides, shape[0] * shape[1])
    probability = _greatest(cells, sides, shape[0] * shape[1])
    distance = _means(cells, sides, label, sides.map(lambda side: side.distance))
    detection = _means(cells, sides, label, sides.map(lambda side: side.level_of_detection))
    # Rows count downwards.
    distance, probability, label, detection = (
        np.flipud(band.reshape(shape)) for band in (distance, probability, label, detection)
    )
    top = float(corner[1] + shape[0] * cell)
    return ChangeMap(float(corner[0]), top, cell, distance, probability, label, detection, changes.unit, changes.crs)


class _Side(NamedTuple):
    """What a record says of the points of one cloud."""

    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    level_of_detection: Float[np.ndarray, " n"]


def _side(changes: Changes, side: str) -> _Side:
    labels, probability, distance, detection = (
        getattr(changes, f"{name}_{side}") for name in ("labels", "probability", "distance", "level_of_detection")
    )
    # Records of earlier versions have none.
    return _Side(labels, probability, distance, np.full(len(labels), np.nan) if detection is None else detection)


def _grid(
    places: Float64[np.ndarray, "n 2"], settings: ChangeMapSettings
) -> tuple[Float64[np.ndarray, " 2"], float, tuple[int, int]]:
    """Lower left corner, edge of the cells, rows and columns; corners are multiples of the edge."""
    strays = settings.stray_share
    lower, upper = np.quantile(places, [strays, 1 - strays], axis=0)
    area = float(np.prod(np.maximum(upper - lower, np.finfo(np.float64).tiny)))
    if settings.cell is None:
        edge = _round_up(max(settings.spacings * _spacing(places, settings), np.sqrt(area / settings.most_cells)))
    elif not 0 < settings.cell < np.inf:
        raise InputError(f"cell={settings.cell}: must be a positive length")
    else:
        edge = float(settings.cell)
    first, last = np.floor(lower / edge), np.floor(upper / edge)
    columns, rows = (int(count) for count in last - first + 1)
    if rows * columns > 2 * settings.most_cells:
        raise InputError(f"cell={edge:g}: the map would have {rows:,} x {columns:,} cells; choose a larger one")
    return first * edge, edge, (rows, columns)


def _spacing(places: Float64[np.ndarray, "n 2"], settings: ChangeMapSettings) -> float:
    """The median spacing of the points seen from above."""
    chosen = places[evenly_chosen(len(places), settings.sample)]
    # So many neighbours of all points, and not of those that were chosen.
    count = min(settings.neighbours, len(places) - 1)
    reach = nearest_neighbours(cKDTree(places), chosen, count + 1)[0][:, -1]
    spacing = float(np.median(reach) * np.sqrt(np.pi / max(count, 1)))
    extent = float(np.ptp(places, axis=0).max())
    return spacing or extent or 1.0


def _round_up(length: float) -> float:
    """The next length of 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * next(step for step in (1, 2, 5, 10) if step * power >= length * (1 - 1e-9)))


def _cells(
    places: Float64[np.ndarray, "n 2"], corner: Float64[np.ndarray, " 2"], cell: float, shape: tuple[int, int]
) -> Int[np.ndarray, " n"]:
    """The number of the cell of each place, row by row from below; -1 outside."""
    column, row = np.floor((places - corner) / cell).astype(int).T
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    return np.where(inside, row * shape[1] + column, -1)


def _labels(cells: Pair[np.ndarray], sides: Pair[_Side], count: int) -> Float[np.ndarray, " c"]:
    """The change with most points in each cell; -1 where there is none, NaN without points."""
    label = np.full(count, np.nan)
    for own in cells:
        label[own[own >= 0]] = -1
    changed = each(lambda own, side: (own >= 0) & (side.labels >= 0), cells, sides)
    of_cells = np.concatenate([*each(lambda own, rows: own[rows], cells, changed)])
    of_labels = np.concatenate([*each(lambda side, rows: side.labels[rows], sides, changed)])
    if len(of_cells):
        pairs, numbers = np.unique(np.stack([of_cells, of_labels]), axis=1, return_counts=True)
        # The last one that is written stays: that with most points.
        order = np.argsort(numbers, kind="stable")
        label[pairs[0, order]] = pairs[1, order]
    return label


def _greatest(cells: Pair[np.ndarray], sides: Pair[_Side], count: int) -> Float[np.ndarray, " c"]:
    """The greatest probability in each cell; NaN without points."""
    found = np.full(count, -np.inf)
    for own, side in zip(cells, sides, strict=True):
        np.maximum.at(found, own[own >= 0], side.probability[own >= 0])
    return np.where(np.isfinite(found), found, np.nan)


def _means(
    cells: Pair[np.ndarray], sides: Pair[_Side], label: Float[np.ndarray, " c"], values: Pair[np.ndarray]
) -> Float[np.ndarray, " c"]:
    """The mean value of the points whose distance each cell shows; NaN without any."""
    known = each(lambda own, value: (own >= 0) & np.isfinite(value), cells, values)

    def mean(rows: Pair[Bool[np.ndarray, " _"]]) -> np.ndarray:
        sums, counts = np.zeros(len(label)), np.zeros(len(label))
        for own, value, chosen in zip(cells, values, rows, strict=True):
            sums += np.bincount(own[chosen], value[chosen], len(label))
            counts += np.bincount(own[chosen], minlength=len(label))
        return np.divide(sums, counts, out=np.full(len(label), np.nan), where=counts > 0)

    nothing = known.map(np.zeros_like)
    of_change = each(
        lambda own, side, chosen: chosen & (side.labels >= 0) & (side.labels == label[own]), cells, sides, known
    )
    layers = mean(of_change), mean(Pair(nothing.before, known.after)), mean(Pair(known.before, nothing.after))
    found = np.full(len(label), np.nan)
    for layer in layers:
        found = np.where(np.isfinite(found), found, layer)
    return found
