"""`gmmjax detect BEFORE AFTER --out DIR`."""

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
from gmmjax.clouds import read_toml
from gmmjax.errors import InputError

Flags = flags_of(DetectionConfig)


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`detect` with the settings of `--config` as the defaults of its flags, so that flags win over the file."""
    file = config_file(arguments)
    settings = DetectionConfig() if file is None else read_settings(file)
    return functools.partial(detect, settings=Flags(**dataclasses.asdict(settings)))


def detect(
    before: Annotated[Positional[Path], tyro.conf.arg(metavar="BEFORE")],
    after: Annotated[Positional[Path], tyro.conf.arg(metavar="AFTER")],
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE.toml")] = None,
    views_before: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    views_after: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    explain: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
    print_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    settings: OmitArgPrefixes[Flags],  # type: ignore[valid-type]
) -> int:
    """What changed from one scan to another: a list, labels for all points, a report.

    Reads PLY, PCD, XYZ, ASC, PTS, CSV, NPY, NPZ, LAS, LAZ and E57. Both scans must be in about the same frame, and in
    the same unit.

    Args:
        before: the scan at the first time.
        after: the scan at the second time.
        out: folder for the results; is made where needed.
        config: TOML file with settings, such as the config.toml of an earlier result; flags win over it.
        views_before: where the sensor stood during the first scan, JSON or NPZ with poses, field_of_view and
            max_range; then only what the other scan looked through is a change. The default is what a PCD file of an
            ordered frame says.
        views_after: the same for the second scan.
        explain: print, too, why each change is one and why each rejected candidate is none: the facts that decided,
            with their contributions in log odds. The report and changes.json always have them.
        overwrite: replace a previous result in the output folder.
        quiet: print nothing but errors.
        print_json: print the changes as JSON and nothing else.
        settings: lengths are in the unit of the scans; None means derived from the data.
    """
    del config  # Its settings are the defaults of the flags already: see `command`.
    from gmmjax.changes import detect_changes
    from gmmjax.clouds import read_cloud, read_views
    from gmmjax.reporting import console
    from gmmjax.reporting.result_folder import check_result_folder, result_files, write_result

    detection = DetectionConfig(**dataclasses.asdict(settings))
    check_result_folder(out, overwrite=overwrite)
    use_compilation_cache()
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        progress("Reading the clouds", 0.0)
        clouds = read_cloud(before), read_cloud(after)
        views = [None if file is None else read_views(file) for file in (views_before, views_after)]
        changes = detect_changes(
            *clouds, config=detection, views_before=views[0], views_after=views[1], progress=progress
        )
        progress("Writing the results", 1.0)
        write_result(out, *clouds, changes, overwrite=overwrite)
    if print_json:
        console.print_json(changes)
    elif not quiet:
        console.print_changes(changes, explain=explain)
        console.print_files(out, result_files(out))
    return 0


def read_settings(file: Path) -> DetectionConfig:
    """The settings in a TOML file; a path in them is relative to it.

    Raises:
        InputError: a file that cannot be read, is no TOML, or has unknown or wrong settings; it names the file.
    """
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
