"""Columns of numbers from a file, by name, as a point cloud."""

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds.cloud_file import RowBlock, native
from gmmjax.clouds.colors import CHANNELS, color_bytes
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.errors import InputError

AXES = ("x", "y", "z")
PACKED_COLORS = ("rgb", "rgba")
# What the channels of colour are called, in lower case.
COLOR_NAMES = (CHANNELS, ("r", "g", "b"), ("rf", "gf", "bf"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


def canonical_names(names: Sequence[str]) -> list[str]:
    """Rename columns: X, Y, Z to x, y, z, and the other names of all three colours to red, green, blue.

    Names that are there stay.
    """
    lower, renamed = [name.lower() for name in names], list(names)
    colors = next((own for own in COLOR_NAMES if all(lower.count(channel) == 1 for channel in own)), ())
    for old, new in (*zip(AXES, AXES, strict=True), *zip(colors, CHANNELS, strict=False)):
        if new not in names and lower.count(old) == 1:
            renamed[lower.index(old)] = new
    return renamed


def require_axes(names: Iterable[str], source: str) -> None:
    """Check that a file has coordinates.

    Args:
        names: the columns of the file.
        source: the file, for the message.

    Raises:
        InputError: x, y or z is missing; the message lists what there is.
    """
    present = list(names)
    if missing := [axis for axis in AXES if axis not in present]:
        raise InputError(
            f"{source}: has no {', '.join(missing)}, only: {', '.join(present) or 'nothing'}; "
            "rename the columns of the coordinates to x, y, z"
        )


def block_of_columns(columns: Mapping[str, np.ndarray], source: str) -> RowBlock:
    """Take x, y, z for the points, red, green, blue where all three are there for colours, and the rest for columns.

    Args:
        columns: numbers [N] by name.
        source: the file, for the message.

    Raises:
        InputError: a coordinate is missing.
    """
    require_axes(columns, source)
    # Signalling NaN, which damaged bytes may be, is NaN all the same; what is beyond float64 becomes inf.
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.stack([columns[axis].astype(np.float64) for axis in AXES], axis=1)
    colored = all(channel in columns for channel in CHANNELS)
    colors = np.stack([columns[channel] for channel in CHANNELS], axis=1) if colored else None
    used = {*AXES, *CHANNELS} if colored else set(AXES)
    return RowBlock(points, {name: values for name, values in columns.items() if name not in used}, colors)


def cloud_of_columns(columns: Mapping[str, np.ndarray], source: str) -> PointCloud:
    """Make a cloud of columns, as `block_of_columns`; what is neither coordinate nor colour becomes a field.

    Args:
        columns: numbers [N] by name.
        source: the file.

    Raises:
        InputError: a coordinate is missing, or the colours have no known range.
    """
    block = block_of_columns(columns, source)
    colors = None if block.colors is None else color_bytes(block.colors, source)
    return PointCloud.from_rows(
        block.points, colors, {name: native(values) for name, values in block.columns.items()}, source
    )


def field_columns(name: str, block: np.ndarray) -> dict[str, np.ndarray]:
    """Split one field of the Point Cloud Library into columns [N] by name.

    Args:
        name: of the field. rgb and rgba, packed into four bytes, become red, green and blue.
        block: its numbers [N, count], of either byte order; with a count above 1 they become `name_0`, `name_1`, ...
    """
    count = block.shape[1]
    if count == 1 and name.lower() in PACKED_COLORS and block.dtype.itemsize == 4:
        packed = native(block[:, 0]).view(np.uint32)
        shifts = zip(CHANNELS, (16, 8, 0), strict=True)
        return {channel: (packed >> shift & 255).astype(np.uint8) for channel, shift in shifts}
    if count == 1:
        return {name: block[:, 0]}
    return {f"{name}_{index}": block[:, index] for index in range(count)}


def rows_of_columns(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Join columns of one shape to records of that shape, little endian, with the names of the columns."""
    row_type = np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    rows = np.empty(next(iter(columns.values())).shape, row_type)
    for name, values in columns.items():
        rows[name] = values
    return rows


def cast_column(values: Float64[np.ndarray, "..."], dtype: np.dtype, name: str, source: str) -> np.ndarray:
    """Cast numbers read from text to the type that the header declares, in the machine's byte order.

    Args:
        values: the numbers as read.
        dtype: the declared type.
        name: the column, for the message.
        source: the file, for the message.

    Raises:
        InputError: a fraction, NaN or a number out of range in an integer column.
    """
    target = dtype.newbyteorder("=")
    if target.kind == "f":
        with np.errstate(over="ignore"):
            return values.astype(target)
    limits = np.iinfo(target)
    fits = (values == np.rint(values)) & (values >= float(limits.min)) & (values <= float(limits.max))
    if not fits.all():
        raise InputError(
            f"{source}: column {name!r} is declared {target} but holds {values[~fits][0]}; declare it as float"
        )
    with np.errstate(invalid="ignore"):
        return values.astype(target)


def free_name(name: str, taken: Collection[str]) -> str:
    """Rename a column of an input whose name a result needs: `input_NAME`, with a number where that is taken."""
    candidates = (f"input_{name}{suffix}" for suffix in itertools.chain([""], (f"_{n}" for n in itertools.count(2))))
    return next(candidate for candidate in candidates if candidate not in taken)
