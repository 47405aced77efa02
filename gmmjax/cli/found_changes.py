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

# Of both surveys together, up to which they are read into memory: a million take about half a gigabyte.
ROWS_IN_MEMORY = 4_000_000


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
    """The options about tiles; None: not given.

    Attributes:
        tile_size: edge of a tile, in the unit of the scans.
        workers: number of processes.
        scheduler: address of a Dask scheduler.
        folder: for what is kept on disk.
    """

    tile_size: float | None
    workers: int | None
    scheduler: str | None
    folder: Path | None

    def asked_for(self, surveys: Pair[SurveyFiles], config: DetectionConfig) -> bool:
        """True where scans are compared in tiles."""
        if any(given is not None for given in (self.tile_size, self.workers, self.scheduler, self.folder)):
            return True
        # One voxel size, and the thesis's methods, are of clouds in memory.
        in_tiles = config.method == "joint" and config.voxel_size is None
        return in_tiles and sum(own.count for own in surveys) > ROWS_IN_MEMORY


class FoundChanges(NamedTuple):
    """The changes, and how they are shown and written.

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

    def draw(self, plot: Path | None, map_2d: Path | None) -> None:
        """Writes a figure and a map, where they are asked for."""
        if plot is not None:
            from gmmjax.plotting import overview_figure, write_figure

            write_figure(plot, overview_figure(self.shown, self.clouds))
        if map_2d is not None:
            from gmmjax.plotting import write_map

            write_map(map_2d, self.shown, self.clouds)


@contextmanager
def found_changes(
    scans: ScansToCompare, config: DetectionConfig, tiles: TileOptions, progress: "Progress"
) -> Iterator[FoundChanges]:
    """Compares two surveys.

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

    clouds = scans.surveys.map(SurveyFiles.read)
    if scans.seen_from_above:
        _check_seen_from_above(clouds.after)
    before, after = each(SensorOption.views, scans.sensors, clouds)
    changes = detect_changes(*clouds, config=config, views_before=before, views_after=after, progress=progress)
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
    with tiled_changes(
        surveys,
        config=config,
        views=each(lambda sensor, own: sensor.views(own) or own.views, scans.sensors, surveys),
        tile_size=tiles.tile_size,
        workers=Workers(tiles.workers, tiles.scheduler),
        folder=tiles.folder,
        progress=progress,
    ) as found:
        write = functools.partial(write_tiled_result, surveys=surveys, found=found)
        yield FoundChanges(found.changes, found.shown, found.clouds, write)
