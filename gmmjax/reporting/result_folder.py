"""The folder that `gmmjax detect` writes: the changes for programs, for viewers of clouds and for people."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from gmmjax.changes import CHANGES_FILE, LABELS_FILE, NAMES, Changes, DetectionConfig, presented
from gmmjax.clouds import FolderKind, PointCloud, SurveyFiles, atomic_write, check_output_folder, output_folder
from gmmjax.pair import Pair, each, parallel_map
from gmmjax.reporting.change_files import MAP_FILE, TABLE_FILE, write_map, write_table
from gmmjax.reporting.html_report import report_html
from gmmjax.reporting.labelled_cloud import (
    ENDINGS,
    LabelledCloud,
    labelled_clouds,
    labelled_files,
    write_scans,
)

if TYPE_CHECKING:
    from gmmjax.tiling import TiledChanges

REPORT_FILE = "report.html"
CONFIG_FILE = "config.toml"
LABELLED = "the scan, with label, kind and probability"
LABELLED_SCANS = "the scans, with label, kind and probability"
# Of the scans of a survey of several.
FOLDERS = tuple(f"{side}/" for side in NAMES)
# What each file of a result is, in the order in which they are listed; of the scans, those that there are.
DESCRIPTIONS: Mapping[str, str] = {
    REPORT_FILE: "open it in a browser",
    CHANGES_FILE: "the changes, settings and diagnostics",
    TABLE_FILE: "the changes as a table",
    MAP_FILE: "their footprints, for a map",
    LABELS_FILE: "label and probability of every point",
    **{f"{side}{ending}": LABELLED for side in NAMES for ending in ENDINGS},
    **dict.fromkeys(FOLDERS, LABELLED_SCANS),
    CONFIG_FILE: "the settings, for --config",
}
OTHERS = tuple(name for name in DESCRIPTIONS if name not in (CHANGES_FILE, *FOLDERS))
RESULT = FolderKind("result", CHANGES_FILE, "changes", OTHERS, folders=(*NAMES,))


def result_files(folder: Path) -> dict[str, str]:
    """List the files of a result that are there, with what they are; folders of the scans of a survey end with "/"."""
    there = {name: (folder / name).is_dir() if name in FOLDERS else (folder / name).is_file() for name in DESCRIPTIONS}
    return {name: text for name, text in DESCRIPTIONS.items() if there[name]}


def check_result_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Raise an InputError unless `write_result` could write there, before a long computation."""
    check_output_folder(folder, RESULT, overwrite=overwrite)


def write_result(
    folder: str | os.PathLike[str],
    before: PointCloud,
    after: PointCloud,
    changes: Changes,
    *,
    transform_after: bool = False,
    overwrite: bool = False,
) -> Path:
    """Write all outputs of a detection, or none.

    Results are in the frame of the before cloud. Both scans keep the coordinates that they came with.

    `changes.json` and `labels.npz` (read back by `Changes.load`), `changes.csv`, `changes.geojson`, `report.html` and
    `config.toml`; and both scans with what was found about their points, as `before.las`, `.laz` or `.pcd` where that
    is what they were read from, else as `before.ply`, with all that their files held. See `LabelledCloud`. The scans of
    a survey of several files are each a file in a folder `before` or `after`, with the name of its own.

    Args:
        folder: is made where needed; may be empty.
        before: the before cloud that the changes were found in.
        after: the after cloud, as given.
        changes: what was found.
        transform_after: write the after scan transformed into the frame of the before cloud, by `changes.registration`.
        overwrite: replace a previous result.

    Returns:
        The folder.

    Raises:
        InputError: clouds that are not those of the changes, or a folder that cannot be written; it is then as it was.

    Warns:
        InputWarning: the file of a scan was changed since it was read; it is written as PLY.
    """
    with output_folder(folder, RESULT, overwrite=overwrite) as staging:
        write_result_files(staging, before, after, changes, transform_after=transform_after)
    return Path(folder)


def write_tiled_result(
    folder: str | os.PathLike[str],
    surveys: Pair[SurveyFiles],
    found: "TiledChanges",
    *,
    transform_after: bool = False,
    overwrite: bool = False,
) -> Path:
    """Write the files of `write_result` for a detection in tiles, or none.

    The scans are read again, and written some points at a time. The report shows the points that were compared in the
    end: fine where something looks changed, and coarse elsewhere.

    Args:
        folder: as of `write_result`.
        surveys: the files that the changes were found in.
        found: what was found.
        transform_after: as of `write_result`.
        overwrite: as of `write_result`.

    Raises:
        InputError: the folder or a file cannot be written, or a scan was changed since it was read; the folder is then
            as it was.

    Warns:
        InputWarning: a scan cannot be written in its own format; it is written as PLY.
    """
    transforms = Pair(None, _transform(found.changes) if transform_after else None)
    scans = each(labelled_files, surveys, found.rows.map(lambda own: own.fields()), transforms)
    with output_folder(folder, RESULT, overwrite=overwrite) as staging:
        _write_files(staging, found.changes, found.shown, found.clouds, scans)
    return Path(folder)


def write_result_files(
    folder: Path, before: PointCloud, after: PointCloud, changes: Changes, *, transform_after: bool = False
) -> None:
    """Write the files of `write_result` into a folder that is there; InputError or OSError where that fails."""
    clouds, shown = presented(changes, before, after)
    labelled = labelled_clouds(Pair(before, after), changes, _transform(changes) if transform_after else None)
    _write_files(folder, changes, shown, clouds, labelled.map(lambda own: own.by_file()))


def _transform(changes: Changes) -> np.ndarray | None:
    """Return what takes the after scan into the frame of the before scan; None: it is in it."""
    return changes.registration.transform if changes.registration.applied else None


def _write_files(
    folder: Path,
    changes: Changes,
    shown: Changes,
    clouds: Pair[PointCloud],
    scans: Pair[list[LabelledCloud]],
) -> None:
    """Write the record, the scans with what was found of them, and a report of the clouds that are shown."""
    changes.save(folder)
    write_table(folder / TABLE_FILE, changes)
    write_map(folder / MAP_FILE, changes)
    parallel_map(lambda side, own: write_scans(folder, side, own), NAMES, scans)
    with atomic_write(folder / REPORT_FILE) as file:
        file.write(report_html(clouds.before, clouds.after, shown, recorded=changes).encode())
    with atomic_write(folder / CONFIG_FILE) as file:
        tomli_w.dump(_portable(changes.config), file)


def _portable(config: DetectionConfig) -> dict[str, Any]:
    """Return the settings by name, with a path that does not depend on the folder that it is used from."""
    settings = config.to_dict()
    return settings if config.verdict is None else {**settings, "verdict": str(Path(config.verdict).resolve())}
