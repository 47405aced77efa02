"""The changes that `gmmjax detect` shows and writes: found in memory or, of scans that are larger, in tiles."""

import dataclasses
import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gmmjax.changes import Changes, DetectionConfig
from gmmjax.cli.sensor_options import SensorOption
from gmmjax.clouds import CloudChunk, PointCloud, SurveyFiles
from gmmjax.errors import InputError
from gmmjax.pair import Pair, each

if TYPE_CHECKING:
    from gmmjax.changes import Progress


class ScansToCompare(NamedTuple):
    """Both surveys, opened.

    Attributes:
        surveys: their files.
        sensors: what the user says of where the sensors stood.
        seen_from_above: whether a map is asked for.
    """

    surveys: Pair[SurveyFiles]
    sensors: Pair[SensorOption]
    seen_from_above: bool


@dataclasses.dataclass(frozen=True)
class TileOptions:
    """What the user says of tiles.

    Attributes:
        tile_size: edge of a tile, in the unit of the scans; None: not given.
        workers: number of processes; None: not given.
        scheduler: address of a Dask scheduler; None: not given.
        folder: for what is kept on disk; None: not given.
        rows_in_memory: of both surveys together, up to which they are read into memory where nothing else is given: a
            million take about half a gigabyte. 0: all scans are compared in tiles.
    """

    tile_size: float | None
    workers: int | None
    scheduler: str | None
    folder: Path | None
    rows_in_memory: int = 4_000_000

    def asked_for(self, surveys: Pair[SurveyFiles], config: DetectionConfig) -> bool:
        """Whether scans are compared in tiles."""
        if any(given is not None for given in (self.tile_size, self.workers, self.scheduler, self.folder)):
            return True
        # One voxel size, and the thesis's methods, are of clouds in memory.
        in_tiles = config.method == "joint" and config.voxel_size is None
        return in_tiles and sum(own.count for own in surveys) > self.rows_in_memory


class FoundChanges(NamedTuple):
    """What was found.

    Attributes:
        changes: the record of all points.
        shown: that of the clouds which figures and maps show.
        clouds: these.
        write: writes the folder of results, as `write_result` and `write_tiled_result`.
    """

    changes: Changes
    shown: Changes
    clouds: Pair[PointCloud]
    write: Callable[..., Path]


@contextmanager
def found_changes(
    scans: ScansToCompare, config: DetectionConfig, tiles: TileOptions, progress: "Progress"
) -> Iterator[FoundChanges]:
    """Compares two surveys.

    Args:
        scans: both surveys.
        config: how they are compared.
        tiles: whether in tiles, and in which.
        progress: is told how far it has got.

    Yields:
        The changes.

    Raises:
        InputError: as `detect_changes` and `tiled_changes`; a scan that has no upward direction, where a map is asked
            for.
    """
    if tiles.asked_for(scans.surveys, config):
        with _in_tiles(scans, config, tiles, progress) as found:
            yield found
    else:
        yield _in_memory(scans, config, progress)


def _check_seen_from_above(cloud: PointCloud | CloudChunk) -> None:
    from gmmjax.reporting import check_upright

    try:
        check_upright(cloud.points)
    except InputError as error:
        raise InputError(f"--map-2d: {error}, or leave it out") from None


def _in_memory(scans: ScansToCompare, config: DetectionConfig, progress: "Progress") -> FoundChanges:
    from gmmjax.changes import detect_changes
    from gmmjax.reporting.result_folder import write_result

    clouds = scans.surveys.map(lambda own: own.read())
    if scans.seen_from_above:
        _check_seen_from_above(clouds.after)
    views = each(lambda sensor, cloud: sensor.views(cloud), scans.sensors, clouds)
    changes = detect_changes(
        clouds.before,
        clouds.after,
        config=config,
        views_before=views.before,
        views_after=views.after,
        progress=progress,
    )

    write = functools.partial(write_result, before=clouds.before, after=clouds.after, changes=changes)
    return FoundChanges(changes, changes, clouds, write)


@contextmanager
def _in_tiles(
    scans: ScansToCompare, config: DetectionConfig, tiles: TileOptions, progress: "Progress"
) -> Iterator[FoundChanges]:
    from gmmjax.reporting.result_folder import write_tiled_result
    from gmmjax.tiling import Workers, tiled_changes

    surveys = scans.surveys
    if scans.seen_from_above:
        _check_seen_from_above(next(surveys.after.chunks()))
    views = each(lambda sensor, own: sensor.views(own) or own.views, scans.sensors, surveys)
    with tiled_changes(
        surveys,
        config=config,
        views=views,
        tile_size=tiles.tile_size,
        workers=Workers(tiles.workers, tiles.scheduler),
        folder=tiles.folder,
        progress=progress,
    ) as found:
        write = functools.partial(write_tiled_result, surveys=surveys, found=found)
        yield FoundChanges(found.changes, found.shown, found.clouds, write)
