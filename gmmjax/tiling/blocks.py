"""The blocks that two clouds are compared in: the leaves of an octree, each with a bounded number of points.

Which blocks there are follows from the points alone, by their numbers in the cells of a fine grid, and not from how
the points are read or shared out to workers.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64, UInt64

from gmmjax.clouds import CloudChunk, first_of_equals, morton_indices
from gmmjax.pair import Pair, each
from gmmjax.tiling.placed_clouds import Lattice, PlacedClouds, read_both

# Density is looked at in cells of an eighth of a block's edge: in larger ones a surface is in a part of them only.
DENSITY_LEVELS = 3


class Block(NamedTuple):
    """A cube of an octree.

    Attributes:
        number: in the order of the blocks, along Morton's curve.
        lower: lowest corner, relative to the offset.
        edge: of the cube, in the unit of the clouds.
    """

    number: int
    lower: Float64[np.ndarray, "3"]
    edge: float

    @property
    def centre(self) -> Float64[np.ndarray, "3"]:
        """The middle of the cube, relative to the offset."""
        return self.lower + self.edge / 2

    def grown(self, margin: float) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        """The lowest and the highest corner of the cube with a margin around it."""
        return self.lower - margin, self.lower + self.edge + margin


@dataclasses.dataclass(frozen=True, eq=False)
class BlockTree:
    """The blocks of two clouds, in the order of Morton's curve; they do not overlap, and hold all points.

    Attributes:
        lattice: whose cells the blocks are.
        finest: level of the cells that were counted in, of which every block has a whole number.
        levels: of each block.
        codes: Morton code of each block in the grid of its level.
        counts: number of points of either cloud in each block.
        spacing: median spacing of neighbouring points of either cloud, as if they were on planes; NaN without points.
    """

    lattice: Lattice
    finest: int
    levels: Int64[np.ndarray, " b"]
    codes: UInt64[np.ndarray, " b"]
    counts: Pair[Int64[np.ndarray, " b"]]
    spacing: Pair[float]

    def __len__(self) -> int:
        return len(self.levels)

    @functools.cached_property
    def starts(self) -> UInt64[np.ndarray, " b"]:
        """The first cell of the finest level in each block."""
        return self.codes << (3 * (self.finest - self.levels)).astype(np.uint64)

    @functools.cached_property
    def edges(self) -> Float64[np.ndarray, " b"]:
        """The edge of each block."""
        return self.lattice.edge / 2.0**self.levels

    @functools.cached_property
    def lowers(self) -> Float64[np.ndarray, "b 3"]:
        """The lowest corner of each block, relative to the offset."""
        return morton_indices(self.codes).T.astype(np.float64) * self.edges[:, None]

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """All blocks, in the order of their numbers."""
        return [Block(number, self.lowers[number], float(edge)) for number, edge in enumerate(self.edges)]

    def blocks_of(self, points: Float64[np.ndarray, "n 3"]) -> Int64[np.ndarray, " n"]:
        """The number of the block that each point is in.

        Args:
            points: relative to the offset, of the clouds that were counted.
        """
        codes = self.lattice.codes(points, self.finest)
        return np.searchsorted(self.starts, codes, side="right").astype(np.int64) - 1

    def near(self, block: Block, margin: float) -> Int64[np.ndarray, " m"]:
        """The numbers of the other blocks that are partly within a margin around a block, in their order."""
        lower, upper = block.grown(margin)
        met = ((self.lowers <= upper) & (self.lowers + self.edges[:, None] >= lower)).all(axis=1)
        met[block.number] = False
        return np.flatnonzero(met)


def tree_of(clouds: PlacedClouds, max_points: int, finest: int) -> BlockTree:
    """Divide the lattice's cube until no block has more than a number of points, or a block is a single cell.

    Args:
        clouds: both; they are read once.
        max_points: of both clouds in a block.
        finest: level of the cells that the points are counted in, at most 21: the occupied ones are held in memory.
    """
    pyramid = _pyramid(_count_cells(clouds, finest))
    leaves = _leaves(pyramid, max_points)
    levels = np.repeat(np.arange(len(pyramid)), [int(own.sum()) for own in leaves])
    codes = np.concatenate([cubes.codes[own] for cubes, own in zip(pyramid, leaves, strict=True)])
    order = np.argsort(codes << (3 * (finest - levels)).astype(np.uint64))
    points = Pair([own.points.before for own in pyramid], [own.points.after for own in pyramid])
    counts = points.map(lambda own: np.concatenate(own)[np.concatenate(leaves)])
    spacings = points.map(lambda own: _spacings(own, pyramid, leaves, clouds.lattice))
    spacing = each(_weighted_median, spacings, counts)
    return BlockTree(clouds.lattice, finest, levels[order], codes[order], counts.map(lambda own: own[order]), spacing)


class _CellCounts(NamedTuple):
    """The cells of one level that have points of either cloud, by their Morton codes, and the numbers of these."""

    level: int
    codes: UInt64[np.ndarray, " c"]
    points: Pair[Int64[np.ndarray, " c"]]


def _count_cells(clouds: PlacedClouds, level: int) -> _CellCounts:
    counts = read_both(functools.partial(_counts_of, clouds.lattice, level), clouds.chunks())
    codes = np.union1d(*(own for own, _ in counts))
    points = counts.map(lambda own: np.zeros(len(codes), np.int64))
    for own, (met, numbers) in zip(points, counts, strict=True):
        own[np.searchsorted(codes, met)] = numbers
    return _CellCounts(level, codes, points)


def _counts_of(
    lattice: Lattice, level: int, chunks: Iterable[CloudChunk]
) -> tuple[UInt64[np.ndarray, " c"], Int64[np.ndarray, " c"]]:
    """The cells of one level that have points of one cloud, and how many."""
    codes, numbers = np.empty(0, np.uint64), np.empty(0, np.int64)
    for chunk in chunks:
        met, added = np.unique(lattice.codes(chunk.points, level), return_counts=True)
        codes, place = np.unique(np.concatenate([codes, met]), return_inverse=True)
        numbers = np.bincount(place, np.concatenate([numbers, added]), len(codes)).astype(np.int64)
    return codes, numbers


def _pyramid(counts: _CellCounts) -> list[_CellCounts]:
    """The counts of all levels, from the whole cube on."""
    levels = [counts]
    for level in range(counts.level - 1, -1, -1):
        codes = levels[-1].codes >> np.uint64(3)
        places = np.flatnonzero(first_of_equals(codes))
        points = Pair(*(np.add.reduceat(own, places) for own in levels[-1].points))
        levels.append(_CellCounts(level, codes[places], points))
    return levels[::-1]


def _parents(finer: _CellCounts, coarser: _CellCounts) -> Int64[np.ndarray, " c"]:
    """The place of the cube of a coarser level that each cell is in; both are sorted, and no cube is empty."""
    codes = finer.codes >> np.uint64(3 * (finer.level - coarser.level))
    return np.cumsum(np.append(False, codes[1:] != codes[:-1]))


def _leaves(pyramid: list[_CellCounts], max_points: int) -> list[Bool[np.ndarray, " _"]]:
    """Masks of the cubes of each level that are blocks."""
    leaves, reached = [], np.ones(len(pyramid[0].codes), bool)
    for cubes, finer in itertools.pairwise(pyramid):
        divided = cubes.points.before + cubes.points.after > max_points
        leaves.append(reached & ~divided)
        reached = (reached & divided)[_parents(finer, cubes)]
    return [*leaves, reached]


def _spacings(
    points: list[Int64[np.ndarray, " _"]],
    pyramid: list[_CellCounts],
    leaves: list[Bool[np.ndarray, " _"]],
    lattice: Lattice,
) -> Float64[np.ndarray, " b"]:
    """The spacing of a cloud in each block, with as much of a surface in a cell as a side of it; NaN without points."""
    found = []
    for level, (cubes, own, chosen) in enumerate(zip(pyramid, points, leaves, strict=True)):
        cells = pyramid[min(level + DENSITY_LEVELS, len(pyramid) - 1)]
        occupied = np.bincount(_parents(cells, cubes), weights=points[cells.level] > 0, minlength=len(own))
        area = np.divide(occupied, own, where=own > 0, out=np.full(len(own), np.nan))
        found.append((lattice.edge_of(cells.level) * np.sqrt(area))[chosen])
    return np.concatenate(found)


def _weighted_median(values: Float64[np.ndarray, " b"], weights: Int64[np.ndarray, " b"]) -> float:
    """The value below which half of the weight is; NaN without any weight."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)]) if total[-1] else float("nan")
