"""Changes between two surveys of any size: `detect_changes` out of core.

Two passes. The coarse one thins both scans to what fits into memory, registers them and fits the mixture. The fine one
compares the scans at their own resolution block by block, takes what lies around all that looks changed at that
resolution, and lets the stages after it see these voxels there and the coarse clouds elsewhere.
"""

import dataclasses
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gmmjax.batch import Workers
from gmmjax.changes import (
    NAMES,
    Changes,
    Clock,
    DetectionConfig,
    JointDetector,
    Progress,
    Scan,
    common_unit,
    silent,
    stated_system,
    stated_systems,
)
from gmmjax.clouds import ChunkedCloud, PointCloud, SensorViews, working_folder
from gmmjax.errors import InputError, recorded_warnings
from gmmjax.pair import Pair, each
from gmmjax.tiling.block_store import write_block_store
from gmmjax.tiling.blocks import tree_of
from gmmjax.tiling.coarse_pass import coarse_pass, placed_clouds
from gmmjax.tiling.compute import tiles_of
from gmmjax.tiling.detection_settings import TiledDetectionSettings
from gmmjax.tiling.fine_pass import Comparison, Tiles, fine_pass
from gmmjax.tiling.point_clouds import all_points, with_colors
from gmmjax.tiling.row_columns import MISSING, RowColumns
from gmmjax.tiling.row_results import row_columns


@dataclasses.dataclass(frozen=True, eq=False)
class TiledChanges:
    """The changes between two surveys of any size.

    Attributes:
        changes: the record, whose arrays for each row of the surveys are maps of files that are there as long as the
            block of code of `tiled_changes`.
        shown: the same changes of the points that were compared in the end, fine where something looks changed and
            coarse elsewhere: what reports and figures show.
        clouds: these points, either cloud in the frame of its survey, with a row that is there and, where the files
            have one, its colour or else its intensity.
        rows: of either survey, what `changes` has and the kind of change (0 for none).
    """

    changes: Changes
    shown: Changes
    clouds: Pair[PointCloud]
    rows: Pair[RowColumns]


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
    """Detect what changed between two surveys of any size, and how sure that is.

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
            units or reference systems, or angles, that fill volumes; a tile size below ten point spacings; a file that
            cannot be read, a folder that cannot be written, or a full disk.
        ComputationError: no restart gave a mixture; a worker died twice with the same tile, or there are no workers any
            more.

    Warns:
        InputWarning: as of `detect_changes`.
    """
    _check(config)
    clock = Clock(progress or silent)
    # First of all, so that a folder that cannot be written is told before the work.
    parent = Path(tempfile.gettempdir() if folder is None else os.path.abspath(folder))
    with working_folder(parent) as disk, recorded_warnings() as warnings:
        unit = common_unit(clouds, config)
        coarse = coarse_pass(clouds, views, config, clock, settings)
        placed, lattice = placed_clouds(coarse, settings.resolution)
        tree = tree_of(placed, settings.max_points, coarse.finest_level(placed.lattice))
        tiles_of(tree, tile_size)
        clock.start("tiles", "Sorting the points into blocks", 0.3)
        if max(placed.row_counts) <= coarse.detector.common_resolution.voxels:
            found = _compared_whole(coarse.clouds, stated_systems(clouds), views, config, disk, clock)
        else:
            tiles = Tiles(write_block_store(placed, tree, disk), tile_size, workers)
            found = fine_pass(coarse, lattice, tiles, clock, settings)
        diagnostics = dict(found.changes.diagnostics)
        for side, count in zip(NAMES, coarse.stray, strict=True):
            diagnostics[side] = {**diagnostics[side], "stray": count}
        about: dict[str, Any] = {"unit": unit, "crs": stated_system(clouds.before), "warnings": tuple(warnings)}
        shown = dataclasses.replace(found.changes, **about, diagnostics=diagnostics)
        changes = dataclasses.replace(shown, **_arrays(found.rows))
        clock.finish()
        yield TiledChanges(changes, dataclasses.replace(shown, clouds=found.clouds), found.clouds, found.rows)


def _check(config: DetectionConfig) -> None:
    if config.method != "joint":
        raise InputError(f"method={config.method}: only 'joint' compares scans in tiles; leave the tiles out")
    if config.voxel_size is not None:
        raise InputError("voxel_size: in tiles the voxels are as small as the scans allow at each place; leave it out")


def _arrays(rows: Pair[RowColumns]) -> dict[str, Any]:
    """The arrays of `Changes`, as maps of files."""
    names = {"labels": "label", **{name: name for name in MISSING if name not in ("label", "kind")}}
    sides = zip(NAMES, rows, strict=True)
    return {f"{array}_{side}": own.column(name) for side, own in sides for array, name in names.items()}


def _compared_whole(
    clouds: Pair[ChunkedCloud],
    systems: Pair[str | None],
    views: Pair[SensorViews | None],
    config: DetectionConfig,
    disk: Path,
    clock: Clock,
) -> Comparison:
    """The changes of scans that have no more points than it takes to register them: those that are found in memory."""
    points = each(lambda own, crs: dataclasses.replace(all_points(own), crs=crs), clouds, systems)
    scans = each(Scan, points, views)
    detector = JointDetector(config)
    changes = detector.changes_of(detector.prepared(scans, clock), clock)
    rows = row_columns(disk, clouds.map(lambda own: own.count))
    for side, columns, own in zip(NAMES, rows, points, strict=True):
        columns.fill(own.rows, changes.point_values(side))
        columns.flush()
    return Comparison(changes, each(with_colors, points, clouds), rows)
