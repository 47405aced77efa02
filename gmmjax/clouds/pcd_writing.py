"""Writing clouds and ordered depth frames as PCD, the format of the Point Cloud Library (version 0.7)."""

import os
import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.columns import AXES
from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.clouds.ordered_frame import QUATERNION_TOLERANCE
from gmmjax.errors import InputError

AT_ORIGIN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
COLORS = "rgb"


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
    array = np.asarray(points)
    grid = array.shape[:-1]
    if array.ndim == 3 and array.shape[2] == 3 and array.dtype.kind == "f":
        empty = np.isnan(array).all(axis=2)
        as_finite_points(array[~empty], f"{path}: points")
    else:
        grid = as_finite_points(array, f"{path}: points").shape[:1]
    coordinates = array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)
    columns = {axis: coordinates[..., index] for index, axis in enumerate(AXES)}
    if colors is not None:
        columns[COLORS] = _packed(np.asarray(colors), grid, str(path))
    for name, values in (fields or {}).items():
        columns[name] = _checked_field(name, np.asarray(values), grid, columns, str(path))
    rows = np.empty(grid, np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in columns.items()]))
    for name, values in columns.items():
        rows[name] = values
    header = _header_text(rows, _checked_viewpoint(viewpoint, str(path)))
    with atomic_write(path) as file:
        file.write(header)
        file.write(rows.tobytes())


def viewpoint_of(pose: Float64[np.ndarray, "4 4"]) -> tuple[float, ...]:
    """Position and quaternion w, x, y, z, as PCD has them.

    Args:
        pose: sensor to the frame of the points, rigid.
    """
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return tuple(float(number) for number in (*pose[:3, 3], w, x, y, z))


def _packed(colors: np.ndarray, grid: tuple[int, ...], source: str) -> np.ndarray:
    """Red, green and blue in the lower three bytes of a number, as the Point Cloud Library has them."""
    if colors.dtype != np.uint8 or colors.shape != (*grid, 3):
        raise InputError(f"{source}: colors must be uint8 {[*grid, 3]}, not {colors.dtype} {list(colors.shape)}")
    red, green, blue = np.moveaxis(colors.astype(np.uint32), -1, 0)
    return np.asarray(red << 16 | green << 8 | blue)


def _checked_field(
    name: str, values: np.ndarray, grid: tuple[int, ...], columns: Mapping[str, np.ndarray], source: str
) -> np.ndarray:
    # `_` is padding, and names end at blanks.
    if not re.fullmatch(r"[A-Za-z][\w.-]*", name, re.ASCII) or name in columns or name in (COLORS, "rgba"):
        raise InputError(f"{source}: field {name!r} cannot be a PCD field; use a new name of letters, digits and _")
    if values.dtype.kind not in "fiub" or values.shape != grid:
        raise InputError(
            f"{source}: field {name!r} must be numbers {list(grid)}, not {values.dtype} {list(values.shape)}"
        )
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        return values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    return values


def _checked_viewpoint(viewpoint: tuple[float, ...], source: str) -> list[float]:
    numbers = np.asarray(viewpoint, np.float64)
    if numbers.shape != (7,) or not np.isfinite(numbers).all():
        raise InputError(f"{source}: viewpoint {viewpoint} must be a position x y z and a quaternion w x y z")
    if np.abs(numbers[3:]).max() > 2 or abs(float(np.linalg.norm(numbers[3:])) - 1) > QUATERNION_TOLERANCE:
        raise InputError(f"{source}: viewpoint {viewpoint}: the quaternion w x y z must have length 1")
    return [float(number) for number in numbers]


def _header_text(rows: np.ndarray, viewpoint: list[float]) -> bytes:
    assert rows.dtype.fields is not None
    kinds = [kind for kind, *_ in rows.dtype.fields.values()]
    height, width = rows.shape if rows.ndim == 2 else (1, len(rows))
    lines = {
        "VERSION": "0.7",
        "FIELDS": " ".join(rows.dtype.fields),
        "SIZE": " ".join(str(kind.itemsize) for kind in kinds),
        "TYPE": " ".join(kind.kind.upper() for kind in kinds),
        "COUNT": " ".join("1" for _ in kinds),
        "WIDTH": str(width),
        "HEIGHT": str(height),
        "VIEWPOINT": " ".join(f"{number:.17g}" for number in viewpoint),
        "POINTS": str(rows.size),
        "DATA": "binary",
    }
    text = "# .PCD v0.7 - Point Cloud Data file format\n" + "".join(f"{key} {value}\n" for key, value in lines.items())
    return text.encode()
