"""How many points of two clouds are in each cell of a fine grid, counted in bounded memory.

The points are seen once, some at a time. The cells are as small as they may be without being more than a given number:
where they become more, eight of them are joined to one. So the cells depend on the points alone, not on their order.
"""

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float64, Int64, UInt64

from gmmjax.clouds.canonical import first_of_equals, morton_codes
from gmmjax.clouds.read_both import read_both
from gmmjax.clouds.voxel_grid import AXIS_BITS
from gmmjax.pair import Pair, each

# That are kept of either cloud: fewer take less memory, and blocks are no smaller than a cell.
MOST_CELLS = 1_000_000


@dataclasses.dataclass(frozen=True, eq=False)
class Lattice:
    """A cube, and the cells that it is divided into: those of a level have half the edge of those of the level before.

    Attributes:
        offset: lowest corner of the cube, in the frame of the clouds. All coordinates below are relative to it.
        edge: of the cube, the only cell of level 0.
    """

    offset: Float64[np.ndarray, "3"]
    edge: float

    def edge_of(self, level: int) -> float:
        """The edge of the cells of a level."""
        return float(self.edge / 2**level)

    def holds(self, points: Float64[np.ndarray, "n 3"]) -> bool:
        """Whether all points, relative to the offset, are in the cube."""
        return bool(points.min(initial=0.0) >= 0 and points.max(initial=0.0) < self.edge)

    def codes(self, points: Float64[np.ndarray, "n 3"], level: int) -> UInt64[np.ndarray, " n"]:
        """Morton's number of the cell of each point, at most 2^21 cells to a side.

        Args:
            points: in the cube, relative to the offset.
            level: of the cells, at most 21.
        """
        # Scaled by powers of two, so that the cells of a level are exactly eight of the next.
        return morton_codes((points.T * (2**level / self.edge)).astype(np.uint64))


@dataclasses.dataclass(frozen=True, eq=False)
class CellCounts:
    """The cells of one level that have points of either cloud, in the order of their Morton numbers.

    Attributes:
        level: of the cells.
        codes: Morton's number of each cell.
        points: number of points of either cloud in each cell.
    """

    level: int
    codes: UInt64[np.ndarray, " c"]
    points: Pair[Int64[np.ndarray, " c"]]

    @property
    def coarser(self) -> "CellCounts":
        """The counts in the cells of the level before."""
        codes, places = _distinct(self.codes >> np.uint64(3))
        return CellCounts(self.level - 1, codes, self.points.map(lambda own: np.add.reduceat(own, places)))


def count_cells(clouds: Pair[Iterable[Float64[np.ndarray, "n 3"]]], lattice: Lattice, cell_points: float) -> CellCounts:
    """Counts the points of two clouds in cells of one size.

    Args:
        clouds: the points of either cloud, some at a time, relative to the lattice's offset and inside of its cube.
        lattice: the cells.
        cell_points: of a cell with points, on average of the cloud that has more of them, at least.
    """
    counters = read_both(lambda chunks: _Counter.of(chunks, lattice), clouds)
    level = max(own.level_with(cell_points) for own in counters)
    level = min(level, *(own.level for own in counters))
    for own in counters:
        own.coarsen(level)
    codes = np.union1d(*(own.codes for own in counters))
    return CellCounts(level, codes, each(lambda own: _spread(own, codes), counters))


class _Counter:
    """The cells of one cloud so far."""

    def __init__(self) -> None:
        self.level = AXIS_BITS
        self.codes: UInt64[np.ndarray, " c"] = np.empty(0, np.uint64)
        self.points: Int64[np.ndarray, " c"] = np.empty(0, np.int64)

    @classmethod
    def of(cls, chunks: Iterable[Float64[np.ndarray, "n 3"]], lattice: Lattice) -> "_Counter":
        counter = cls()
        for chunk in chunks:
            if len(chunk):
                counter._add(lattice.codes(chunk, counter.level))
                counter.coarsen(counter._level_where(lambda cells: cells <= MOST_CELLS))
        return counter

    def _add(self, codes: UInt64[np.ndarray, " n"]) -> None:
        own, counts = np.unique(codes, return_counts=True)
        both = np.concatenate([self.codes, own])
        # Stable: it takes sorted parts as they are.
        order = np.argsort(both, kind="stable")
        self._gather(both[order], np.concatenate([self.points, counts.astype(np.int64)])[order])

    def level_with(self, cell_points: float) -> int:
        """The finest level of whose cells with points each has so many, on average."""
        total = self.points.sum()
        return self._level_where(lambda cells: cells * cell_points <= total)

    def _level_where(self, accepted: Callable[[int], bool]) -> int:
        """The finest level, of this and those before, whose number of cells with points is accepted; at least 0."""
        level, codes = self.level, self.codes
        while level and not accepted(len(codes)):
            level, codes = level - 1, _distinct(codes >> np.uint64(3))[0]
        return level

    def coarsen(self, level: int) -> None:
        """Joins the cells to those of a level that is not below theirs."""
        self._gather(self.codes >> np.uint64(3 * (self.level - level)), self.points)
        self.level = level

    def _gather(self, codes: UInt64[np.ndarray, " n"], points: Int64[np.ndarray, " n"]) -> None:
        """Takes sorted codes, each as often as it comes."""
        self.codes, places = _distinct(codes)
        self.points = np.add.reduceat(points, places) if len(places) else points


def _distinct(codes: UInt64[np.ndarray, " n"]) -> tuple[UInt64[np.ndarray, " c"], Int64[np.ndarray, " c"]]:
    """The different ones of sorted codes, and where each comes first."""
    first = first_of_equals(codes)
    return codes[first], np.flatnonzero(first)


def _spread(counter: _Counter, codes: UInt64[np.ndarray, " c"]) -> Int64[np.ndarray, " c"]:
    """The counts in given cells, among which all that have points are."""
    points = np.zeros(len(codes), np.int64)
    points[np.searchsorted(codes, counter.codes)] = counter.points
    return points
