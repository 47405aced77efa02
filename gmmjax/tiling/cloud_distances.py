"""The M3C2 distance at every point of two scans of any size, with its level of detection."""

import dataclasses
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from gmmjax.batch import Workers
from gmmjax.changes import M3C2Settings, common_unit, m3c2_distances
from gmmjax.clouds import (
    AbstractBlockStore,
    Block,
    BlockPoints,
    BlockSettings,
    PlacedClouds,
    require_overlap,
    tree_of,
    voxel_grid,
)
from gmmjax.errors import InputError
from gmmjax.geometry import PLANE_NEIGHBOURS, local_planes, nearest_neighbours, within_box
from gmmjax.pair import Pair, each
from gmmjax.tiling.compute import columns_of, compute_blocks
from gmmjax.tiling.disk_store import temporary_block_store
from gmmjax.tiling.records import BlockResult
from gmmjax.tiling.row_columns import RowColumns
from gmmjax.tiling.tiles import TileSettings, tiles_of


@dataclasses.dataclass(frozen=True)
class DistanceSettings:
    """The cylinders along the normals, by the voxel size of each block or of one size everywhere.

    Attributes:
        radius: of the cylinders, in the unit of the clouds; None: by the voxels there.
        depth: half length of the cylinders, likewise.
        radius_voxels: radius in voxels, where none is given. Small: few points to average over; large: what is smaller
            is averaged away.
        depth_voxels: half length in voxels, where none is given. Short: a surface that moved further has no distance;
            long: another surface behind it is mixed in.
        registration_error: standard deviation, in the unit of the clouds. 0: the level of detection is that of the
            points' scatter alone.
    """

    radius: float | None = None
    depth: float | None = None
    radius_voxels: float = 1.5
    depth_voxels: float = 10.0
    registration_error: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius", "depth"):
            length = getattr(self, name)
            if length is not None and not 0 < length < np.inf:
                raise InputError(f"{name}={length} must be positive and finite, in the unit of the scans")
        if not 0 <= self.registration_error < np.inf:
            raise InputError(f"registration_error={self.registration_error} must be 0 or positive, and finite")

    def cylinder(self, block: Block) -> tuple[float, float]:
        """Radius and half length of the cylinders of a block."""
        radius = self.radius_voxels * block.voxel_size if self.radius is None else self.radius
        return radius, self.depth_voxels * block.voxel_size if self.depth is None else self.depth


class TiledDistances(NamedTuple):
    """The distances at all points of two scans.

    Attributes:
        columns: `distance` (from the before to the after surface, positive towards the sensor or upwards),
            `level_of_detection` and `significance` of each row of either cloud, in the unit of the clouds; NaN where
            there is nothing to compare with.
        compared: number of points of either cloud with a distance.
        significant: number of those whose distance is beyond its level of detection.
    """

    columns: Pair[RowColumns]
    compared: Pair[int]
    significant: Pair[int]


_MISSING = {name: np.float32(np.nan) for name in ("distance", "level_of_detection", "significance")}


@contextmanager
def distances(
    clouds: PlacedClouds,
    *,
    settings: DistanceSettings = DistanceSettings(),
    positions: Pair[Float64[np.ndarray, "_ 3"] | None] = Pair(None, None),
    tile_size: float | None = None,
    workers: Workers = Workers(),
    folder: str | os.PathLike[str] | None = None,
    progress: Callable[[str, float], None] | None = None,
    blocks: BlockSettings = BlockSettings(),
    tiles: TileSettings = TileSettings(),
) -> Iterator[TiledDistances]:
    """The M3C2 distance at every point of two scans of any size; what is kept on disk is removed in the end.

        with distances(PlacedClouds(Pair(open_cloud("before.laz"), open_cloud("after.laz")))) as found:
            print(found.significant)
            for rows in found.columns.after.slices():
                ...

    Args:
        clouds: both, and the transform between them.
        settings: of the cylinders.
        positions: of either cloud's sensors, in the before frame: a normal points to the nearest one; None: upwards.
        tile_size: edge of the tiles, in the unit of the clouds; None: tiles of about as many points each.
        workers: where tiles are computed.
        folder: in which a temporary one is made, on a disk with room for some 60 bytes a point; None: the system's
            folder for temporary files.
        progress: called with a message and the share of the work that is done.
        blocks: settings of the blocks.
        tiles: settings of the tiles.

    Yields:
        The distances.

    Raises:
        InputError: scans without points, that do not overlap, or whose files state two units or reference systems; a
            tile size below ten point spacings, a file that cannot be read, a folder that cannot be written, or a full
            disk.
        ComputationError: a worker died twice with the same tile, or there are no workers any more.
    """
    common_unit(clouds.clouds)
    tree = tree_of(clouds, blocks)
    require_overlap(tree)
    tiles_of(tree, tile_size, tiles)
    with temporary_block_store(clouds, tree, folder) as store:
        columns = columns_of(store, _MISSING)
        relative = positions.map(lambda own: None if own is None else own - store.offset)
        records = compute_blocks(
            store,
            block_distances,
            (settings, relative),
            columns=columns,
            tile_size=tile_size,
            workers=workers,
            progress=progress,
            settings=tiles,
        )
        compared, significant = np.sum([result.values["numbers"] for _, result in records], axis=0)
        if not compared.any():
            raise InputError(
                "before, after: no point has points of the other scan in its cylinder; register the scans, or give a "
                "larger depth"
            )
        yield TiledDistances(columns, Pair(*compared.tolist()), Pair(*significant.tolist()))


def block_distances(
    store: AbstractBlockStore, block: Block, settings: DistanceSettings, positions: Pair[np.ndarray | None]
) -> BlockResult:
    """The distances at the points of a block, a `BlockTask`; its value is how many are there, and how many significant.

    Args:
        store: of the block.
        block: one of the store's.
        settings: of the cylinders.
        positions: of either cloud's sensors, relative to the offset; None: normals point upwards.
    """
    cylinder = M3C2Settings(*settings.cylinder(block))
    found = store.points_of(block, max(cylinder.reach, _reach_of_planes(block)))
    clouds = found.map(lambda own: own.points)

    def of_cloud(own: BlockPoints, positions: np.ndarray | None) -> dict[str, np.ndarray]:
        if not own.inside.any():
            return {name: np.empty(0, np.float32) for name in _MISSING}
        normals = _normals(own, block, store.tree.lattice.edge, positions)
        at_points = m3c2_distances(own.points[own.inside], normals, clouds, cylinder, settings.registration_error)
        return {name: getattr(at_points, name).astype(np.float32) for name in _MISSING}

    rows = each(of_cloud, found, positions)
    compared = [int(np.isfinite(own["distance"]).sum()) for own in rows]
    significant = [int((np.abs(own["distance"]) > own["level_of_detection"]).sum()) for own in rows]
    return BlockResult({"numbers": np.array([compared, significant])}, rows)


def _normals(
    points: BlockPoints, block: Block, extent: float, positions: np.ndarray | None
) -> Float64[np.ndarray, "n 3"]:
    """The normal at each point inside of a block: of the plane through the means of the voxels around its own."""
    reach = _reach_of_planes(block)
    count = int(points.inside.sum())
    margin = points.points[count:]
    near = margin[within_box(margin, block.lower - reach, block.lower + block.edge + reach)]
    voxels = voxel_grid(np.concatenate([points.points[:count], near]), block.voxel_size)
    own, voxel = np.unique(voxels.voxel_of_point[:count], return_inverse=True)
    means = voxels.points[own]
    neighbours = nearest_neighbours(cKDTree(voxels.points), means, PLANE_NEIGHBOURS)[1]
    normals = local_planes(voxels.points.take(neighbours, axis=0))[1]
    towards = np.array([extent, extent, 3 * extent]) / 2 if positions is None else _nearest(positions, means)
    away = ((towards - means) * normals).sum(axis=1) < 0
    return np.where(away[:, None], -normals, normals)[voxel]


def _reach_of_planes(block: Block) -> float:
    """How far the voxels that a plane goes through are from the block."""
    return float((PLANE_NEIGHBOURS**0.5 + 1) * block.voxel_size)


def _nearest(positions: np.ndarray, places: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
    return np.asarray(positions[cKDTree(positions).query(places)[1]])
