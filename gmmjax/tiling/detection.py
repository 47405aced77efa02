"""What changed between two surveys of any size: `detect_changes` out of core.

Two passes. The coarse one thins both scans to what fits into memory, registers them and fits the mixture. The fine one
compares the scans at their own resolution block by block, takes what lies around all that looks changed at that
resolution, and lets the stages after it see these voxels there and the coarse clouds elsewhere.
"""

import dataclasses
import itertools
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.changes import (
    NAMES,
    AlignedScans,
    Changes,
    CheckedCloud,
    Clock,
    DetectionConfig,
    Differences,
    JointDetector,
    LocalResolutionSettings,
    Measured,
    Progress,
    Scan,
    Survey,
    VoxelLattice,
    WorkingCloud,
    common_unit,
    sensor_places,
    silent,
)
from gmmjax.clouds import (
    BlockSettings,
    ChunkedCloud,
    CloudFile,
    CroppedCloud,
    Lattice,
    PlacedClouds,
    PointCloud,
    SensorViews,
    SurveyFiles,
    ThinnedCloud,
    read_both,
    require_overlap,
    thinned_cloud,
    tree_of,
)
from gmmjax.errors import InputError, recorded_warnings
from gmmjax.geometry import LocalSurface, transformed
from gmmjax.pair import Pair, each, each_on_cores
from gmmjax.tiling.compared_blocks import ComparedBlocks
from gmmjax.tiling.compute import columns_of, compute_blocks
from gmmjax.tiling.disk_store import DiskBlockStore, write_block_store
from gmmjax.tiling.folder import working_folder
from gmmjax.tiling.local_differences import (
    BlockDifferences,
    CoarseClouds,
    LocalDifferenceSettings,
    block_differences,
)
from gmmjax.tiling.local_scales import LocalScales, LocalScaleSettings, local_scales
from gmmjax.tiling.local_voxels import LocalVoxels, Voxels, block_voxels
from gmmjax.tiling.records import BlockRecords
from gmmjax.tiling.regions_of_interest import RefinedCloud, RegionsOfInterestSettings, refined_clouds
from gmmjax.tiling.row_columns import RowColumns
from gmmjax.tiling.row_results import MISSING, RowResults, fill_rows, fill_rows_of_points
from gmmjax.tiling.seen_first import Looks, block_seen_first, seen_first_of_blocks
from gmmjax.tiling.tiles import TileSettings, tiles_of
from gmmjax.tiling.worker import BlockTask
from gmmjax.tiling.workers import Workers

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class TiledDetectionSettings:
    """How scans of any size are compared; what is found in them depends on the detector's settings.

    Attributes:
        thinned: voxels of either cloud that are kept in memory for the coarse pass. Fewer than the registration takes:
            it is less exact; more: memory.
        largest_voxel: edge of the largest voxels where scans are so sparse that the coarse pass takes all their points,
            in spacings. Small: what is sparser than most of a scan is compared in voxels of single points.
        most_points: of both clouds in a block. Few: more is margin; many: more memory for each worker.
        resolution: how small the voxels are. Its `most_voxels` is a bound on time, about ten seconds of one core for a
            million: fewer, and dense scans are compared at less than their resolution.
        differences: what the voxels of a block are compared with.
        scales: what the limits are computed from.
        regions: how much is taken at full resolution around what looks changed.
        tiles: how blocks are put together.
    """

    thinned: int = 400_000
    largest_voxel: float = 2.0
    most_points: int = 1_000_000
    resolution: LocalResolutionSettings = LocalResolutionSettings(most_voxels=4_000_000)
    differences: LocalDifferenceSettings = LocalDifferenceSettings()
    scales: LocalScaleSettings = LocalScaleSettings()
    regions: RegionsOfInterestSettings = RegionsOfInterestSettings()
    tiles: TileSettings = TileSettings()


@dataclasses.dataclass(frozen=True, eq=False)
class TiledChanges:
    """What changed between two surveys of any size.

    Attributes:
        changes: the record, whose arrays for each row of the surveys are maps of files that are there as long as the
            block of code of `tiled_changes`.
        shown: the same changes of the points that were compared in the end, fine where something looks changed and
            coarse elsewhere: what reports and figures show.
        clouds: these points, either cloud in the frame of its survey.
        rows: of either survey, with the kind of change (0 for none), and all that `changes` has.
    """

    changes: Changes
    shown: Changes
    clouds: Pair[PointCloud]
    rows: RowResults


@contextmanager
def tiled_changes(
    clouds: Pair[ChunkedCloud],
    *,
    config: DetectionConfig = DetectionConfig(),
    views: Pair[SensorViews | None] = Pair(None, None),
    tile_size: float | None = None,
    workers: Workers = Workers(),
    folder: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    settings: TiledDetectionSettings = TiledDetectionSettings(),
) -> Iterator[TiledChanges]:
    """What changed between two surveys of any size, and how sure that is.

    The result is the same whatever the tiles, the number of workers and their order. A script that calls it needs
    `if __name__ == "__main__":`, as for every function that starts processes.

    Args:
        clouds: of both surveys, such as of `open_cloud` and `open_survey`, in one unit and about one frame.
        config: as of `detect_changes`; its method is "joint", without `voxel_size`.
        views: where the sensors stood, each in the frame of its survey; None: not known.
        tile_size: edge of a tile, in the unit of the surveys; None: tiles of about as many points each. A larger tile
            is more memory for a worker.
        workers: where tiles are computed.
        folder: in which a temporary one is made, on a disk with room for some 150 bytes a point; None: the system's
            folder for temporary files.
        progress: called with the name of the stage and the share of the work that is done, from any thread.
        settings: how scans are taken apart.

    Yields:
        The changes.

    Raises:
        InputError: surveys, views or settings that cannot be used: without points, that do not overlap, that state two
            units or reference systems, that fill volumes; a tile size below ten point spacings; a file that cannot be
            read, a folder that cannot be written, or a full disk.
        ComputationError: no restart gave a mixture; a worker died twice with the same tile, or there are no workers any
            more.

    Warns:
        InputWarning: as of `detect_changes`.
    """
    _check(config)
    clock = Clock(progress or silent)
    # First of all, so that a folder that cannot be written is told before the work.
    with working_folder(folder) as disk, recorded_warnings() as warnings:
        unit = common_unit(clouds, config)
        coarse = _coarse_pass(clouds, views, config, clock, settings)
        place = _placed(coarse, clouds, config, settings)
        tree = tree_of(place.clouds, _block_settings(settings), place.lattice)
        require_overlap(tree)
        tiles_of(tree, tile_size, settings.tiles)
        clock.start("tiles", "Sorting the points into blocks", 0.3)
        if max(place.clouds.row_counts) <= coarse.detector.align.resolution.voxels:
            found = _compared_whole(place.clouds, views, config, disk, clock)
        else:
            tiles = _Tiles(write_block_store(place.clouds, tree, disk), tile_size, workers, settings.tiles)
            found = _fine_pass(coarse, place, tiles, clock, settings)
        shown = dataclasses.replace(found.changes, unit=unit, warnings=tuple(warnings))
        arrays: dict[str, Any] = found.rows.arrays()
        changes = dataclasses.replace(shown, **arrays)
        clock.finish()
        yield TiledChanges(changes, dataclasses.replace(shown, clouds=found.clouds), found.clouds, found.rows)


def _check(config: DetectionConfig) -> None:
    if config.method != "joint":
        raise InputError(f"method={config.method}: only 'joint' compares scans in tiles; leave the tiles out")
    if config.voxel_size is not None:
        raise InputError("voxel_size: in tiles the voxels are as small as the scans allow at each place; leave it out")


@dataclasses.dataclass(frozen=True, eq=False)
class _CoarsePass:
    """Both scans, thinned and registered.

    Attributes:
        detector: by which they are compared.
        thinned: as they were given.
        prepared: registered.
    """

    detector: JointDetector
    thinned: Pair[ThinnedCloud]
    prepared: AlignedScans

    @property
    def transform(self) -> Float64[np.ndarray, "4 4"] | None:
        """What takes the after cloud into the frame of the before cloud; None: it is in it."""
        registration = self.prepared.pair.registration
        return registration.transform if registration.applied else None


def _coarse_pass(
    clouds: Pair[ChunkedCloud],
    views: Pair[SensorViews | None],
    config: DetectionConfig,
    clock: Clock,
    settings: TiledDetectionSettings,
) -> _CoarsePass:
    clock.start("reading", "Reading the scans", 0.0)
    inside = clouds.map(lambda own: _cropped(own, config))
    thinned = read_both(lambda chunks: thinned_cloud(chunks, settings.thinned), inside.map(lambda own: own.chunks()))
    for side, own in zip(NAMES, thinned, strict=True):
        if not own.total:
            raise InputError(f"{side}: has no points{' inside the crop box' * (config.crop is not None)}")
    detector = JointDetector(config, resolution=None)
    scans = each(lambda own, known: Scan(own.points, known), thinned, views)
    prepared = detector.prepared(scans, clock)
    if prepared.volumetric:
        raise InputError(
            "before, after: the clouds fill volumes, as artificial mixtures do, and are no scans of surfaces; compare "
            "fewer of their points, without tiles"
        )
    return _CoarsePass(detector, thinned, prepared)


def _cropped(cloud: ChunkedCloud, config: DetectionConfig) -> ChunkedCloud:
    if config.crop is None:
        return cloud
    return CroppedCloud(cloud, np.array(config.crop[:3]), np.array(config.crop[3:]))


@dataclasses.dataclass(frozen=True, eq=False)
class _Place:
    """Both clouds in one frame, and the grids that they are taken apart by.

    Attributes:
        clouds: both.
        lattice: of the blocks.
        voxels: of the voxels, relative to the offset.
    """

    clouds: PlacedClouds
    lattice: Lattice
    voxels: VoxelLattice


def _placed(
    coarse: _CoarsePass, clouds: Pair[ChunkedCloud], config: DetectionConfig, settings: TiledDetectionSettings
) -> _Place:
    """Where the blocks begin: whole numbers of the cubes whose voxels are halved or not, as far as they are larger."""
    resolution, working = settings.resolution, coarse.prepared.pair.working
    voxel_size = working.voxel_size or settings.largest_voxel * working.spacing
    corners = _corners(coarse)
    lower = corners.min(axis=0) - voxel_size
    extent = float((corners.max(axis=0) - lower).max()) + voxel_size
    cube = resolution.voxels_per_edge * voxel_size
    edge = float(cube * 2.0 ** max(0, np.ceil(np.log2(extent / cube))))
    placed = PlacedClouds(clouds.map(lambda own: _cropped(own, config)), coarse.transform)
    return _Place(placed, Lattice(lower, edge), VoxelLattice.of(np.zeros(3), edge, voxel_size, resolution.halvings))


def _corners(coarse: _CoarsePass) -> Float64[np.ndarray, "16 3"]:
    """The corners of the boxes of both clouds, in the frame of the before cloud."""
    boxes = coarse.thinned.map(lambda own: np.array(list(itertools.product(*np.array(own.bounds).T))))
    after = boxes.after if coarse.transform is None else transformed(boxes.after, coarse.transform)
    return np.concatenate([boxes.before, after])


def _block_settings(settings: TiledDetectionSettings) -> BlockSettings:
    """Blocks by their number of points alone: their voxels are chosen later."""
    return BlockSettings(finest_voxel=np.inf, most_points=float(settings.most_points))


@dataclasses.dataclass(frozen=True, eq=False)
class _Tiles:
    """Where blocks are computed."""

    store: DiskBlockStore
    tile_size: float | None
    workers: Workers
    settings: TileSettings

    def compute(self, task: BlockTask, arguments: tuple[Any, ...], progress: Progress) -> BlockRecords:
        return compute_blocks(
            self.store,
            task,
            arguments,
            tile_size=self.tile_size,
            workers=self.workers,
            progress=progress,
            settings=self.settings,
        )


class _Comparison(NamedTuple):
    """What was found, by the points that were compared in the end.

    Attributes:
        changes: of these points.
        clouds: the points.
        rows: what is said of each row.
    """

    changes: Changes
    clouds: Pair[PointCloud]
    rows: RowResults


def _compared_whole(
    clouds: PlacedClouds, views: Pair[SensorViews | None], config: DetectionConfig, disk: Path, clock: Clock
) -> _Comparison:
    """The changes of scans that have no more points than it takes to register them: those that are found in memory."""
    points = clouds.clouds.map(_all_points)
    scans = each(Scan, points, views)
    detector = JointDetector(config)
    changes = detector.changes_of(detector.prepared(scans, clock), clock)
    rows = RowResults(each(lambda side, count: RowColumns(disk / side, count, MISSING), NAMES, clouds.row_counts))
    fill_rows_of_points(rows, changes, points.map(lambda own: own.rows))
    return _Comparison(changes, points, rows)


def _all_points(cloud: ChunkedCloud) -> PointCloud:
    points, rows, _ = zip(*cloud.chunks(), strict=True)
    return _named_cloud(np.concatenate(points), np.concatenate(rows), cloud)


def _fine_pass(
    coarse: _CoarsePass, place: _Place, tiles: _Tiles, clock: Clock, settings: TiledDetectionSettings
) -> _Comparison:
    """The changes of the clouds that are fine where something looks changed, and what is said of each row."""
    detector, prepared, store = coarse.detector, coarse.prepared, tiles.store
    clouds = _coarse_clouds(prepared, store.offset, place.voxels.voxel_size)
    clock.start("voxels", "Taking the scans apart", 0.4)
    records = tiles.compute(
        block_voxels, (place.voxels, settings.resolution), _part(clock, "Taking the scans apart", 0.4, 0.5)
    )
    voxels = LocalVoxels.of(records, place.voxels, settings.resolution.most_voxels)
    clock.start("differences", "Comparing the scans", 0.5)
    arguments = (voxels, clouds, settings.differences, detector.differences, detector.distances)
    found = tiles.compute(block_differences, arguments, _part(clock, "Comparing the scans", 0.5, 0.7))
    differences = BlockDifferences(found)
    scales = local_scales(voxels, differences, prepared.pair.working.spacing, detector.differences, settings.scales)
    clock.start("regions", "Looking for what changed", 0.7)
    blocks = ComparedBlocks(store, voxels, differences, scales, detector.candidates)
    fine = refined_clouds(blocks, clouds, detector.config.threshold, detector.examination, settings.regions)
    refined = _with_points_of(_sighted(coarse, tiles, clock), fine, scales, store.offset)
    changes = detector.changes_of(refined, clock)
    changes = _counted(changes, refined, coarse.thinned, place.clouds.clouds.map(_whole))
    clock.start("rows", "Labelling all points", 0.95)
    rows = RowResults(columns_of(store, MISSING))
    fill_rows(rows, blocks, fine, changes, detector.objects.surfaces)
    return _Comparison(changes, _given_clouds(refined, place.clouds.clouds), rows)


def _part(clock: Clock, message: str, first: float, last: float) -> Progress:
    return lambda _, share: clock.tell(message, first + (last - first) * share)


def _coarse_clouds(prepared: AlignedScans, offset: Float64[np.ndarray, "3"], voxel_size: float) -> CoarseClouds:
    points = prepared.pair.surfaces.map(lambda surface: surface.points - offset)
    towards = each(lambda survey, own: sensor_places(_moved_by(survey.views, offset), own), prepared.surveys, points)
    return CoarseClouds(points, voxel_size, towards)


def _sighted(coarse: _CoarsePass, tiles: _Tiles, clock: Clock) -> AlignedScans:
    """The scans, with what their sensors saw first in each direction where they are known."""
    prepared, offset = coarse.prepared, tiles.store.offset
    if all(own.views is None for own in prepared.surveys):
        return prepared

    def looks(own: Survey, thinned: ThinnedCloud) -> Looks | None:
        views = _moved_by(own.views, offset)
        return None if views is None else Looks.of(views, thinned.total, own.settings.directions)

    arguments = (each(looks, prepared.surveys, coarse.thinned),)
    records = tiles.compute(block_seen_first, arguments, _part(clock, "Following the lines of sight", 0.7, 0.72))
    points = seen_first_of_blocks(records)
    surveys = each(lambda own, seen: own.sighted_by(seen + offset), prepared.surveys, points)
    return dataclasses.replace(prepared, surveys=surveys)


def _moved_by(views: SensorViews | None, offset: Float64[np.ndarray, "3"]) -> SensorViews | None:
    shift = np.eye(4)
    shift[:3, 3] = -offset
    return None if views is None else views.moved(shift)


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
        scans=each(lambda own, scan: Scan(own, scan.views), points, prepared.scans),
        checked=points.map(lambda own: CheckedCloud(own, np.arange(len(own)), len(own), 0)),
        pair=pair,
        coarse=prepared.pair.surfaces.map(lambda surface: surface.points),
        surveys=each(lambda own, surface: dataclasses.replace(own, surface=surface), prepared.surveys, surfaces),
        measured=Measured(differences, fine.map(lambda own: own.own.figures)),
    )


def _working_cloud(points: Float64[np.ndarray, "n 3"], voxels: Voxels) -> WorkingCloud:
    return WorkingCloud(points, voxels.mass, np.arange(len(points)), voxels.sizes)


def _given_clouds(refined: AlignedScans, clouds: Pair[ChunkedCloud]) -> Pair[PointCloud]:
    """The points that were compared, each cloud in the frame of its survey."""
    registration, (before, after) = refined.pair.registration, refined.pair.points
    if registration.applied:
        after = transformed(after, np.linalg.inv(registration.transform))

    def given(points: Float64[np.ndarray, "n 3"], cloud: ChunkedCloud) -> PointCloud:
        return _named_cloud(points, np.arange(len(points)), cloud)

    return each(given, Pair(before, after), clouds)


def _named_cloud(points: Float64[np.ndarray, "n 3"], rows: Int64[np.ndarray, " n"], cloud: ChunkedCloud) -> PointCloud:
    """Points of a cloud, with what its files state."""
    whole = _whole(cloud)
    unit, crs = (getattr(whole, name, None) for name in ("unit", "crs"))
    return PointCloud(points, rows, source=_source(whole), unit=unit, crs=crs)


def _whole(cloud: ChunkedCloud) -> ChunkedCloud:
    return cloud.cloud if isinstance(cloud, CroppedCloud) else cloud


def _source(cloud: ChunkedCloud) -> str | None:
    """The name of a file, or of those of a survey; None for arrays."""
    if isinstance(cloud, SurveyFiles):
        return cloud.title if len(cloud.files) > 1 else str(cloud.files[0].path)
    return str(cloud.path) if isinstance(cloud, CloudFile) else None


def _counted(
    changes: Changes, refined: AlignedScans, thinned: Pair[ThinnedCloud], clouds: Pair[ChunkedCloud]
) -> Changes:
    """The record with the numbers of the scans' points in place of those of voxels."""
    counts = np.zeros(len(changes) + 1)
    diagnostics = dict(changes.diagnostics)
    for side, own, scan, cloud in zip(NAMES, refined.pair.working.clouds, thinned, clouds, strict=True):
        counts += np.bincount(getattr(changes, f"labels_{side}") + 1, own.mass, len(counts))
        diagnostics[side] = {**diagnostics[side], "source": _source(cloud), "points": scan.total}
    items = [
        dataclasses.replace(change, point_count=int(count)) for change, count in zip(changes, counts[1:], strict=True)
    ]
    return dataclasses.replace(changes, items=tuple(items), diagnostics=diagnostics)
