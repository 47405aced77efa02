"""The files of a record of changes: `changes.json` for people and scripts, `labels.npz` for the per-point arrays."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import atomic_write, load_archive, read_json_record, require_file, write_archive
from gmmjax.errors import InputError

SCHEMA_VERSION = 3
CHANGES_FILE = "changes.json"
LABELS_FILE = "labels.npz"

POINT_KINDS = (("labels", "i", "a whole number"), ("probability", "f", "a number"), ("unobserved", "b", "a bool"))
POINT_ARRAYS = tuple(f"{name}_{time}" for name, *_ in POINT_KINDS for time in ("before", "after"))
# Arrays that a record may be without.
OPTIONAL_FIGURES = ("distance", "level_of_detection", "significance")
OPTIONAL_ARRAYS = tuple(f"{name}_{time}" for name in OPTIONAL_FIGURES for time in ("before", "after"))
REMEDY = "run the detection again"


def finite_or_null(content: Any) -> Any:
    """Plain values for JSON, which has no NaN and no infinity: such numbers become None, at any depth.

    Args:
        content: numbers, strings, None, and lists, tuples and mappings of them.
    """
    if isinstance(content, Mapping):
        return {name: finite_or_null(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite_or_null(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def write_record(folder: str | os.PathLike[str], content: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Path:
    """Writes the two files; the labels first, so that a `changes.json` that is there has its labels.

    Args:
        folder: is made where needed.
        content: plain values, without NaN.
        arrays: the `POINT_ARRAYS`, and those of the `OPTIONAL_ARRAYS` that there are.

    Raises:
        InputError: the folder cannot be made or written.
    """
    target = Path(folder)
    text = json.dumps(content, indent=2, allow_nan=False)
    try:
        target.mkdir(parents=True, exist_ok=True)
        with atomic_write(target / LABELS_FILE) as file:
            if any(isinstance(values, np.memmap) for values in arrays.values()):
                # Larger than the memory, perhaps: written in parts, and without the time that compression takes.
                write_archive(file, arrays)
            else:
                np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        with atomic_write(target / CHANGES_FILE) as file:
            file.write(text.encode())
    except OSError as error:
        raise InputError(f"{target}: cannot write the changes there: {error.strerror or error}") from error
    return target


def read_record(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read what `write_record` wrote, from the folder or its `changes.json`.

    Raises:
        InputError: files that are missing, damaged, or of another schema version.
    """
    file = Path(path)
    if file.is_dir():
        file = file / CHANGES_FILE
    content = read_json_record(file, SCHEMA_VERSION, REMEDY)
    return content, _read_labels(file.with_name(LABELS_FILE))


def _read_labels(file: Path) -> dict[str, np.ndarray]:
    arrays = load_archive(require_file(file), REMEDY, (*POINT_ARRAYS, *OPTIONAL_ARRAYS))
    for time in ("before", "after"):
        count = arrays.get(f"labels_{time}", np.empty(0)).size
        for name, kinds, wanted in POINT_KINDS:
            values = arrays.get(f"{name}_{time}")
            if values is None or values.dtype.kind not in kinds or values.shape != (count,):
                found = "nothing" if values is None else f"{values.dtype} {list(values.shape)}"
                raise InputError(f"{file}: {name}_{time} must be {wanted} for each point, not {found}; {REMEDY}")
        # The comparisons are false for NaN; the margin is float32's rounding.
        probability = arrays[f"probability_{time}"]
        if not ((probability >= 0) & (probability <= 1 + 1e-6)).all():
            raise InputError(f"{file}: probability_{time} must lie between 0 and 1; {REMEDY}")
        for name in OPTIONAL_FIGURES:
            values = arrays.get(f"{name}_{time}")
            if values is not None and (values.dtype.kind != "f" or values.shape != (count,)):
                found = f"{values.dtype} {list(values.shape)}"
                raise InputError(f"{file}: {name}_{time} must be a number for each point, not {found}; {REMEDY}")
    return arrays
