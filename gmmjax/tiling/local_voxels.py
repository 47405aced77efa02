"""Both clouds in voxels as small as the scans allow at each place, block by block: what the fine pass compares."""

import dataclasses
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.changes import NAMES, LocalResolutionSettings, VoxelLattice, WorkingCloud, reduced_on
from gmmjax.clouds import voxel_keys
from gmmjax.geometry import within_box
from gmmjax.pair import Pair
from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.blocks import Block
from gmmjax.tiling.records import Arrays, BlockRecords

Box: TypeAlias = tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]
"""The least and the greatest coordinates of what is in a box along the axes."""


class Voxels(NamedTuple):
    """The voxels of one cloud in a block.

    Attributes:
        points: the mean of each voxel's points, relative to the offset.
        mass: how many points each has.
        sizes: the edge of each.
    """

    points: Float64[np.ndarray, "v 3"]
    mass: Float64[np.ndarray, " v"]
    sizes: Float64[np.ndarray, " v"]

    def within(self, box: Box) -> "Voxels":
        """The voxels whose points are in a box."""
        rows = within_box(self.points, *box)
        return Voxels(*(values[rows] for values in self))


def block_voxels(store: BlockStore, block: Block, lattice: VoxelLattice, settings: LocalResolutionSettings) -> Arrays:
    """The voxels of a block, a `BlockTask`: they depend on the points in it alone.

    Of either cloud the voxels, the number of those with each size at least, and the voxel of each point.

    Args:
        store: of the block.
        block: one of the store's.
        lattice: of the voxels, from the offset on.
        settings: how small they are.
    """
    inside = store.inside(block.number).map(lambda own: own.points)
    clouds = reduced_on(inside, lattice, settings)
    values: dict[str, np.ndarray] = {}
    for side, cloud in zip(NAMES, clouds, strict=True):
        assert cloud.sizes is not None
        values |= {f"points_{side}": cloud.points, f"mass_{side}": cloud.mass, f"sizes_{side}": cloud.sizes}
        values |= {f"numbers_{side}": _numbers(cloud, lattice), f"voxel_{side}": cloud.member.astype(np.int32)}
    return values


@dataclasses.dataclass(frozen=True, eq=False)
class LocalVoxels:
    """The voxels of all blocks, those below a size joined.

    Attributes:
        records: of `block_voxels`.
        lattice: of the voxels, from the offset on.
        least: edge of a voxel, at least.
        counts: number of voxels of either cloud.
        finest: edge of the smallest voxel that there is.
    """

    records: BlockRecords
    lattice: VoxelLattice
    least: float
    counts: Pair[int]
    finest: float

    @classmethod
    def of(cls, records: BlockRecords, lattice: VoxelLattice, most: int) -> "LocalVoxels":
        """The voxels, the smallest ones doubled until neither cloud has more than a number of them.

        Args:
            records: of `block_voxels`.
            lattice: of the voxels.
            most: number of voxels of either cloud.
        """
        numbers, smallest = np.zeros((2, lattice.halvings + 1), np.int64), np.inf
        for number in records.numbers:
            values = records.values(number, *(f"{name}_{side}" for name in ("numbers", "sizes") for side in NAMES))
            numbers += np.stack([values[f"numbers_{side}"].astype(np.int64) for side in NAMES])
            smallest = min(smallest, *(float(values[f"sizes_{side}"].min(initial=np.inf)) for side in NAMES))
        few = np.append(numbers.max(axis=0)[:-1] <= most, True)
        level = int(np.argmax(few))
        least = lattice.finest * 2.0**level
        return cls(records, lattice, least, Pair(*numbers[:, level].tolist()), max(smallest, least))

    def of_cloud(self, number: int, side: str, least: float = 0.0, box: Box | None = None) -> Voxels:
        """The voxels of one cloud in a block.

        Args:
            number: of the block.
            side: "before" or "after".
            least: edge of a voxel, at least; the next smaller size of the lattice is taken, and never a smaller one
                than of all blocks.
            box: only those in it, which are the same as without it; None: all.
        """
        size = self.least * 2.0 ** np.floor(np.log2(max(least / self.least, 1.0)) + 1e-6)
        voxels = self._stored(number, side)
        if box is None:
            return joined(voxels, size)[0]
        # All that may be joined to a voxel in the box is nearer to the box than its size.
        return joined(voxels.within((box[0] - size, box[1] + size)), size)[0].within(box)

    def members(self, number: int, side: str) -> Int64[np.ndarray, " n"]:
        """The voxel of each point of one cloud in a block, in the order of the points.

        Args:
            number: of the block.
            side: "before" or "after".
        """
        place = joined(self._stored(number, side), self.least)[1]
        return place[self.records.values(number, f"voxel_{side}")[f"voxel_{side}"]]

    def _stored(self, number: int, side: str) -> Voxels:
        return Voxels(*self.records.values(number, *(f"{name}_{side}" for name in Voxels._fields)).values())


def joined(voxels: Voxels, least: float) -> tuple[Voxels, Int64[np.ndarray, " v"]]:
    """Voxels with those below a size joined to voxels of that size, which come first.

    Args:
        voxels: of one cloud, on a lattice from the offset on.
        least: edge of the voxels that they are joined to, of the same lattice.

    Returns:
        The voxels, and for each of the given ones the voxel that it is in.
    """
    small = voxels.sizes < least * (1 - 1e-9)
    if not small.any():
        return voxels, np.arange(len(small))
    points, mass = voxels.points[small], voxels.mass[small]
    cells = (points / least).astype(np.int64)
    _, first, place = np.unique(voxel_keys(cells.T), return_index=True, return_inverse=True)
    total = np.bincount(place, weights=mass)
    # Offsets from each voxel's own corner, so that no digits are lost far from the origin.
    apart = mass[:, None] * (points - cells * least)
    sums = [np.bincount(place, weights=apart[:, axis]) for axis in range(3)]
    means = cells[first] * least + np.stack(sums, axis=1) / total[:, None]
    members = np.empty(len(small), np.int64)
    members[small] = place
    members[~small] = len(total) + np.arange((~small).sum())
    large = voxels.points[~small], voxels.mass[~small], voxels.sizes[~small]
    own = means, total, np.full(len(total), least)
    return Voxels(*(np.concatenate(parts) for parts in zip(own, large, strict=True))), members


def _numbers(cloud: WorkingCloud, lattice: VoxelLattice) -> Int64[np.ndarray, " h"]:
    """The number of voxels when those below each size of the lattice are joined, from the smallest on."""
    assert cloud.sizes is not None
    voxels = Voxels(cloud.points, cloud.mass, cloud.sizes)
    numbers = []
    for level in range(lattice.halvings + 1):
        voxels = joined(voxels, lattice.finest * 2.0**level)[0]
        numbers.append(len(voxels.mass))
    return np.array(numbers)
