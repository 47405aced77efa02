"""What is said of each row of both surveys, from what was found of the voxels that their points are in."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import cKDTree

from gmmjax.changes import NAMES, Changes, PointFigures, SurfaceChangeSettings, outside_probability
from gmmjax.clouds import StoredPoints
from gmmjax.geometry import nearest_neighbours
from gmmjax.pair import Pair, each_on_cores
from gmmjax.tiling.compared_blocks import ComparedBlocks, ComparedVoxels
from gmmjax.tiling.local_voxels import Voxels
from gmmjax.tiling.regions_of_interest import RefinedCloud
from gmmjax.tiling.row_columns import FilledInBatches, RowColumns

MISSING: Mapping[str, np.generic] = {
    "label": np.int32(-1),
    "kind": np.uint8(0),
    "probability": np.float32(0),
    "unobserved": np.bool_(False),
    **{name: np.float32(np.nan) for name in PointFigures._fields},
}
"""The columns, with the values of rows that were not compared: without a position, outside the crop box, or stray."""


@dataclasses.dataclass(frozen=True, eq=False)
class RowResults:
    """What is said of each row.

    Attributes:
        columns: of either survey, by the names of `MISSING`.
    """

    columns: Pair[RowColumns]

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of `Changes`, as maps of files."""
        names = {"labels": "label", **{name: name for name in MISSING if name not in ("label", "kind")}}
        return {
            f"{array}_{side}": own.column(name)
            for side, own in zip(NAMES, self.columns, strict=True)
            for array, name in names.items()
        }

    def found(self) -> Pair[dict[str, np.ndarray]]:
        """The values of each row by name, as maps of files: what is written beside the points of a scan."""

        def of_cloud(columns: RowColumns) -> dict[str, np.ndarray]:
            values = {name: columns.column(name) for name in MISSING}
            # Files of points have no truth values.
            return values | {"unobserved": values["unobserved"].view(np.uint8)}

        return self.columns.map(of_cloud)


def fill_rows(
    results: RowResults,
    blocks: ComparedBlocks,
    fine: Pair[RefinedCloud],
    changes: Changes,
    settings: SurfaceChangeSettings,
) -> Pair[Int[np.ndarray, " _"]]:
    """Fills the columns, block by block.

    Args:
        results: to fill.
        blocks: of both clouds, compared.
        fine: the clouds that the changes were found in.
        changes: of these clouds.
        settings: how probable points outside of changes are.

    Returns:
        For each voxel of these clouds the first row that is in it; for a coarse one, that is in the voxel next to it.
    """

    def fill(side: str, columns: RowColumns, own: RefinedCloud) -> Int[np.ndarray, " _"]:
        found, filling = _Found.of(side, own, changes, settings), FilledInBatches(columns)
        first = np.full(len(own.own.looks_changed), columns.count)
        for number in range(len(blocks.store.tree)):
            inside: StoredPoints = getattr(blocks.store.inside(number), side)
            member: Int[np.ndarray, " n"] = getattr(blocks.voxels.members(number), side)
            voxels = blocks.side(number, side)
            values = found.of_voxels(number, voxels)
            filling.fill(inside.rows, {name: array[member] for name, array in values.items()})
            of_voxels = np.full(len(voxels.looks_changed), columns.count)
            np.minimum.at(of_voxels, member, inside.rows)
            _take_first_rows(first, own, number, of_voxels)
        filling.flush()
        return first

    return each_on_cores(fill, NAMES, results.columns, fine)


def fill_rows_of_points(results: RowResults, changes: Changes, rows: Pair[Int[np.ndarray, " _"]]) -> None:
    """Fills the columns with what was found of all points, in memory.

    Args:
        results: to fill.
        changes: of these points.
        rows: of each point.
    """
    for side, columns, own in zip(NAMES, results.columns, rows, strict=True):
        columns.fill(own, changes.point_values(side))


def _take_first_rows(
    first: Int[np.ndarray, " m"],
    cloud: RefinedCloud,
    number: int,
    of_voxels: Int[np.ndarray, " v"],
) -> None:
    """Lowers the first row of each voxel of a cloud to those of the voxels of a block.

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
    """What was found of one cloud.

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
        """What is said of each voxel of a block."""
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
        """Which voxels beyond the fine ones the other survey did not observe: those next to coarse ones of which."""
        hidden = np.zeros(len(fine), bool)
        if self.unobserved is not None:
            tree, unobserved = self.unobserved
            nearest: Int[np.ndarray, "m 1"] = nearest_neighbours(tree, voxels.points[~fine], 1)[1]
            hidden[~fine] = unobserved[nearest[:, 0]]
        return hidden
