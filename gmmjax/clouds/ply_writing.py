"""Writing clouds as PLY."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.colors import CHANNELS
from gmmjax.clouds.columns import AXES, rows_of_columns
from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.clouds.ply_header import TYPES
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.errors import InputError

NAMES = {kind: name for name, kind in TYPES.items()}


def write_ply(
    path: str | os.PathLike[str],
    points: npt.ArrayLike,
    *,
    colors: npt.ArrayLike | None = None,
    fields: Mapping[str, npt.ArrayLike] | None = None,
    comments: Sequence[str] = (),
) -> None:
    """Write a cloud as a binary little-endian PLY file, whole or not at all.

    Coordinates are written as double, colours as uchar, fields in their own type; 64-bit integers as int.

    Args:
        path: the file to write.
        points: finite coordinates [N, 3], in any unit.
        colors: red, green and blue [N, 3], uint8.
        fields: scalars [N] by name.
        comments: lines for the header.

    Raises:
        InputError: a shape, type or name that PLY cannot hold, or a folder that cannot be written.
        OSError: from writing, such as a full disk; a file that was there before is left as it was.
    """
    coordinates = as_finite_points(points, f"{path}: points")
    cloud = PointCloud.from_rows(coordinates, colors, fields, source=str(path))
    write_ply_parts(path, [cloud], len(cloud), comments)


def write_ply_parts(
    path: str | os.PathLike[str], parts: Iterable[PointCloud], count: int, comments: Sequence[str] = ()
) -> None:
    """Write as `write_ply` a cloud that comes in parts, such as one that is larger than the memory.

    Args:
        path: the file to write.
        parts: of the cloud, at least one; all with the same fields of the same types.
        count: points of all parts together.
        comments: lines for the header.

    Raises:
        InputError: as `write_ply`, from the parts, or they have another number of points.
        OSError: from writing, such as a full disk; a file that was there before is left as it was.
    """
    written, row_type = 0, None
    with atomic_write(path) as file:
        for part in parts:
            rows = _rows(part, str(path))
            if row_type is None:
                row_type = rows.dtype
                file.write(_header_text(row_type, count, comments, str(path)))
            assert rows.dtype == row_type
            file.write(rows.tobytes())
            written += len(rows)
        if written != count:
            raise InputError(f"{path}: {count} points were to be written, and there are {written}; read them again")


def _rows(cloud: PointCloud, path: str) -> np.ndarray:
    """The vertices as they are in the file."""
    columns = {axis: cloud.points[:, index] for index, axis in enumerate(AXES)}
    if cloud.colors is not None:
        columns |= {channel: cloud.colors[:, index] for index, channel in enumerate(CHANNELS)}
    for name, values in cloud.fields.items():
        if not re.fullmatch(r"[A-Za-z_][\w.-]*", name, re.ASCII) or name in columns:
            raise InputError(
                f"{path}: field {name!r} cannot be a PLY property; use a new name of letters, digits and _"
            )
        columns[name] = _writable(values, f"{path}: field {name!r}")
    return rows_of_columns(columns)


def _writable(values: np.ndarray, name: str) -> np.ndarray:
    """The values in a type that PLY has."""
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:
        limits = np.iinfo(np.int32)
        if values.size and (values.min() < limits.min or values.max() > limits.max):
            raise InputError(f"{name} runs from {values.min()} to {values.max()}, beyond PLY's int; make it float64")
        return values.astype(np.int32)
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype == np.float16:
        return values.astype(np.float32)
    if values.dtype.str[1:] not in NAMES:
        raise InputError(f"{name} is {values.dtype}, which PLY does not have; make it float64")
    return values


def _header_text(row_type: np.dtype, count: int, comments: Sequence[str], source: str) -> bytes:
    if any(character in comment for comment in comments for character in "\r\n"):
        raise InputError(f"{source}: a comment has a line break; give one comment for each line")
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {comment}" for comment in comments),
        f"element vertex {count}",
        *(f"property {NAMES[row_type[name].str[1:]]} {name}" for name in row_type.names or ()),
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode()
