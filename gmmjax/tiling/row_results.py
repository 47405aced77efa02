"""Results for each row of both surveys, from those of the voxels that their points are in."""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import cKDTree

from gmmjax.changes import NAMES, Changes, PointFigures, SurfaceChangeSettings, outside_probability
from gmmjax.clouds import CloudChunk
from gmmjax.geometry import nearest_neighbours
from gmmjax.pair import Pair, each, parallel_map
from gmmjax.tiling.compared_blocks import ComparedBlocks, ComparedVoxels
from gmmjax.tiling.local_voxels import Voxels
from gmmjax.tiling.regions_of_interest import RefinedCloud
from gmmjax.tiling.row_columns import MISSING, RowColumns


def row_columns(folder: Path, counts: Pair[int]) -> Pair[RowColumns]:
    """Columns for the rows of both surveys, in a folder that is there.

    Raises:
        InputError: the disk is full.
    """
    return each(lambda side, count: RowColumns(folder / side, count), NAMES, counts)


def fill_rows(
    columns: Pair[RowColumns],
    blocks: ComparedBlocks,
    fine: Pair[RefinedCloud],
    changes: Changes,
    settings: SurfaceChangeSettings,
) -> Pair[Int[np.ndarray, " _"]]:
    """Fill the columns of both surveys, block by block.

    Args:
        columns: to fill.
        blocks: of both clouds, compared.
        fine: the clouds that the changes were found in.
        changes: of these clouds.
        settings: how probable points outside of changes are.

    Returns:
        For each voxel of these clouds the first row that is in it; for a coarse one, that is in the voxel next to it.
    """
    found = each(lambda side, own: _Found.of(side, own, changes, settings), NAMES, fine)
    return parallel_map(functools.partial(_fill, blocks), NAMES, columns, found)


def _fill(blocks: ComparedBlocks, side: str, columns: RowColumns, found: "_Found") -> Int[np.ndarray, " _"]:
    first = np.full(len(found.cloud.own.looks_changed), columns.count)
    for number in range(len(blocks.store.tree)):
        inside: CloudChunk = getattr(blocks.store.inside(number), side)
        member = blocks.voxels.members(number, side)
        voxels = blocks.side(number, side)
        values = found.of_voxels(number, voxels)
        columns.fill(inside.rows, {name: array[member] for name, array in values.items()})
        of_voxels = np.full(len(voxels.looks_changed), columns.count)
        np.minimum.at(of_voxels, member, inside.rows)
        _take_first_rows(first, found.cloud, number, of_voxels)
    columns.flush()
    return first


def _take_first_rows(
    first: Int[np.ndarray, " m"],
    cloud: RefinedCloud,
    number: int,
    of_voxels: Int[np.ndarray, " v"],
) -> None:
    """Lower the first row of each voxel of a cloud to those of the voxels of a block.

    Args:
        first: of each voxel of the cloud; it is changed.
        cloud: whose voxels they are.
        number: of the block.
        of_voxels: the first row in each voxel of the block.
    """
    places = cloud.rows_of(number, len(of_voxels))
    fine = places >= 0
    np.minimum.at(first, places[fine], of_voxels[fine])
    coarse, nearest = cloud.coarse_of(number)
    first[coarse] = of_voxels[nearest]


@dataclasses.dataclass(frozen=True, eq=False)
class _Found:
    """The results for one cloud.

    Attributes:
        cloud: that the changes were found in.
        values: of each of its voxels, by name.
        unobserved: tree of the coarse points, and which of them the other survey did not observe; None: there is none.
        settings: how probable points outside of changes are.
    """

    cloud: RefinedCloud
    values: Mapping[str, np.ndarray]
    unobserved: tuple[cKDTree, Bool[np.ndarray, " c"]] | None
    settings: SurfaceChangeSettings

    @classmethod
    def of(cls, side: str, cloud: RefinedCloud, changes: Changes, settings: SurfaceChangeSettings) -> "_Found":
        values = {name: own for name, own in changes.point_values(side).items() if name not in PointFigures._fields}
        unobserved = values["unobserved"]
        points, hidden = cloud.own.voxels.points[cloud.fine :], unobserved[cloud.fine :]
        return cls(cloud, values, (cKDTree(points), hidden) if hidden.any() else None, settings)

    def of_voxels(self, number: int, own: ComparedVoxels) -> dict[str, np.ndarray]:
        """The results for each voxel of a block."""
        rows = self.cloud.rows_of(number, len(own.voxels.points))
        fine = rows >= 0
        outside = outside_probability(own.looks_changed, self.settings)
        elsewhere = {"probability": outside, "unobserved": self._hidden(own.voxels, fine)}
        values = {}
        for name, found in self.values.items():
            missing = elsewhere.get(name, MISSING[name])
            values[name] = np.where(fine, found[rows], missing).astype(MISSING[name].dtype)
        hidden = values["unobserved"]
        figures = own.figures._asdict()
        return values | {name: np.where(hidden, np.float32(np.nan), figure) for name, figure in figures.items()}

    def _hidden(self, voxels: Voxels, fine: Bool[np.ndarray, " v"]) -> Bool[np.ndarray, " v"]:
        """Mask of the voxels beyond the fine ones that the other survey did not observe, by the nearest coarse ones."""
        hidden = np.zeros(len(fine), bool)
        if self.unobserved is not None:
            tree, unobserved = self.unobserved
            nearest: Int[np.ndarray, "m 1"] = nearest_neighbours(tree, voxels.points[~fine], 1)[1]
            hidden[~fine] = unobserved[nearest[:, 0]]
        return hidden
