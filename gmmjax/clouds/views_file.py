"""Sensor views on disk: JSON for people, NPZ for programs, with the same three names."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds.arrays import load_archive
from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.files import read_json, require_file
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError

NAMES = ("poses", "field_of_view", "max_range")
SUFFIXES = (".json", ".npz")
REMEDY = "write it with gmmjax.clouds.write_views"


def read_views(path: str | os.PathLike[str]) -> SensorViews:
    """The sensor views in a file; its ending tells the format.

    Args:
        path: `.json`: an object with `poses` (list of 4 x 4 matrices, camera to world, each a list of rows),
            `field_of_view` (horizontal and vertical, degrees) and `max_range`; or `.npz` with arrays of these names.

    Returns:
        The views.

    Raises:
        InputError: the file cannot be read, lacks one of the three, or holds what no sensor has; it names the file.
    """
    file = require_file(path)
    _check_suffix(file)
    content = _read_npz(file) if file.suffix.lower() == ".npz" else _read_json(file)
    if missing := [name for name in NAMES if name not in content]:
        raise InputError(
            f"{file}: has no {', '.join(missing)}, only: {', '.join(content) or 'nothing'}; sensor views are "
            "poses [V, 4, 4] (camera to world), field_of_view [horizontal, vertical] (degrees) and max_range"
        )
    field_of_view, max_range = (content[name] for name in NAMES[1:])
    try:
        return SensorViews(content["poses"], field_of_view, max_range)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error


def write_views(path: str | os.PathLike[str], views: SensorViews) -> None:
    """Write sensor views, whole or not at all; `read_views` reads them back, to the last digit.

    Args:
        path: the file, ending with `.json` or `.npz`.
        views: what to write.

    Raises:
        InputError: another ending, or a folder that cannot be written.
    """
    _check_suffix(Path(path))
    with atomic_write(path) as file:
        if Path(path).suffix.lower() == ".npz":
            np.savez(
                file,
                poses=views.poses,
                field_of_view=np.array(views.field_of_view),
                max_range=np.array(float(views.max_range)),
            )
        else:
            content = {
                "poses": views.poses.tolist(),
                "field_of_view": list(views.field_of_view),
                "max_range": float(views.max_range),
            }
            file.write((json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def _check_suffix(file: Path) -> None:
    if file.suffix.lower() not in SUFFIXES:
        raise InputError(f"{file}: sensor views are kept in files that end with {' or '.join(SUFFIXES)}; rename it")


def _read_json(file: Path) -> Mapping[str, Any]:
    content = read_json(file, REMEDY)
    if not isinstance(content, dict):
        raise InputError(f"{file}: must hold an object with {', '.join(NAMES)}, not a {type(content).__name__}")
    return content


def _read_npz(file: Path) -> Mapping[str, Any]:
    content: dict[str, Any] = dict(load_archive(file, REMEDY, NAMES))
    if "max_range" in content and content["max_range"].size == 1:
        content["max_range"] = content["max_range"].item()
    return content
