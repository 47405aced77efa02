"""`gmmjax detect BEFORE AFTER --out DIR`, or `--before FILE ... --after FILE ...` for surveys of several scans."""

import contextlib
import dataclasses
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.changes import DetectionConfig
from gmmjax.cli.sensor_options import SensorOption
from gmmjax.errors import InputError, printable
from gmmjax.pair import Pair, each

# What `--help` shows.
COMMON = (
    *("out", "overwrite", "before", "after", "views_before", "views_after"),
    *("unit", "crop", "kinds", "registration", "threshold"),
    *("explain", "map_2d", "transform_after", "config"),
)


def detect(
    scan_before: Annotated[Path | None, "BEFORE"] = None,
    scan_after: Annotated[Path | None, "AFTER"] = None,
    *,
    before: tuple[Path, ...] = (),
    after: tuple[Path, ...] = (),
    out: Annotated[Path, "DIR"],
    config: Annotated[Path | None, "FILE.toml"] = None,
    views_before: tuple[Path, ...] = (),
    views_after: tuple[Path, ...] = (),
    sensor_at_origin: bool = False,
    sensor_before: Annotated[tuple[float, ...] | None, "X Y Z"] = None,
    sensor_after: Annotated[tuple[float, ...] | None, "X Y Z"] = None,
    explain: Annotated[str | None, "[LABEL]"] = None,
    plot: Annotated[Path | None, "FILE.png"] = None,
    map_2d: Annotated[Path | None, "FILE.tif"] = None,
    tile_size: Annotated[float | None, "LENGTH"] = None,
    workers: int | None = None,
    scheduler: Annotated[str | None, "tcp://HOST:PORT"] = None,
    temporary_folder: Annotated[Path | None, "DIR"] = None,
    transform_after: bool = False,
    overwrite: bool = False,
    verbose: Annotated[int, "-v"] = 0,
    quiet: bool = False,
    json: bool = False,
    settings: Annotated[dict[str, Any], DetectionConfig],
) -> int:
    """Find what changed between two scans: a list, labels for all points, a report.

    Both scans are in one unit and about one frame: PLY, PCD, XYZ, ASC, PTS, CSV, NPY, NPZ, LAS, LAZ or E57, of any
    size. Lengths are in their unit.

    Args:
        scan_before: the scan at the first time.
        scan_after: the scan at the second time.
        before: the scans of a first survey of several, in one frame, in place of BEFORE.
        after: the scans of the second survey, in place of AFTER.
        out: folder for the results; created if missing.
        config: settings, such as the config.toml of an earlier result; options override them.
        views_before: poses of the sensor in the first survey, JSON or NPZ. A change must then lie where the other
            survey saw free space. Default: what E57 and PCD files say.
        views_after: the same of the second survey.
        sensor_at_origin: both scans were taken from the origin of their coordinates; field of view and range are read
            from the points.
        sensor_before: position of the scanner in the first survey, in place of `views_before`; three more numbers for
            each further position. Of several scans one position each, in their order.
        sensor_after: the same of the second survey, in its own coordinates.
        explain: also print why each change is one and why each rejected candidate is not; with a label, of that change.
        plot: also draw both scans, and the changes from above and from the side: .png, .svg or .pdf.
        map_2d: also write a map seen from above: GeoTIFF (.tif; the extra "map"), or a picture (.png, .svg or .pdf).
        tile_size: edge of a tile: what one worker has in memory at a time. No result depends on it. Default: tiles of
            about as many points each, of scans of more than four million points.
        workers: processes of this machine that compare tiles. Default: one a core.
        scheduler: address of a Dask scheduler, whose workers compare the tiles.
        temporary_folder: for what is kept on disk while scans are compared in tiles, some 150 bytes a point. Default:
            the system's.
        transform_after: write the after scan in the frame of the before scan; by default it keeps its coordinates.
        overwrite: replace a previous result in that folder.
        verbose: -v shows the log in place of the progress bar, -vv its details, too.
        quiet: print nothing but errors.
        json: print the changes as JSON and nothing else.
        settings: settings that a --config file may have, too, with _ for -.
    """
    from gmmjax.cli.found_changes import ScansToCompare, TileOptions, found_changes
    from gmmjax.clouds import open_survey
    from gmmjax.reporting import console
    from gmmjax.reporting.result_folder import check_result_folder, result_files

    detection = read_settings(config, settings)
    only = explained_label(explain)
    files = given_files(Pair(scan_before, scan_after), Pair(before, after))
    sensors = Pair(
        SensorOption("before", views_before, sensor_before, sensor_at_origin),
        SensorOption("after", views_after, sensor_after, sensor_at_origin),
    )
    each(SensorOption.check_scans, sensors, files.map(len))
    tiles = TileOptions(tile_size, workers, scheduler, temporary_folder)
    check_result_folder(out, overwrite=overwrite)
    _check_figures(plot, map_2d, out)
    use_compilation_cache()
    with contextlib.ExitStack() as results:
        with (
            console.shown_warnings(quiet=quiet),
            _shown_log(verbose),
            console.progress_bar(quiet=quiet or verbose > 0) as progress,
        ):
            progress("Reading the clouds", 0.0)
            scans = ScansToCompare(files.map(open_survey), sensors, seen_from_above=map_2d is not None)
            found = results.enter_context(found_changes(scans, detection, tiles, progress))
            progress("Writing the results", 1.0)
            found.write(out, transform_after=transform_after, overwrite=overwrite)
            found.draw(plot, map_2d)
        changes = found.changes
        known = only is None or only < len(changes)
        if json:
            console.print_json(changes)
        elif not quiet:
            console.print_changes(changes, explain=explain is not None and known, only=only)
            console.print_files(out, result_files(out))
            console.print_plot(plot)
            console.print_plot(map_2d, "Map")
            console.print_report_hint(out / "report.html")
        if not known:
            labels = ", ".join(map(str, range(len(changes)))) or "none"
            raise InputError(f"--explain {only}: no change has this label; the labels are: {labels}")
    return 0


def _check_figures(plot: Path | None, map_2d: Path | None, out: Path) -> None:
    """Finds out before the work begins whether the pictures can be written."""
    if plot is not None:
        from gmmjax.plotting import check_figure_file

        check_figure_file(plot, created=out)
    if map_2d is not None:
        from gmmjax.plotting import check_map_file

        check_map_file(map_2d, created=out)


def given_files(scans: Pair[Path | None], surveys: Pair[tuple[Path, ...]]) -> Pair[tuple[Path, ...]]:
    """The files of both surveys.

    Raises:
        InputError: neither both scans nor both surveys are given, or some of either.
    """
    given = [scan for scan in scans if scan is not None]
    if not given and surveys.before and surveys.after:
        return surveys
    if len(given) == 2 and not surveys.before and not surveys.after:
        return Pair(*((scan,) for scan in given))
    raise InputError(
        "give either two scans as BEFORE AFTER, or all scans of two surveys as --before FILE ... --after FILE ..., and "
        "not some of both"
    )


def explained_label(explain: str | None) -> int | None:
    """The label of `--explain LABEL`; None for all.

    Raises:
        InputError: it is no label.
    """
    if explain is None or explain == "all":
        return None
    if not explain.isdecimal():
        raise InputError(f"--explain {explain}: must be the label of a change, such as 0, or nothing for all of them")
    return int(explain)


def read_settings(file: Path | None, given: dict[str, Any] | None = None) -> DetectionConfig:
    """The settings in a TOML file, where there is one, and those that are given over them.

    Args:
        file: a path in it is relative to it.
        given: settings by name.

    Raises:
        InputError: a file that cannot be read, is no TOML, or has unknown or wrong settings; it names the file. Or a
            setting that is given and wrong.
    """
    from gmmjax.clouds import read_toml

    config = DetectionConfig()
    if file is not None:
        settings = read_toml(file)
        try:
            config = DetectionConfig.from_dict(settings)
        except InputError as error:
            raise InputError(f"{file}: {error}") from error
        if config.verdict is not None:
            config = dataclasses.replace(config, verdict=str((file.parent / config.verdict).resolve()))
    return dataclasses.replace(config, **(given or {}))


class _Formatter(logging.Formatter):
    """One line for each record: seconds since the start of the program, the message, of a detail where it is from."""

    def format(self, record: logging.LogRecord) -> str:
        where = f"{record.name}: " if record.levelno < logging.INFO else ""
        return printable(f"{record.relativeCreated / 1000:7.2f} s  {where}{record.getMessage()}")


@contextlib.contextmanager
def _shown_log(verbosity: int) -> Iterator[None]:
    """Shows on standard error what the package logs while the block runs: 1 stages and sizes, 2 details, too."""
    if verbosity <= 0:
        yield
        return
    logger = logging.getLogger("gmmjax")
    handler, level = logging.StreamHandler(sys.stderr), logger.level
    handler.setFormatter(_Formatter())
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if verbosity == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
