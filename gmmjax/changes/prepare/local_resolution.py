"""At what resolution two scans are compared at each place: voxels as small as both of them allow there.

The points of a scanner get sparser with the square of the range, and along the ground even faster. One size of voxels
for a whole scene is too coarse near the scanner, or leaves holes far from it.
"""

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt64

from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.clouds import AXIS_BITS, first_of_equals, morton_codes, voxel_keys
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class LocalResolutionSettings:
    """How small the voxels are at each place.

    Space is divided into cubes of as many voxels, which are halved, with their voxels, as long as the smaller voxels
    still sample surfaces in either cloud. Rows of points along the lines of a scanner, with gaps between them, do not:
    halving the voxels doubles their number, on a surface it becomes four times as large, in a cloud of noise eight
    times. The logarithm of that factor to the base of two is the box-counting dimension. It is counted on two lattices,
    shifted against each other by half of a small voxel: on one of them a floor may lie on a boundary of voxels, and
    be in two layers of them.

    Attributes:
        voxels_per_edge: of a cube, a power of two. Fewer: the voxels of a few points differ by chance.
        halvings: of the size of the voxels of the whole scene, at most. 0: they have one size.
        min_points: number of points in a voxel, on average, at least. 1: half of the voxels of a surface are empty.
        min_dimension: box-counting dimension of the points of a cube, at least. 1: lines are taken for surfaces.
        max_dimension: the same, at most. 3: voxels are smaller than the noise.
        min_in_cube: number of points of the denser cloud in a cube, at least; of fewer its dimension is not known.
        max_voxels: of either cloud; with more, the smallest ones are doubled. A bound on time and memory: a million of
            them take about ten seconds and a gigabyte. Fewer: dense scans are compared at less than their resolution.
        rare: a cloud with less than this fraction of the points of the other one in a cube does not count there. 0: a
            stray point of one cloud keeps the resolution of the other one from being used.
    """

    voxels_per_edge: int = 16
    halvings: int = 6
    min_points: float = 1.3
    min_dimension: float = 1.3
    max_dimension: float = 2.6
    min_in_cube: int = 50
    max_voxels: int = 2_000_000
    rare: float = 0.1


class _Cells(NamedTuple):
    """The cell of each point on the finest grid.

    Attributes:
        codes: Morton's numbers of the cells, ascending: three bits fewer are the cell that is twice as large.
        half_cells: indices along x, y and z on the grid of cells half as large, axis by axis.
        rows: of the points, in their cloud.
    """

    codes: UInt64[np.ndarray, " n"]
    half_cells: Int[np.ndarray, "3 n"]
    rows: Int[np.ndarray, " n"]

    @classmethod
    def of(cls, half_cells: Int[np.ndarray, "n 3"]) -> "_Cells":
        """The cells of points, by their indices on the grid of cells half as large."""
        of_axes = np.ascontiguousarray(half_cells.T)
        codes = morton_codes((of_axes >> 1).astype(np.uint64))
        rows = np.argsort(codes)
        return cls(codes[rows], of_axes[:, rows], rows)

    def chosen(self, which: Bool[np.ndarray, " n"]) -> "_Cells":
        return _Cells(self.codes[which], self.half_cells[:, which], self.rows[which])

    def enlarged(self, doublings: int) -> UInt64[np.ndarray, " n"]:
        """The cell of each point on the grid of so many times doubled cells."""
        return self.codes >> np.uint64(3 * doublings)

    def first(self, doublings: int) -> Bool[np.ndarray, " n"]:
        """Which points are the first ones in their cell on that grid."""
        return first_of_equals(self.enlarged(doublings))

    def within(self, doublings: int) -> Int[np.ndarray, "3 n"]:
        """The indices of half cells, from the corner of each point's cell on that grid on."""
        return self.half_cells & (2 ** (doublings + 1) - 1)


@dataclasses.dataclass(frozen=True, eq=False)
class VoxelLattice:
    """The grids that voxels of all sizes are of; each has eight voxels of the next in one of its own.

    Attributes:
        corner: of all grids, in the frame of the clouds.
        voxel_size: edge of the largest voxels, in their unit.
        halvings: of this size, at most.
    """

    corner: Float[np.ndarray, "3"]
    voxel_size: float
    halvings: int

    @classmethod
    def of(cls, corner: Float[np.ndarray, "3"], extent: float, voxel_size: float, halvings: int) -> "VoxelLattice":
        """The lattice of a cube, with as many halvings as asked for, or as its indices leave room for.

        Args:
            corner: lowest one of the cube.
            extent: its edge. A stray point far away leaves no indices for small voxels.
            voxel_size: edge of the largest voxels.
            halvings: asked for.
        """
        most = AXIS_BITS - np.log2(extent / voxel_size)
        return cls(corner, voxel_size, max(0, min(halvings, int(np.floor(most - 1e-6)))))

    @property
    def finest(self) -> float:
        """The edge of the smallest voxels."""
        return self.voxel_size / 2.0**self.halvings


def locally_reduced(
    points: Pair[Float[np.ndarray, "_ 3"]],
    voxel_size: float,
    settings: LocalResolutionSettings = LocalResolutionSettings(),
) -> Pair[WorkingCloud]:
    """Both clouds in voxels as small as they allow at each place, of the same size in both.

    Args:
        points: of both clouds, in one frame.
        voxel_size: edge of the largest voxels, in the unit of the clouds.
        settings: how small the voxels are.
    """
    corner = np.minimum(*points.map(lambda own: own.min(axis=0)))
    offsets = points.map(lambda own: own - corner)
    extent = max(float(own.max()) for own in offsets)
    lattice = VoxelLattice.of(corner, extent, voxel_size, settings.halvings)
    return reduced_on(offsets, lattice, settings, settings.max_voxels)


def reduced_on(
    offsets: Pair[Float[np.ndarray, "_ 3"]],
    lattice: VoxelLattice,
    settings: LocalResolutionSettings = LocalResolutionSettings(),
    max_voxels: int | None = None,
) -> Pair[WorkingCloud]:
    """Both clouds, or what of them is in some cubes of a lattice, in voxels as small as both allow at each place.

    Args:
        offsets: of both clouds, relative to the corner of the lattice; either may be without points.
        lattice: of the voxels.
        settings: how small they are.
        max_voxels: of either cloud; None: the caller bounds their number, of all cubes.
    """
    half_cells = offsets.map(lambda own: (own / (lattice.finest / 2)).astype(np.int64))
    levels = _levels(half_cells, lattice.halvings, settings)
    if max_voxels is not None:
        levels = _bounded(half_cells, levels, max_voxels)
    return each(lambda *own: _working_cloud(lattice, *own), offsets, half_cells, levels)


def _bounded(
    half_cells: Pair[Int[np.ndarray, "_ 3"]], levels: Pair[Int[np.ndarray, " _"]], most: int
) -> Pair[Int[np.ndarray, " _"]]:
    """The levels, the lowest raised until neither cloud has more voxels."""
    least = 0
    while max(each(_count, half_cells, levels)) > most:
        least += 1
        levels = levels.map(functools.partial(np.maximum, least))
    return levels


def _count(half_cells: Int[np.ndarray, "n 3"], levels: Int[np.ndarray, " n"]) -> int:
    """The number of occupied voxels."""
    return sum(len(np.unique(_of_level(half_cells, levels, level)[1])) for level in np.unique(levels).tolist())


def _of_level(
    half_cells: Int[np.ndarray, "n 3"], levels: Int[np.ndarray, " n"], level: int
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """The rows of the points of one level, and the key of the voxel of each."""
    rows = np.flatnonzero(levels == level)
    return rows, voxel_keys((half_cells[rows] >> (level + 1)).T)


def _levels(
    half_cells: Pair[Int[np.ndarray, "_ 3"]], halvings: int, settings: LocalResolutionSettings
) -> Pair[Int[np.ndarray, " _"]]:
    """How often the finest voxels are doubled at each point."""
    levels = half_cells.map(lambda own: np.full(len(own), halvings))
    left = half_cells.map(_Cells.of)
    for level in range(halvings, 0, -1):
        halved = _can_be_halved(left, level, settings)
        left = each(lambda own, which: own.chosen(which), left, halved)
        for of_points, own in zip(levels, left, strict=True):
            of_points[own.rows] = level - 1
    return levels


def _can_be_halved(left: Pair[_Cells], level: int, settings: LocalResolutionSettings) -> Pair[Bool[np.ndarray, " _"]]:
    """Which points are in cubes whose voxels of this level can be halved in both clouds."""
    edge = level + settings.voxels_per_edge.bit_length() - 1
    first = left.map(lambda own: own.first(edge))
    occupied = each(lambda own, which: own.enlarged(edge)[which], left, first)
    cubes = np.union1d(*occupied)
    cube = each(lambda own, which: np.asarray(np.searchsorted(cubes, own))[np.cumsum(which) - 1], occupied, first)
    counts = cube.map(lambda own: np.bincount(own, minlength=len(cubes)))
    most = np.maximum(*counts)
    fit = most >= settings.min_in_cube
    for own, place, count in zip(left, cube, counts, strict=True):
        voxels = _occupied(own, place, len(cubes), level)
        present = count >= settings.rare * most
        dimension = voxels.dimension(_occupied_shifted(own, place, len(cubes), level, edge))
        surface = (dimension >= settings.min_dimension) & (dimension <= settings.max_dimension)
        fit &= ~present | (surface & (count >= settings.min_points * voxels.smaller))
    return cube.map(lambda own: fit[own])


class _Occupied(NamedTuple):
    """How many voxels of a lattice are occupied in each cube.

    Attributes:
        smaller: of half the size.
        larger: of the size.
    """

    smaller: Int[np.ndarray, " c"]
    larger: Int[np.ndarray, " c"]

    def dimension(self, shifted: "_Occupied") -> Float[np.ndarray, " c"]:
        """The box-counting dimension of each cube, of the lattice on which fewer of the smaller voxels are occupied.

        A floor that lies on a boundary of smaller voxels, which is none of the larger ones, occupies both layers.

        Args:
            shifted: on a lattice that is shifted by half of a smaller voxel.
        """
        fewer = shifted.smaller < self.smaller
        smaller, larger = (np.where(fewer, *both) for both in zip(shifted, self, strict=True))
        return np.asarray(np.log2(np.maximum(smaller, 1) / np.maximum(larger, 1)))


def _occupied(own: _Cells, cube: Int[np.ndarray, " n"], cubes: int, level: int) -> _Occupied:
    """The occupied voxels of the lattice.

    Args:
        own: the points of a cloud.
        cube: the number of the cube that each is in.
        cubes: how many there are.
        level: of the larger voxels.
    """
    return _Occupied(*(np.bincount(cube[own.first(size)], minlength=cubes) for size in (level - 1, level)))


def _occupied_shifted(own: _Cells, cube: Int[np.ndarray, " n"], cubes: int, level: int, edge: int) -> _Occupied:
    """The occupied voxels of a lattice that is shifted by half of a smaller voxel along each axis.

    Args:
        own: the points of a cloud.
        cube: the number of the cube that each is in.
        cubes: how many there are.
        level: of the larger voxels.
        edge: level of the cubes.
    """
    # Half of a smaller voxel, in half cells of the finest grid.
    shifted = own.within(edge) + 2 ** (level - 1)

    def occupied(size: int) -> Int[np.ndarray, " c"]:
        x, y, z = shifted >> (size + 1)
        per_edge = 2 ** (edge - size) + 1
        keys = np.sort(((cube * per_edge + x) * per_edge + y) * per_edge + z)
        return np.bincount(keys[first_of_equals(keys)] // per_edge**3, minlength=cubes)

    return _Occupied(occupied(level - 1), occupied(level))


def _working_cloud(
    lattice: VoxelLattice,
    offsets: Float[np.ndarray, "n 3"],
    half_cells: Int[np.ndarray, "n 3"],
    levels: Int[np.ndarray, " n"],
) -> WorkingCloud:
    """The means of the voxels, those of the smallest size first."""
    member = np.empty(len(offsets), int)
    means, masses, sizes = ([np.empty((0, 3))], [np.empty(0)], [np.empty(0)])
    for level in np.unique(levels).tolist():
        rows, own = _of_level(half_cells, levels, level)
        keys, place = np.unique(own, return_inverse=True)
        mass = np.bincount(place).astype(float)
        member[rows] = place + sum(len(own) for own in masses)
        means.append(np.stack([np.bincount(place, offsets[rows, axis]) for axis in range(3)], axis=1) / mass[:, None])
        masses.append(mass)
        sizes.append(np.full(len(keys), lattice.finest * 2.0**level))
    return WorkingCloud(lattice.corner + np.concatenate(means), np.concatenate(masses), member, np.concatenate(sizes))
