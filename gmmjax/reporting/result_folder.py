"""The folder that `gmmjax detect` writes: the changes for programs, for viewers of clouds and for people."""

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from jaxtyping import Bool, Float, Int

from gmmjax.changes import CHANGES_FILE, LABELS_FILE, Changes, DetectionConfig
from gmmjax.clouds import FolderKind, PointCloud, atomic_write, check_output_folder, output_folder, write_ply
from gmmjax.errors import InputError
from gmmjax.reporting.html_report import report_html
from gmmjax.reporting.palette import point_colors

REPORT_FILE = "report.html"
BEFORE_FILE = "before.ply"
AFTER_FILE = "after.ply"
CONFIG_FILE = "config.toml"
RESULT = FolderKind("result", CHANGES_FILE, "changes", (LABELS_FILE, BEFORE_FILE, AFTER_FILE, REPORT_FILE, CONFIG_FILE))


def check_result_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Whether `write_result` could write there; called before a long computation.

    Raises:
        InputError: the folder is a file, holds something else, holds a result and not `overwrite`, or cannot be
            written.
    """
    check_output_folder(folder, RESULT, overwrite=overwrite)


def write_result(
    folder: str | os.PathLike[str], before: PointCloud, after: PointCloud, changes: Changes, *, overwrite: bool = False
) -> Path:
    """Writes all outputs of a detection, or none.

    All are in the frame of the before cloud: `after.ply` is registered, where a registration was applied.

    `changes.json` and `labels.npz` (read back by `Changes.load`), `before.ply` and `after.ply` (points of changes in
    the colour of their kind, fields `label`, `probability` and `unobserved`; `row`, the row in the source, where rows
    were dropped), `report.html` and `config.toml`.

    Args:
        folder: is made where needed; may be empty.
        before: the before cloud that the changes were found in.
        after: the after cloud, as given.
        changes: what was found.
        overwrite: replace a previous result.

    Returns:
        The folder.

    Raises:
        InputError: clouds that are not those of the changes, or a folder that cannot be written; it is then as it was.
    """
    check_lengths(before, after, changes)
    with output_folder(folder, RESULT, overwrite=overwrite) as staging:
        write_result_files(staging, before, after, changes)
    return Path(folder)


def write_result_files(folder: Path, before: PointCloud, after: PointCloud, changes: Changes) -> None:
    """Writes the files of `write_result` into a folder that is there.

    Args:
        folder: to write to.
        before: the before cloud that the changes were found in.
        after: the after cloud, as given.
        changes: what was found.

    Raises:
        InputError, OSError: a file cannot be written.
    """
    changes.save(folder)
    fields = changes.labels_before, changes.probability_before, changes.unobserved_before
    _write_labelled(folder / BEFORE_FILE, before, *fields, changes)
    fields = changes.labels_after, changes.probability_after, changes.unobserved_after
    registered = dataclasses.replace(after, points=changes.registration.apply(after.points))
    _write_labelled(folder / AFTER_FILE, registered, *fields, changes)
    with atomic_write(folder / REPORT_FILE) as file:
        file.write(report_html(before, after, changes).encode())
    with atomic_write(folder / CONFIG_FILE) as file:
        tomli_w.dump(_portable(changes.config), file)


def _portable(config: DetectionConfig) -> dict[str, Any]:
    """The settings by name; the path is one that does not depend on the folder that it is used from."""
    settings = config.to_dict()
    return settings if config.verdict is None else {**settings, "verdict": str(Path(config.verdict).resolve())}


def check_lengths(before: PointCloud, after: PointCloud, changes: Changes) -> None:
    """Whether these can be the clouds that the changes were found in.

    Raises:
        InputError: clouds of other lengths than the labels.
    """
    for name, cloud, labels in (("before", before, changes.labels_before), ("after", after, changes.labels_after)):
        if len(cloud) != len(labels):
            raise InputError(
                f"{name}: has {len(cloud)} points, the changes have labels for {len(labels)}; "
                "give the clouds that the changes were found in"
            )


def _write_labelled(
    path: Path,
    cloud: PointCloud,
    labels: Int[np.ndarray, " n"],
    probability: Float[np.ndarray, " n"],
    unobserved: Bool[np.ndarray, " n"],
    changes: Changes,
) -> None:
    fields: dict[str, np.ndarray] = {
        "label": labels.astype(np.int32),
        "probability": probability.astype(np.float32),
        "unobserved": unobserved.astype(np.uint8),
    }
    if cloud.rows_dropped:
        fields["row"] = cloud.rows.astype(np.int32)
    comments = ["written by gmmjax detect: label is -1 where unchanged, else the index of the change in changes.json"]
    write_ply(path, cloud.points, colors=point_colors(labels, changes, cloud.colors), fields=fields, comments=comments)
