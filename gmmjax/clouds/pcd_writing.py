"""Writing clouds and ordered depth frames as PCD, the format of the Point Cloud Library (version 0.7)."""

import dataclasses
import math
import os
import re
from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.columns import AXES, PACKED_COLORS, rows_of_columns
from gmmjax.clouds.coordinates import as_finite_points, require_array
from gmmjax.clouds.ordered_frame import AT_ORIGIN, pose_of
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.errors import InputError


@dataclasses.dataclass(frozen=True)
class PcdForm:
    """Form in which a cloud is written.

    Attributes:
        shape: how many points; or rows and columns of an ordered frame, whose parts have the numbers of their pixels as
            rows, and whose other pixels are NaN, or 0 in columns of whole numbers.
        viewpoint: as of `write_pcd`.
        dtype: of the coordinates, float32 or float64.
        empty: whole numbers that pixels without a return have in place of 0, by the names of the fields.
    """

    shape: tuple[int, ...]
    viewpoint: tuple[float, ...] = AT_ORIGIN
    dtype: np.dtype = np.dtype(np.float64)
    empty: Mapping[str, int] = dataclasses.field(default_factory=dict)


def write_pcd(
    path: str | os.PathLike[str],
    points: npt.ArrayLike,
    *,
    viewpoint: tuple[float, ...] = AT_ORIGIN,
    colors: npt.ArrayLike | None = None,
    fields: Mapping[str, npt.ArrayLike] | None = None,
) -> None:
    """Write a cloud as a binary PCD file, whole or not at all.

    Coordinates are written as float32, which every reader knows, or as float64, as they come; other numbers as float64.

    Args:
        path: the file to write.
        points: finite coordinates [N, 3] in any unit, in no order; or an ordered frame [H, W, 3], with NaN where a
            pixel has no return.
        viewpoint: where the sensor stood in the frame of the points: position x, y, z and orientation as a unit
            quaternion w, x, y, z. `viewpoint_of` makes one of a pose. The default is for points in the coordinates of
            the sensor.
        colors: red, green and blue, uint8, in the shape of the points.
        fields: scalars by name, in the shape of the points without its last axis.

    Raises:
        InputError: a shape, type, name or viewpoint that PCD cannot hold, or a folder that cannot be written.
        OSError: from writing, such as a full disk; a file that was there before is left as it was.
    """
    require_array(points, f"{path}: points")
    array = np.asarray(points)
    if array.ndim == 3 and array.shape[2] == 3 and array.dtype.kind == "f":
        as_finite_points(array[~np.isnan(array).all(axis=2)], f"{path}: points")
    else:
        as_finite_points(array, f"{path}: points")
    coordinates = array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)
    rows = _rows(coordinates, colors, fields or {}, str(path))
    header = _header_text(rows.dtype, PcdForm(rows.shape, viewpoint), str(path))
    with atomic_write(path) as file:
        file.write(header)
        file.write(rows.tobytes())


def write_pcd_parts(path: str | os.PathLike[str], parts: Iterable[PointCloud], form: PcdForm) -> None:
    """Write as `write_pcd` a cloud that comes in parts, such as one that is larger than the memory.

    Args:
        path: the file to write.
        parts: of the cloud, at least one, in the order of their rows; all with the same fields of the same types.
        form: how they are written.

    Raises:
        InputError: as `write_pcd`, from the parts, or they have another number of points.
        OSError: from writing, such as a full disk; a file that was there before is left as it was.
    """
    written, no_return = 0, None
    with atomic_write(path) as file:
        for part in parts:
            rows = _rows(part.points.astype(form.dtype), part.colors, part.fields, str(path))
            if no_return is None:
                no_return = _no_return(rows.dtype, form.empty)
                file.write(_header_text(rows.dtype, form, str(path)))
            if len(form.shape) == 2:
                image = np.repeat(no_return, int(part.rows[-1]) + 1 - written)
                image[part.rows - written] = rows
                rows = image
            file.write(rows.tobytes())
            written += len(rows)
        left = math.prod(form.shape) - written
        if no_return is None or left < 0 or (left and len(form.shape) == 1):
            raise InputError(
                f"{path}: not all of {math.prod(form.shape)} points are there to be written; read them again"
            )
        file.write(np.repeat(no_return, left).tobytes())


def _rows(
    coordinates: np.ndarray, colors: npt.ArrayLike | None, fields: Mapping[str, npt.ArrayLike], source: str
) -> np.ndarray:
    """The points as they are in the file."""
    grid = coordinates.shape[:-1]
    columns = {axis: coordinates[..., index] for index, axis in enumerate(AXES)}
    if colors is not None:
        columns[PACKED_COLORS[0]] = _packed(np.asarray(colors), grid, source)
    for name, values in fields.items():
        # `_` is padding, and names end at blanks.
        if not re.fullmatch(r"[A-Za-z][\w.-]*", name, re.ASCII) or name in columns or name in PACKED_COLORS:
            raise InputError(f"{source}: field {name!r} cannot be a PCD field; use a new name of letters, digits and _")
        columns[name] = _writable(name, np.asarray(values), grid, source)
    return rows_of_columns(columns)


def _no_return(row_type: np.dtype, empty: Mapping[str, int]) -> np.ndarray:
    """A pixel without a return, as one row."""
    row = np.zeros(1, row_type)
    for name in row_type.names or ():
        row[name] = np.nan if row_type[name].kind == "f" else empty.get(name, 0)
    return row


def _packed(colors: np.ndarray, grid: tuple[int, ...], source: str) -> np.ndarray:
    """Red, green and blue in the lower three bytes of a number, as the Point Cloud Library has them."""
    if colors.dtype != np.uint8 or colors.shape != (*grid, 3):
        raise InputError(f"{source}: colors must be uint8 {[*grid, 3]}, not {colors.dtype} {list(colors.shape)}")
    red, green, blue = np.moveaxis(colors.astype(np.uint32), -1, 0)
    return np.asarray(red << 16 | green << 8 | blue)


def _writable(name: str, values: np.ndarray, grid: tuple[int, ...], source: str) -> np.ndarray:
    """The values in a type that PCD has."""
    if values.dtype.kind not in "fiub" or values.shape != grid:
        raise InputError(
            f"{source}: field {name!r} must be numbers {list(grid)}, not {values.dtype} {list(values.shape)}"
        )
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        return values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    return values


def _header_text(row_type: np.dtype, form: PcdForm, source: str) -> bytes:
    if pose_of(form.viewpoint) is None:
        raise InputError(
            f"{source}: viewpoint {form.viewpoint} must be a position x y z and a quaternion w x y z of length 1"
        )
    kinds = [row_type[name] for name in row_type.names or ()]
    height, width = form.shape if len(form.shape) == 2 else (1, *form.shape)
    lines = {
        "VERSION": "0.7",
        "FIELDS": " ".join(row_type.names or ()),
        "SIZE": " ".join(str(kind.itemsize) for kind in kinds),
        "TYPE": " ".join(kind.kind.upper() for kind in kinds),
        "COUNT": " ".join("1" for _ in kinds),
        "WIDTH": str(width),
        "HEIGHT": str(height),
        "VIEWPOINT": " ".join(f"{number:.17g}" for number in form.viewpoint),
        "POINTS": str(height * width),
        "DATA": "binary",
    }
    text = "# .PCD v0.7 - Point Cloud Data file format\n" + "".join(f"{key} {value}\n" for key, value in lines.items())
    return text.encode()
