"""Intrinsics on disk: gmmjax's JSON, Open3D's, and the camera_info of ROS."""

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import MAX_SETTINGS, atomic_write, read_bytes, read_json
from gmmjax.errors import LARGEST_INTEGER, InputError, shown, warn
from gmmjax.surveys.intrinsics import Intrinsics

NAMES = ("fx", "fy", "cx", "cy", "width", "height")
EXAMPLE = '{"fx": 186.4, "fy": 206.4, "cx": 111.5, "cy": 85, "width": 224, "height": 171}'
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def read_intrinsics(path: str | os.PathLike[str]) -> Intrinsics:
    """The intrinsics in a file.

    Args:
        path: JSON with `fx`, `fy`, `cx`, `cy`, `width` and `height` in pixels; Open3D's JSON (`intrinsic_matrix`,
            column by column); or a ROS camera_info in YAML, as a calibration file (`camera_matrix`) or a message (`K`).

    Raises:
        InputError: the file cannot be read, is of none of these, lacks a number, or holds what no camera has.

    Warns:
        InputWarning: the file has coefficients of distortion; depth images are taken as undistorted.
    """
    source = str(path)
    data = read_bytes(path, MAX_SETTINGS)
    if data.lstrip().startswith(b"{"):
        content = read_json(path, f"intrinsics are JSON such as {EXAMPLE}")
    else:
        content = _camera_info(data.decode("utf-8", "replace"))
    numbers = _numbers(content)
    if missing := [name for name in NAMES if name not in numbers]:
        raise InputError(
            f"{source}: has no {', '.join(missing)}; intrinsics are JSON such as {EXAMPLE}, Open3D's JSON, or a ROS "
            "camera_info"
        )
    if any(_is_number(value) and value != 0 for value in _items(content.get("D"))):
        warn(f"{source}: has coefficients of distortion, which are not applied; give depth images without distortion")
    try:
        fx, fy, cx, cy = (_number(name, numbers[name]) for name in NAMES[:4])
        return Intrinsics(fx, fy, cx, cy, _pixels(numbers["width"]), _pixels(numbers["height"]))
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def write_intrinsics(path: str | os.PathLike[str], intrinsics: Intrinsics) -> None:
    """Write intrinsics as JSON, whole or not at all; `read_intrinsics` reads them back, to the last digit.

    Args:
        path: the file, ending with `.json`.
        intrinsics: what to write.

    Raises:
        InputError: another ending, or a folder that cannot be written.
    """
    if Path(path).suffix.lower() != ".json":
        raise InputError(f"{path}: intrinsics are written as .json; rename it")
    with atomic_write(path) as file:
        file.write((json.dumps(asdict(intrinsics), indent=2) + "\n").encode())


def _numbers(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """The six numbers by name, as far as they are there."""
    # Open3D's camera parameters hold the intrinsics under this name.
    inner = content.get("intrinsic", content)
    if not isinstance(inner, Mapping):
        return {}
    if _is_matrix(inner.get("intrinsic_matrix")):
        return {**inner, **_of_matrix(np.reshape(inner["intrinsic_matrix"], (3, 3)).T)}
    if _is_matrix(inner.get("K")):
        return {**inner, **_of_matrix(np.reshape(inner["K"], (3, 3)))}
    return inner


def _is_matrix(values: Any) -> bool:
    return len(_items(values)) == 9 and all(_is_number(value) for value in values)


def _items(values: Any) -> Sequence[Any]:
    return values if isinstance(values, list) else []


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(name: str, value: Any) -> float:
    if not _is_number(value):
        raise InputError(f"{name}={shown(value)} must be a number of pixels")
    return float(value)


def _of_matrix(matrix: np.ndarray) -> dict[str, float]:
    return dict(zip(NAMES[:4], (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2))), strict=True))


def _pixels(value: Any) -> int:
    if not _is_number(value) or not abs(value) <= LARGEST_INTEGER or value != int(value):
        raise InputError(f"a size of {shown(value)} pixels must be a whole number")
    return int(value)


def _camera_info(text: str) -> dict[str, Any]:
    """Size, matrix and distortion of a ROS camera_info in YAML, without a parser of YAML."""
    content: dict[str, Any] = {}
    for name in ("width", "height"):
        # At the start of a line: those of the region of interest are indented.
        if found := re.search(rf"^(?:image_)?{name}:\s*(\d+)\s*$", text, re.MULTILINE):
            content[name] = float(found[1])
    for name, keys in (("K", "camera_matrix|K|k"), ("D", "distortion_coefficients|D|d")):
        if found := re.search(rf"^(?:{keys}):((?:.*\n?)(?:(?:[ \t-].*)?\n?)*)", text, re.MULTILINE):
            # A calibration file has the numbers of rows and columns before them.
            values = found[1].rsplit("data:", 1)[-1]
            content[name] = [float(number) for number in re.findall(NUMBER, re.sub(r"(?m)^\s*- ", " ", values))]
    return content
