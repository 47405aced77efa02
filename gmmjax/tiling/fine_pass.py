"""The fine pass: changes of the scans at their own resolution wherever something looks changed."""

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax._memory import release_freed_memory
from gmmjax.batch import Workers
from gmmjax.changes import (
    NAMES,
    AlignedScans,
    Changes,
    CheckedCloud,
    Clock,
    Differences,
    Measured,
    Progress,
    ScanVisibility,
    VoxelLattice,
    WorkingCloud,
)
from gmmjax.clouds import ChunkedCloud, PointCloud, ThinnedCloud
from gmmjax.geometry import LocalSurface, transformed
from gmmjax.pair import Pair, each, parallel_map
from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.coarse_pass import CoarsePass
from gmmjax.tiling.compared_blocks import ComparedBlocks, LocalScales, local_scales
from gmmjax.tiling.compute import compute_blocks, tiles_of
from gmmjax.tiling.detection_settings import TiledDetectionSettings
from gmmjax.tiling.local_differences import BlockDifferences, CoarseClouds, block_differences
from gmmjax.tiling.local_voxels import LocalVoxels, Voxels, block_voxels
from gmmjax.tiling.nearest_return import Looks, block_nearest_returns, nearest_returns_of_blocks
from gmmjax.tiling.point_clouds import named_cloud, source_of, uncropped, with_colors
from gmmjax.tiling.records import BlockRecords
from gmmjax.tiling.regions_of_interest import RefinedCloud, refined_clouds
from gmmjax.tiling.row_columns import RowColumns
from gmmjax.tiling.row_results import fill_rows, row_columns


class Tiles(NamedTuple):
    """The blocks of a store, and the workers that compute them.

    Attributes:
        store: of the blocks.
        tile_size: edge of a tile, in the unit of the surveys; None: tiles of about as many points each.
        workers: that compute them.
    """

    store: BlockStore
    tile_size: float | None
    workers: Workers

    @contextlib.contextmanager
    def computing(self) -> Iterator[Callable[..., BlockRecords]]:
        """`compute_blocks` with workers that stay for several tasks and end with the block, since they hold memory."""
        pool = self.workers.pool(len(tiles_of(self.store.tree, self.tile_size)), share_cores=False)
        try:
            yield functools.partial(compute_blocks, self.store, tile_size=self.tile_size, workers=pool)
        finally:
            pool.stop(at_once=False)


class Comparison(NamedTuple):
    """The changes, by the points that were compared in the end.

    Attributes:
        changes: of these points.
        clouds: the points.
        rows: what is said of each row of either survey.
    """

    changes: Changes
    clouds: Pair[PointCloud]
    rows: Pair[RowColumns]


def fine_pass(
    coarse: CoarsePass, lattice: VoxelLattice, tiles: Tiles, clock: Clock, settings: TiledDetectionSettings
) -> Comparison:
    """The changes of the clouds that are fine where something looks changed, and what is said of each row.

    Args:
        coarse: both scans, registered.
        lattice: of the voxels, relative to the store's offset.
        tiles: where their blocks are computed.
        clock: of the progress.
        settings: how fine they are compared.
    """
    detector, prepared, store = coarse.detector, coarse.prepared, tiles.store
    clouds = _coarse_clouds(prepared, store.offset, lattice.voxel_size)
    release_freed_memory()
    clock.start("voxels", "Taking the scans apart", 0.4)
    with tiles.computing() as compute:
        told = _part(clock, "Taking the scans apart", 0.4, 0.5)
        records = compute(block_voxels, (lattice, settings.resolution), progress=told)
        voxels = LocalVoxels.of(records, lattice, settings.resolution.max_voxels)
        clock.start("differences", "Comparing the scans", 0.5)
        arguments = (voxels, clouds, detector.differences, detector.distances)
        found = compute(block_differences, arguments, progress=_part(clock, "Comparing the scans", 0.5, 0.68))
        prepared = _sighted(coarse, compute, store.offset, _part(clock, "Following the lines of sight", 0.68, 0.7))
    differences = BlockDifferences(found)
    scales = local_scales(voxels, differences, prepared.pair.working.spacing, detector.differences)
    clock.start("regions", "Looking for what changed", 0.7)
    blocks = ComparedBlocks(store, voxels, differences, scales, detector.candidates)
    fine = refined_clouds(blocks, clouds, detector.config.threshold, detector.examination, settings.max_refined)
    release_freed_memory()
    refined = _with_points_of(prepared, fine, scales, store.offset)
    release_freed_memory()
    changes = detector.changes_of(refined, clock)
    release_freed_memory()
    changes = _counted(changes, refined, coarse.thinned, coarse.clouds.map(uncropped), voxels.finest)
    clock.start("rows", "Labelling all points", 0.95)
    rows = row_columns(store.folder, store.row_counts)
    first = fill_rows(rows, blocks, fine, changes, detector.objects)
    return Comparison(changes, _given_clouds(refined, first, coarse.clouds), rows)


def _part(clock: Clock, message: str, first: float, last: float) -> Progress:
    return lambda _, share: clock.tell(message, first + (last - first) * share)


def _coarse_clouds(prepared: AlignedScans, offset: Float64[np.ndarray, "3"], voxel_size: float) -> CoarseClouds:
    points = prepared.pair.surfaces.map(lambda surface: surface.points - offset)
    return CoarseClouds(points, voxel_size, prepared.surveys.map(lambda survey: survey.towards - offset))


def _sighted(
    coarse: CoarsePass, compute: Callable[..., BlockRecords], offset: Float64[np.ndarray, "3"], progress: Progress
) -> AlignedScans:
    """The scans, with the nearest points to their sensors in each direction, where these are known."""
    prepared = coarse.prepared
    if all(own.views is None for own in prepared.surveys):
        return prepared
    looks = each(functools.partial(_looks, offset), prepared.surveys, coarse.thinned)
    points = nearest_returns_of_blocks(compute(block_nearest_returns, (looks,), progress=progress))
    surveys = parallel_map(lambda own, seen: own.with_line_of_sight(seen + offset), prepared.surveys, points)
    return dataclasses.replace(prepared, surveys=surveys)


def _looks(offset: Float64[np.ndarray, "3"], survey: ScanVisibility, thinned: ThinnedCloud) -> Looks | None:
    if survey.views is None:
        return None
    return Looks.of(survey.views.relative_to(offset), thinned.total, survey.settings.directions)


def _with_points_of(
    prepared: AlignedScans, fine: Pair[RefinedCloud], scales: LocalScales, offset: Float64[np.ndarray, "3"]
) -> AlignedScans:
    """The scans with the voxels of the refined clouds as their points."""
    voxels = fine.map(lambda own: own.own.voxels)
    points = voxels.map(lambda own: own.points + offset)
    surfaces = parallel_map(LocalSurface.of, points)
    working = dataclasses.replace(prepared.pair.working, clouds=each(_working_cloud, points, voxels))
    pair = prepared.pair._replace(points=points, working=working, surfaces=surfaces)
    differences = Differences(fine.map(lambda own: own.own.local), scales.limits)
    return dataclasses.replace(
        prepared,
        scans=each(lambda own, scan: scan._replace(cloud=own), points, prepared.scans),
        checked=points.map(lambda own: CheckedCloud(own, np.arange(len(own)), len(own), 0)),
        pair=pair,
        coarse=prepared.pair.surfaces.map(lambda surface: surface.points),
        surveys=each(lambda own, surface: dataclasses.replace(own, surface=surface), prepared.surveys, surfaces),
        measured=Measured(differences, fine.map(lambda own: own.own.figures)),
    )


def _working_cloud(points: Float64[np.ndarray, "n 3"], voxels: Voxels) -> WorkingCloud:
    return WorkingCloud(points, voxels.mass, np.arange(len(points)), voxels.sizes)


def _given_clouds(
    refined: AlignedScans, rows: Pair[Int64[np.ndarray, " _"]], clouds: Pair[ChunkedCloud]
) -> Pair[PointCloud]:
    """The points that were compared, each cloud in the frame of its survey, with the colours of its rows."""
    registration, (before, after) = refined.pair.registration, refined.pair.points
    if registration.applied:
        after = transformed(after, np.linalg.inv(registration.transform))
    return parallel_map(_given_cloud, Pair(before, after), rows, clouds)


def _given_cloud(points: Float64[np.ndarray, "n 3"], rows: Int64[np.ndarray, " n"], cloud: ChunkedCloud) -> PointCloud:
    return with_colors(named_cloud(points, rows, cloud), cloud)


def _counted(
    changes: Changes,
    refined: AlignedScans,
    thinned: Pair[ThinnedCloud],
    clouds: Pair[ChunkedCloud],
    finest_voxel_size: float,
) -> Changes:
    """The record with the numbers of the scans' points in place of those of voxels, and the finest voxels compared."""
    counts = np.zeros(len(changes) + 1)
    diagnostics = {**changes.diagnostics, "finest_voxel_size": finest_voxel_size}
    for side, own, scan, cloud in zip(NAMES, refined.pair.working.clouds, thinned, clouds, strict=True):
        counts += np.bincount(getattr(changes, f"labels_{side}") + 1, own.mass, len(counts))
        diagnostics[side] = {**diagnostics[side], "source": source_of(cloud), "points": scan.total}
    items = [
        dataclasses.replace(change, point_count=int(count)) for change, count in zip(changes, counts[1:], strict=True)
    ]
    return dataclasses.replace(changes, items=tuple(items), diagnostics=diagnostics)
