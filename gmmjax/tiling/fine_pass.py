"""The fine pass: what changed, by the scans at their own resolution wherever something looks changed."""

import contextlib
import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax._memory import release_freed_memory
from gmmjax.batch import AbstractPool, Workers
from gmmjax.changes import (
    NAMES,
    AlignedScans,
    Changes,
    CheckedCloud,
    Clock,
    Differences,
    Measured,
    Progress,
    Survey,
    WorkingCloud,
)
from gmmjax.clouds import ChunkedCloud, PointCloud, ThinnedCloud
from gmmjax.geometry import LocalSurface, transformed
from gmmjax.pair import Pair, each, each_on_cores
from gmmjax.tiling.coarse_pass import CoarsePass, Place
from gmmjax.tiling.compared_blocks import ComparedBlocks
from gmmjax.tiling.compute import columns_of, compute_blocks
from gmmjax.tiling.detection_settings import TiledDetectionSettings
from gmmjax.tiling.disk_store import DiskBlockStore
from gmmjax.tiling.local_differences import BlockDifferences, CoarseClouds, block_differences
from gmmjax.tiling.local_scales import LocalScales, local_scales
from gmmjax.tiling.local_voxels import LocalVoxels, Voxels, block_voxels
from gmmjax.tiling.point_clouds import named_cloud, source_of, uncropped, with_colors
from gmmjax.tiling.records import BlockRecords
from gmmjax.tiling.regions_of_interest import RefinedCloud, refined_clouds
from gmmjax.tiling.row_results import MISSING, RowResults, fill_rows
from gmmjax.tiling.seen_first import Looks, block_seen_first, seen_first_of_blocks
from gmmjax.tiling.tiles import TileSettings, tiles_of
from gmmjax.tiling.worker import BlockTask


@dataclasses.dataclass(frozen=True, eq=False)
class Tiles:
    """Where blocks are computed.

    Attributes:
        store: of the blocks.
        tile_size: edge of a tile, in the unit of the surveys; None: tiles of about as many points each.
        workers: that compute them; those of a pool stay for the next task.
        settings: how blocks are put together.
    """

    store: DiskBlockStore
    tile_size: float | None
    workers: Workers | AbstractPool
    settings: TileSettings

    @contextlib.contextmanager
    def with_kept_workers(self) -> Iterator["Tiles"]:
        """The same, whose workers start once for several tasks and end with the block of code: they hold memory."""
        if isinstance(self.workers, AbstractPool):
            yield self
            return
        pool = self.workers.pool(len(tiles_of(self.store.tree, self.tile_size, self.settings)), share_cores=False)
        try:
            yield dataclasses.replace(self, workers=pool)
        finally:
            pool.stop(at_once=False)

    def compute(self, task: BlockTask, arguments: tuple[Any, ...], progress: Progress) -> BlockRecords:
        """What a task says of every block."""
        return compute_blocks(
            self.store,
            task,
            arguments,
            tile_size=self.tile_size,
            workers=self.workers,
            progress=progress,
            settings=self.settings,
        )


class Comparison(NamedTuple):
    """What was found, by the points that were compared in the end.

    Attributes:
        changes: of these points.
        clouds: the points.
        rows: what is said of each row.
    """

    changes: Changes
    clouds: Pair[PointCloud]
    rows: RowResults


def fine_pass(
    coarse: CoarsePass, place: Place, tiles: Tiles, clock: Clock, settings: TiledDetectionSettings
) -> Comparison:
    """The changes of the clouds that are fine where something looks changed, and what is said of each row.

    Args:
        coarse: both scans, registered.
        place: the grids that they are taken apart by.
        tiles: where their blocks are computed.
        clock: of the progress.
        settings: how fine they are compared.
    """
    detector, prepared, store = coarse.detector, coarse.prepared, tiles.store
    clouds = _coarse_clouds(prepared, store.offset, place.voxels.voxel_size)
    release_freed_memory()
    clock.start("voxels", "Taking the scans apart", 0.4)
    with tiles.with_kept_workers() as kept:
        records = kept.compute(
            block_voxels, (place.voxels, settings.resolution), _part(clock, "Taking the scans apart", 0.4, 0.5)
        )
        voxels = LocalVoxels.of(records, place.voxels, settings.resolution.most_voxels)
        clock.start("differences", "Comparing the scans", 0.5)
        arguments = (voxels, clouds, settings.differences, detector.differences, detector.distances)
        found = kept.compute(block_differences, arguments, _part(clock, "Comparing the scans", 0.5, 0.68))
        seen_first = _seen_first(coarse, kept, clock)
    differences = BlockDifferences(found)
    scales = local_scales(voxels, differences, prepared.pair.working.spacing, detector.differences, settings.scales)
    clock.start("regions", "Looking for what changed", 0.7)
    blocks = ComparedBlocks(store, voxels, differences, scales, detector.candidates)
    fine = refined_clouds(blocks, clouds, detector.config.threshold, detector.examination, settings.regions)
    release_freed_memory()
    refined = _with_points_of(_sighted(prepared, seen_first, store.offset), fine, scales, store.offset)
    release_freed_memory()
    changes = detector.changes_of(refined, clock)
    release_freed_memory()
    changes = _counted(changes, refined, coarse.thinned, place.clouds.clouds.map(uncropped), voxels.finest)
    clock.start("rows", "Labelling all points", 0.95)
    rows = RowResults(columns_of(store, MISSING))
    first = fill_rows(rows, blocks, fine, changes, detector.objects)
    return Comparison(changes, _given_clouds(refined, first, place.clouds.clouds), rows)


def _part(clock: Clock, message: str, first: float, last: float) -> Progress:
    return lambda _, share: clock.tell(message, first + (last - first) * share)


def _coarse_clouds(prepared: AlignedScans, offset: Float64[np.ndarray, "3"], voxel_size: float) -> CoarseClouds:
    points = prepared.pair.surfaces.map(lambda surface: surface.points - offset)
    return CoarseClouds(points, voxel_size, prepared.surveys.map(lambda survey: survey.towards - offset))


def _seen_first(coarse: CoarsePass, tiles: Tiles, clock: Clock) -> BlockRecords | None:
    """What the sensors saw first in each direction, block by block; None where none of them is known."""
    prepared, offset = coarse.prepared, tiles.store.offset
    if all(own.views is None for own in prepared.surveys):
        return None

    def looks(own: Survey, thinned: ThinnedCloud) -> Looks | None:
        if own.views is None:
            return None
        return Looks.of(own.views.relative_to(offset), thinned.total, own.settings.directions)

    arguments = (each(looks, prepared.surveys, coarse.thinned),)
    return tiles.compute(block_seen_first, arguments, _part(clock, "Following the lines of sight", 0.68, 0.7))


def _sighted(prepared: AlignedScans, seen_first: BlockRecords | None, offset: Float64[np.ndarray, "3"]) -> AlignedScans:
    """The scans, with what their sensors saw first in each direction."""
    if seen_first is None:
        return prepared
    points = seen_first_of_blocks(seen_first)
    surveys = each_on_cores(lambda own, seen: own.sighted_by(seen + offset), prepared.surveys, points)
    return dataclasses.replace(prepared, surveys=surveys)


def _with_points_of(
    prepared: AlignedScans, fine: Pair[RefinedCloud], scales: LocalScales, offset: Float64[np.ndarray, "3"]
) -> AlignedScans:
    """The scans with the voxels of the refined clouds as their points."""
    voxels = fine.map(lambda own: own.own.voxels)
    points = voxels.map(lambda own: own.points + offset)
    surfaces = each_on_cores(LocalSurface.of, points)
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

    def given(points: Float64[np.ndarray, "n 3"], rows: Int64[np.ndarray, " n"], cloud: ChunkedCloud) -> PointCloud:
        return with_colors(named_cloud(points, rows, cloud), cloud)

    return each_on_cores(given, Pair(before, after), rows, clouds)


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
