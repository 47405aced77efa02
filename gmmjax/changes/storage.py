"""`Changes` on disk: `changes.json` for people and scripts, `labels.npz` for the per-point arrays."""

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.changes.change import Box, Change, Changes
from gmmjax.changes.config import DetectionConfig
from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.files import read_json_record
from gmmjax.errors import InputError

SCHEMA_VERSION = 1
CHANGES_FILE = "changes.json"
LABELS_FILE = "labels.npz"

_POINT_ARRAYS = ("labels_before", "labels_after", "probability_before", "probability_after")


def changes_to_dict(changes: Changes) -> dict[str, Any]:
    """The changes without the per-point arrays, as plain numbers, strings, lists and dictionaries."""
    return {
        "schema_version": SCHEMA_VERSION,
        "changes": [_change_to_dict(change) for change in changes.items],
        "emd": changes.emd,
        "points_before": len(changes.labels_before),
        "points_after": len(changes.labels_after),
        "config": changes.config.to_dict(),
        "diagnostics": dict(changes.diagnostics),
        "labels_file": LABELS_FILE,
    }


def save_changes(changes: Changes, folder: str | os.PathLike[str]) -> Path:
    """Writes the two files; the labels first, so that a `changes.json` that is there has its labels."""
    target = Path(folder)
    text = json.dumps(changes_to_dict(changes), indent=2, allow_nan=False)
    try:
        target.mkdir(parents=True, exist_ok=True)
        with atomic_write(target / LABELS_FILE) as file:
            np.savez_compressed(file, **{name: getattr(changes, name) for name in _POINT_ARRAYS})
        with atomic_write(target / CHANGES_FILE) as file:
            file.write(text.encode())
    except OSError as error:
        raise InputError(f"{target}: cannot write the changes there: {error.strerror or error}") from error
    return target


def load_changes(path: str | os.PathLike[str]) -> Changes:
    """Reads what `save_changes` wrote."""
    file = Path(path)
    if file.is_dir():
        file = file / CHANGES_FILE
    content = read_json_record(file, SCHEMA_VERSION, "run the detection again")
    arrays = _read_labels(file.with_name(LABELS_FILE))
    try:
        return Changes(
            **arrays,
            items=tuple(_change_from_dict(change) for change in content["changes"]),
            emd=float(content["emd"]),
            config=DetectionConfig.from_dict(content["config"]),
            diagnostics=content["diagnostics"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{file}: is not a complete record of changes ({error!r}); run the detection again") from error


def _read_labels(file: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in _POINT_ARRAYS}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{file}: cannot be read as the labels of the changes ({error}); run the detection again"
        ) from error


def _change_to_dict(change: Change) -> dict[str, Any]:
    return {
        "kind": change.kind,
        "probability": change.probability,
        "points": change.points,
        "mean": change.mean.tolist(),
        "covariance": change.covariance.tolist(),
        "box": {
            "centre": change.box.centre.tolist(),
            "extent": change.box.extent.tolist(),
            "rotation": change.box.rotation.tolist(),
        },
        "partner": change.partner,
    }


def _change_from_dict(content: dict[str, Any]) -> Change:
    box = {name: np.array(content["box"][name], float) for name in ("centre", "extent", "rotation")}
    return Change(
        kind=content["kind"],
        probability=float(content["probability"]),
        points=int(content["points"]),
        mean=np.array(content["mean"], float),
        covariance=np.array(content["covariance"], float),
        box=Box(**box),
        partner=content["partner"],
    )
