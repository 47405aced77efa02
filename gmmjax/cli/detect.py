"""`gmmjax detect BEFORE AFTER --out DIR`, or `--before FILE ... --after FILE ...` for surveys of several scans."""

import contextlib
import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import OmitArgPrefixes, Positional

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.changes import DetectionConfig
from gmmjax.cli.flags import flags_of
from gmmjax.cli.log import shown_log
from gmmjax.cli.sensor_options import SensorOption
from gmmjax.errors import InputError
from gmmjax.pair import Pair, each

# What the values of settings are called in the help.
VALUES = {
    **dict.fromkeys(("tolerance", "voxel_size", "noise_floor", "covariance_scale", "penalty"), "LENGTH"),
    "crop": "X Y Z X Y Z",
    "verdict": "FILE",
    "threshold": "P",
    "unit": "UNIT",
}
NO_EVIDENCE = (
    "skip the evidence test, by which a change of a surface scan must lie where the other scan looked: where its views "
    'saw free space or, without views, off the surfaces next to it. Of "joint".'
)
NO_STATIONS = (
    "do not recognise the stations of a scanner on a tripod by the density of the ground around them. By default they "
    'are the views of a scan that has none; z points up. Of "joint".'
)
Flags = flags_of(DetectionConfig, VALUES, {"evidence": NO_EVIDENCE, "recognise_stations": NO_STATIONS})


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`detect` with the settings of `--config` as the defaults of its flags, so that flags win over the file."""
    file = config_file(arguments)
    settings = DetectionConfig() if file is None else read_settings(file)
    return functools.partial(detect, settings=Flags(**dataclasses.asdict(settings)))


def detect(
    scan_before: Annotated[Positional[Path | None], tyro.conf.arg(metavar="BEFORE")] = None,
    scan_after: Annotated[Positional[Path | None], tyro.conf.arg(metavar="AFTER")] = None,
    *,
    before: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = (),
    after: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = (),
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE.toml")] = None,
    views_before: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = (),
    views_after: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = (),
    sensor_at_origin: bool = False,
    sensor_before: Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="X Y Z")] = None,
    sensor_after: Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="X Y Z")] = None,
    explain: Annotated[str | None, tyro.conf.arg(metavar="[LABEL]")] = None,
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None,
    map_2d: Annotated[Path | None, tyro.conf.arg(name="map-2d", metavar="FILE.tif")] = None,
    tile_size: Annotated[float | None, tyro.conf.arg(metavar="LENGTH")] = None,
    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None,
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None,
    temporary_folder: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    transform_after: bool = False,
    overwrite: bool = False,
    verbose: Annotated[tyro.conf.UseCounterAction[int], tyro.conf.arg(aliases=["-v"])] = 0,
    quiet: bool = False,
    print_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    settings: OmitArgPrefixes[Flags],  # type: ignore[valid-type]
) -> int:
    """Find what changed between two scans: a list, labels for all points, a report.

    Reads PLY, PCD, XYZ, ASC, PTS, CSV, NPY, NPZ, LAS, LAZ and E57. Both scans must be in the same unit and in about
    the same frame. Where a survey has several scans, in one frame, give them with --before and --after. Scans of
    more than some million points are compared in tiles, in memory that does not grow with them.

    Args:
        scan_before: the scan at the first time.
        scan_after: the scan at the second time.
        before: the scans of the first survey, in place of BEFORE.
        after: the scans of the second survey, in place of AFTER.
        out: folder for the results; created if missing.
        config: TOML file with settings, such as the config.toml of an earlier result; options override it.
        views_before: poses of the sensor during the first survey, JSON or NPZ with poses, field_of_view and max_range;
            those of several files are joined. A change must then lie where the other scan saw free space. By default
            they are taken from the scans, if these are E57 files with poses or PCD files of ordered frames.
        views_after: the same for the second survey.
        sensor_at_origin: both scans were taken from the origin of their coordinates. Field of view and range are read
            from the points.
        sensor_before: position of the scanner during the first scan, in place of --views-before; three more numbers
            for each further position. Of several scans one position each, in their order.
        sensor_after: the same for the second survey, in its own coordinates.
        explain: also print why each change is one and why each rejected candidate is not: the facts that decided, with
            their contributions in log odds. With a LABEL, only for that change. The report and changes.json always
            have them.
        plot: also draw both scans, and the changes from above and from the side, into a .png, .svg or .pdf file.
        map_2d: also write a map seen from above, along z: the signed distance, the probability and the changes as
            GeoTIFF (.tif; needs rasterio, the extra "map"), or a picture with outlined and numbered changes (.png, .svg
            or .pdf).
        tile_size: edge of a tile, in the unit of the scans: what one worker has in memory at a time. No result depends
            on it. By default tiles have about as many points each.
        workers: number of processes on this machine that compare tiles; default one per core.
        scheduler: address of a Dask scheduler, whose workers compare the tiles.
        temporary_folder: for what is kept on disk while scans are compared in tiles, some 150 bytes a point; by default
            the system's folder for temporary files.
        transform_after: write the after scan transformed into the frame of the before scan, by the registration in
            changes.json, so that they lie on each other in a viewer. By default both scans keep their own coordinates.
        overwrite: replace a previous result in the output folder.
        verbose: show the log in place of the progress bar; -vv shows details, too.
        quiet: print nothing but errors.
        print_json: print the changes as JSON and nothing else.
        settings: lengths are in the unit of the scans.
    """
    del config  # Its settings are the defaults of the flags already: see `command`.
    from gmmjax.cli.found_changes import ScansToCompare, TileOptions, found_changes
    from gmmjax.clouds import open_survey
    from gmmjax.reporting import console
    from gmmjax.reporting.result_folder import check_result_folder, result_files

    detection = DetectionConfig(**dataclasses.asdict(settings))
    only = explained_label(explain)
    files = given_files(Pair(scan_before, scan_after), Pair(before, after))
    sensors = Pair(
        SensorOption("before", views_before, sensor_before, sensor_at_origin),
        SensorOption("after", views_after, sensor_after, sensor_at_origin),
    )
    each(lambda sensor, own: sensor.check_scans(len(own)), sensors, files)
    tiles = TileOptions(tile_size, workers, scheduler, temporary_folder)
    check_result_folder(out, overwrite=overwrite)
    if plot is not None:
        from gmmjax.plotting import check_figure_file

        check_figure_file(plot, created=out)
    if map_2d is not None:
        from gmmjax.plotting import check_map_file

        check_map_file(map_2d, created=out)
    use_compilation_cache()
    with contextlib.ExitStack() as results:
        with (
            console.shown_warnings(quiet=quiet),
            shown_log(verbose),
            console.progress_bar(quiet=quiet or verbose > 0) as progress,
        ):
            progress("Reading the clouds", 0.0)
            scans = ScansToCompare(files.map(open_survey), sensors, seen_from_above=map_2d is not None)
            found = results.enter_context(found_changes(scans, detection, tiles, progress))
            progress("Writing the results", 1.0)
            found.write(out, transform_after=transform_after, overwrite=overwrite)
            if plot is not None:
                from gmmjax.plotting import overview_figure, write_figure

                write_figure(plot, overview_figure(found.shown, found.clouds))
            if map_2d is not None:
                from gmmjax.plotting import write_map

                write_map(map_2d, found.shown, found.clouds)
        changes = found.changes
        known = only is None or only < len(changes)
        if print_json:
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


def given_files(scans: Pair[Path | None], surveys: Pair[tuple[Path, ...]]) -> Pair[tuple[Path, ...]]:
    """The files of both surveys.

    Args:
        scans: BEFORE and AFTER.
        surveys: of `--before` and `--after`.

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


def completed(arguments: Sequence[str]) -> list[str]:
    """The arguments with what `--explain` stands for where no label follows it: "all"."""
    words = []
    for word, following in itertools.pairwise([*arguments, ""]):
        words += [word, "all"] if word == "--explain" and not following.isdecimal() else [word]
    return words


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


def read_settings(file: Path) -> DetectionConfig:
    """The settings in a TOML file; a path in them is relative to it.

    Raises:
        InputError: a file that cannot be read, is no TOML, or has unknown or wrong settings; it names the file.
    """
    from gmmjax.clouds import read_toml

    settings = read_toml(file)
    try:
        config = DetectionConfig.from_dict(settings)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    if config.verdict is None:
        return config
    return dataclasses.replace(config, verdict=str((file.parent / config.verdict).resolve()))


def config_file(arguments: Sequence[str]) -> Path | None:
    """The file of `--config FILE` or `--config=FILE`, the last one given.

    Args:
        arguments: of the command.
    """
    file = None
    for word, following in itertools.pairwise([*arguments, ""]):
        if word == "--config" and following:
            file = Path(following)
        elif word.startswith("--config="):
            file = Path(word.removeprefix("--config="))
    return file
