"""The blocks that two clouds are compared in: the leaves of an octree, small where both clouds are dense.

Which blocks there are follows from the points alone, by their numbers in the cells of a fine grid, and not from how
the points are read or shared out to workers. A block has voxels of one size.
"""

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64, UInt64

from gmmjax.clouds.canonical import morton_indices
from gmmjax.clouds.cell_counts import CellCounts, Lattice
from gmmjax.errors import InputError
from gmmjax.pair import Pair, each

# Of a cloud, for voxels of this size. 1: the noise of single points is in the voxels; many: changes of few points are
# averaged away.
POINTS_PER_VOXEL = 4.0
# Share of a cloud's cells with so many points from which on the cloud supports a voxel size. 0: the densest cell does;
# 1: a single cell at a rim with few points keeps the voxels large.
DENSE = 0.5


@dataclasses.dataclass(frozen=True)
class BlockSettings:
    """Which cubes of the octree are blocks, and the voxel size of each.

    Attributes:
        voxels: along the edge of a block that has voxels of its own. Few: more blocks, each with much margin for its
            size; many: a block that is partly dense has voxels for its sparser part.
        covered: share of a plane across a block that a cloud covers with so many points, at least. 0: the blocks get
            ever smaller about a few points that are close together.
        least_points: in a cube, of which a density follows. Fewer of a cloud whose spacing around is small enough,
            such as noise in the air or at the rim of what it covers, do not count. 0: they keep the voxels large.
        cells: along the edge of a possible block, that density is looked at in; a power of 2. Few: a cell that a
            surface touches at its rim looks sparse.
        finest_voxel: in the unit of the clouds; smaller ones say nothing, such as those below the noise of the scans.
            0: the density of the points decides alone.
        most_points: of both clouds in a block; one with more is divided, and keeps its voxel size. Infinite: memory
            grows with the density of the denser cloud.
        cell_points: of the cells in which a cloud is counted, on average, at least. 1: time and memory for cells of
            single points, of which nothing follows; many: where a cloud is much denser than on average, the blocks are
            too large.
    """

    voxels: int = 64
    covered: float = 0.1
    least_points: int = 64
    cells: int = 8
    finest_voxel: float = 0.0
    most_points: float = 1e6
    cell_points: float = 8.0


class Block(NamedTuple):
    """A cube of an octree, with the points of both clouds that are in it.

    Attributes:
        number: in the order of the blocks, along Morton's curve.
        key: level and indices along x, y and z in the grid of that level.
        lower: lowest corner, relative to the offset.
        edge: of the cube, in the unit of the clouds.
        voxel_size: of the block's voxels, whose grid begins at the lowest corner.
        counts: number of points of either cloud.
        spacing: of neighbouring points of either cloud there, as if they were on a plane; NaN without points.
    """

    number: int
    key: tuple[int, int, int, int]
    lower: Float64[np.ndarray, "3"]
    edge: float
    voxel_size: float
    counts: Pair[int]
    spacing: Pair[float]

    @property
    def centre(self) -> Float64[np.ndarray, "3"]:
        """The middle of the cube, relative to the offset."""
        return self.lower + self.edge / 2


@dataclasses.dataclass(frozen=True, eq=False)
class BlockTree:
    """The blocks of two clouds, in the order of Morton's curve; they do not overlap, and hold all points.

    Attributes:
        lattice: whose cells the blocks are.
        finest: level of the cells that were counted in, of which every block has a whole number.
        levels: of each block.
        codes: Morton's number of each block in the grid of its level.
        voxel_sizes: of each block.
        counts: number of points of either cloud in each block.
        spacings: of neighbouring points of either cloud in each block; NaN without points.
        extents: lowest and highest corner of the counted cells with points of either cloud, relative to the offset.
    """

    lattice: Lattice
    finest: int
    levels: Int64[np.ndarray, " b"]
    codes: UInt64[np.ndarray, " b"]
    voxel_sizes: Float64[np.ndarray, " b"]
    counts: Pair[Int64[np.ndarray, " b"]]
    spacings: Pair[Float64[np.ndarray, " b"]]
    extents: Pair[Float64[np.ndarray, "2 3"]]

    def __len__(self) -> int:
        return len(self.levels)

    @functools.cached_property
    def starts(self) -> UInt64[np.ndarray, " b"]:
        """The first cell of the finest level in each block."""
        return self.codes << (3 * (self.finest - self.levels)).astype(np.uint64)

    @functools.cached_property
    def indices(self) -> Int64[np.ndarray, "b 3"]:
        """The indices of each block along x, y and z in the grid of its level."""
        return morton_indices(self.codes).T.astype(np.int64)

    @functools.cached_property
    def edges(self) -> Float64[np.ndarray, " b"]:
        """The edge of each block."""
        return self.lattice.edge / 2.0**self.levels

    @functools.cached_property
    def lowers(self) -> Float64[np.ndarray, "b 3"]:
        """The lowest corner of each block, relative to the offset."""
        return self.indices * self.edges[:, None]

    def block(self, number: int) -> Block:
        """One of the blocks."""
        level, (x, y, z) = int(self.levels[number]), self.indices[number].tolist()
        return Block(
            number=number,
            key=(level, x, y, z),
            lower=self.lowers[number],
            edge=float(self.edges[number]),
            voxel_size=float(self.voxel_sizes[number]),
            counts=self.counts.map(lambda own: int(own[number])),
            spacing=self.spacings.map(lambda own: float(own[number])),
        )

    def blocks_of(self, points: Float64[np.ndarray, "n 3"]) -> Int64[np.ndarray, " n"]:
        """The number of the block that each point is in.

        Args:
            points: relative to the offset, of the clouds that were counted.
        """
        codes = self.lattice.codes(points, self.finest)
        return np.searchsorted(self.starts, codes, side="right").astype(np.int64) - 1

    def near(self, block: Block, margin: float) -> Int64[np.ndarray, " m"]:
        """The numbers of the other blocks that are partly within a margin around a block, in their order."""
        lower, upper = block.lower - margin, block.lower + block.edge + margin
        met = ((self.lowers <= upper) & (self.lowers + self.edges[:, None] >= lower)).all(axis=1)
        met[block.number] = False
        return np.flatnonzero(met)

    @functools.cached_property
    def spacing(self) -> Pair[float]:
        """The median spacing of neighbouring points of either cloud."""
        return each(_weighted_median, self.spacings, self.counts)

    @property
    def common(self) -> Bool[np.ndarray, " b"]:
        """Which blocks have points of both clouds."""
        return (self.counts.before > 0) & (self.counts.after > 0)


def block_tree(counts: CellCounts, lattice: Lattice, settings: BlockSettings = BlockSettings()) -> BlockTree:
    """The blocks of two clouds, by the number of points in fine cells.

    A cube of the octree has voxels of its own where each cloud that is present in it has enough points for them:
    `POINTS_PER_VOXEL`, as on a surface, in most of the cells that it is in. A cloud that is dense around the cube and
    not in it, behind an obstacle or beyond its range, leaves that to the other one.

    A cube is divided where any part of it has voxels of its own, or where it has too many points; a part that has none
    has the voxel size of the cube around it. Adjacent blocks may differ by several levels.

    Args:
        counts: number of points in the cells.
        lattice: of the cells.
        settings: which cubes have voxels of their own.
    """
    pyramid = _pyramid(counts)
    supported = _supported(pyramid, lattice, settings)
    divided = _divided(supported, pyramid, settings)
    inside = np.ones(len(pyramid[0].codes), bool)
    sizes = np.full(len(pyramid[0].codes), _size_of_cube(pyramid, lattice, settings))
    leaves = []
    for level in range(len(pyramid)):
        leaves.append(_leaves(level, inside & ~divided[level], sizes, pyramid, lattice, settings))
        if level + 1 < len(pyramid):
            parents = _parents(pyramid[level + 1], pyramid[level])
            inside = (inside & divided[level])[parents]
            own = lattice.edge_of(level + 1) / settings.voxels
            sizes = np.where(supported[level + 1], own, sizes[parents])
    return _tree(leaves, lattice, counts)


def require_overlap(tree: BlockTree) -> None:
    """Raises an error unless some block has points of both clouds.

    Args:
        tree: the blocks of two clouds.

    Raises:
        InputError: the clouds do not overlap.
    """
    if tree.common.any():
        return

    extents = tree.extents.map(lambda own: box_text(own + tree.lattice.offset, tree.lattice.edge))
    raise InputError(
        f"before, after: the scans do not overlap (before {extents.before}, after {extents.after}); they may be in "
        "different coordinate systems: register them first, or give the transform between them"
    )


def box_text(box: Float64[np.ndarray, "2 3"], size: float) -> str:
    """A box along the axes as a user reads it, to a thousandth of a size.

    Args:
        box: its lowest and its highest corner.
        size: that matters, such as the extent of a scene.
    """
    decimals = max(0, 3 - math.ceil(math.log10(size)))
    return " x ".join(f"{least:.{decimals}f}..{most:.{decimals}f}" for least, most in box.T)


def _pyramid(counts: CellCounts) -> list[CellCounts]:
    """The counts of all levels, from the whole cube on."""
    levels = [counts]
    while levels[-1].level:
        levels.append(levels[-1].coarser)
    return levels[::-1]


def _parents(finer: CellCounts, coarser: CellCounts) -> Int64[np.ndarray, " c"]:
    """The place of the cube of a coarser level that each cell is in; both are sorted, and no cube is empty."""
    codes = finer.codes >> np.uint64(3 * (finer.level - coarser.level))
    return np.cumsum(np.append(False, codes[1:] != codes[:-1]))


def _cells_of(level: int, pyramid: list[CellCounts], settings: BlockSettings) -> CellCounts:
    """The cells in which the density in the cubes of a level is looked at."""
    return pyramid[min(level + settings.cells.bit_length() - 1, len(pyramid) - 1)]


def _size_of_cube(pyramid: list[CellCounts], lattice: Lattice, settings: BlockSettings) -> float:
    """The voxel size of the whole cube, which may have too few points for voxels of its own: then it has fewer."""
    cells = _cells_of(0, pyramid, settings)
    widest = max(
        float(
            _spacing(np.array([float(np.count_nonzero(own))]), own.sum(keepdims=True), lattice.edge_of(cells.level))[0]
        )
        for own in cells.points
    )
    own = lattice.edge / settings.voxels
    doublings = np.ceil(np.log2(np.sqrt(POINTS_PER_VOXEL) * widest / own)) if widest > 0 else 0.0
    return float(own * 2 ** np.clip(doublings, 0, np.log2(settings.voxels)))


def _supported(pyramid: list[CellCounts], lattice: Lattice, settings: BlockSettings) -> list[Bool[np.ndarray, " _"]]:
    """Which cubes of each level have points enough for voxels of their own."""
    sides = Pair([own.points.before for own in pyramid], [own.points.after for own in pyramid])
    by_cloud = sides.map(lambda points: _supported_by(points, pyramid, lattice, settings))
    least = settings.covered * POINTS_PER_VOXEL * settings.voxels**2
    supported = []
    for cubes, before, after in zip(pyramid, *by_cloud, strict=True):
        fine_enough = lattice.edge_of(cubes.level) / settings.voxels >= settings.finest_voxel
        covered = np.maximum(cubes.points.before, cubes.points.after) >= least
        supported.append(before & after & covered & fine_enough)
    return supported


def _supported_by(
    points: list[Int64[np.ndarray, " _"]], pyramid: list[CellCounts], lattice: Lattice, settings: BlockSettings
) -> list[Bool[np.ndarray, " _"]]:
    """In which cubes of each level one cloud has enough of its points for voxels of their own, or is absent.

    Where it has few points it is absent or sparse: its spacing in the next larger cube with points enough tells which.
    """
    supported, spacing = [], np.full(1, np.inf)
    for level, cubes in enumerate(pyramid):
        cells, own = _cells_of(level, pyramid, settings), points[level]
        parents = _parents(cells, cubes)
        enough = POINTS_PER_VOXEL * (settings.voxels / 2 ** (cells.level - level)) ** 2
        dense = np.bincount(parents, weights=points[cells.level] >= enough, minlength=len(own))
        occupied = np.bincount(parents, weights=points[cells.level] > 0, minlength=len(own))
        few = own < max(settings.least_points, 1)
        around = spacing[_parents(cubes, pyramid[max(level - 1, 0)])]
        spacing = np.where(few, around, _spacing(occupied, own, lattice.edge_of(cells.level)))
        voxel = lattice.edge_of(level) / settings.voxels
        absent = few & (spacing * np.sqrt(POINTS_PER_VOXEL) <= voxel)
        supported.append(absent | (~few & (dense >= DENSE * occupied)))
    return supported


def _spacing(
    occupied: Float64[np.ndarray, " q"], points: Int64[np.ndarray, " q"], edge: float
) -> Float64[np.ndarray, " q"]:
    """The spacing of points in so many cells, with as much of a surface in each as a side of it; NaN without points."""
    return edge * np.sqrt(np.divide(occupied, points, where=points > 0, out=np.full(len(points), np.nan)))


def _divided(
    supported: list[Bool[np.ndarray, " _"]], pyramid: list[CellCounts], settings: BlockSettings
) -> list[Bool[np.ndarray, " _"]]:
    """Which cubes of each level are divided, from those on whose size the finest ones are to be."""
    divided = [np.zeros(len(pyramid[-1].codes), bool)]
    for level in range(len(pyramid) - 2, -1, -1):
        cubes = pyramid[level]
        parents = _parents(pyramid[level + 1], cubes)
        wanted = np.bincount(parents, weights=supported[level + 1] | divided[0], minlength=len(cubes.codes)) > 0
        divided.insert(0, wanted | (cubes.points.before + cubes.points.after > settings.most_points))
    return divided


class _Leaves(NamedTuple):
    """The blocks of one level."""

    levels: Int64[np.ndarray, " b"]
    codes: UInt64[np.ndarray, " b"]
    voxel_sizes: Float64[np.ndarray, " b"]
    counts: Pair[Int64[np.ndarray, " b"]]
    spacings: Pair[Float64[np.ndarray, " b"]]


def _leaves(
    level: int,
    chosen: Bool[np.ndarray, " q"],
    sizes: Float64[np.ndarray, " q"],
    pyramid: list[CellCounts],
    lattice: Lattice,
    settings: BlockSettings,
) -> _Leaves:
    """The chosen cubes of a level."""
    cubes, cells = pyramid[level], _cells_of(level, pyramid, settings)
    parents = _parents(cells, cubes)

    def spacing(points: Int64[np.ndarray, " c"], own: Int64[np.ndarray, " q"]) -> Float64[np.ndarray, " b"]:
        occupied = np.bincount(parents, weights=points > 0, minlength=len(own))
        return _spacing(occupied, own, lattice.edge_of(cells.level))[chosen]

    return _Leaves(
        np.full(int(chosen.sum()), level, np.int64),
        cubes.codes[chosen],
        sizes[chosen],
        cubes.points.map(lambda own: own[chosen]),
        each(spacing, cells.points, cubes.points),
    )


def _tree(leaves: list[_Leaves], lattice: Lattice, cells: CellCounts) -> BlockTree:
    levels, codes, voxel_sizes = (np.concatenate([own[place] for own in leaves]) for place in range(3))
    order = np.argsort(codes << (3 * (cells.level - levels)).astype(np.uint64))
    counts, spacings = (
        each(lambda *own: np.concatenate(own)[order], *sides)
        for sides in ([own.counts for own in leaves], [own.spacings for own in leaves])
    )

    def extent(points: Int64[np.ndarray, " c"]) -> Float64[np.ndarray, "2 3"]:
        indices = morton_indices(cells.codes[points > 0]).astype(np.float64)
        corners = np.array([indices.min(axis=1, initial=np.inf), indices.max(axis=1, initial=-np.inf) + 1])
        return corners * lattice.edge_of(cells.level)

    extents = cells.points.map(extent)
    return BlockTree(lattice, cells.level, levels[order], codes[order], voxel_sizes[order], counts, spacings, extents)


def _weighted_median(values: Float64[np.ndarray, " b"], weights: Int64[np.ndarray, " b"]) -> float:
    """The value below which half of the weight is; NaN without any weight."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)]) if total[-1] else float("nan")
