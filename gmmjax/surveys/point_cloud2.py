"""The ROS message `sensor_msgs/PointCloud2`: points as rows of bytes with named fields, to frames and back."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import UInt8

from gmmjax.clouds import AXES, PointCloud, cloud_of_columns, field_columns, require_axes
from gmmjax.errors import InputError
from gmmjax.surveys.frame import Frame

# The constants of `sensor_msgs/PointField`: INT8 is 1, UINT8 is 2, ..., FLOAT64 is 8.
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
FLOAT32 = 7
PADDING = ("", "_")


@dataclass(frozen=True)
class PointField:
    """A field of a point: `count` numbers of a type at an offset, bytes from the start of the point."""

    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True, eq=False)
class PackedCloud:
    """The fields of a `sensor_msgs/PointCloud2` message beside its header, under the message's own names."""

    height: int
    width: int
    fields: tuple[PointField, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: UInt8[np.ndarray, " bytes"]
    is_dense: bool


def decode_cloud(message: Any, source: str) -> PointCloud:
    """The points of a message; those with NaN or inf are dropped and counted, whatever `is_dense` says.

    rgb or rgba, packed into four bytes, become colours; other fields keep their type, and one with a count above 1
    becomes `name_0`, `name_1`, ...

    Args:
        message: a `sensor_msgs/PointCloud2` message, a `PackedCloud`, or anything with these attributes.
        source: where it came from, for messages.

    Returns:
        The cloud, points row by row.

    Raises:
        InputError: no x, y, z, or a layout that its own bytes do not fit.
    """
    row_type, counts = _row_type(message, source)
    rows = _rows(message, row_type, source)
    columns: dict[str, np.ndarray] = {}
    for name, count in counts.items():
        columns |= field_columns(name, rows[name].reshape(len(rows), count))
    return cloud_of_columns(columns, source)


def decode_frame(message: Any, source: str, log_time: float) -> Frame:
    """The frame of a message; ordered where the height is above 1.

    Args:
        message: a `sensor_msgs/PointCloud2` message.
        source: where it came from, for messages.
        log_time: when it was recorded, seconds; taken where the header's stamp is zero.

    Raises:
        InputError: as `decode_cloud`.
    """
    cloud = decode_cloud(message, source)
    width, height = (int(message.width), int(message.height)) if message.height > 1 else (None, None)
    return Frame(cloud, header_time(message.header, log_time), str(message.header.frame_id), width, height)


def header_time(header: Any, log_time: float) -> float:
    """Seconds of a header's stamp, or the time of the record where the stamp is zero."""
    stamp = header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9 if stamp.sec or stamp.nanosec else log_time


def encode_cloud(frame: Frame) -> PackedCloud:
    """The points of a frame as float32 x, y, z; the pixels without a return of an ordered frame are NaN."""
    image = frame.cloud.points[None] if frame.width is None else frame.image()
    height, width = image.shape[:2]
    fields = tuple(PointField(axis, 4 * index, FLOAT32, 1) for index, axis in enumerate(AXES))
    data = image.astype("<f4").reshape(-1).view(np.uint8)
    return PackedCloud(height, width, fields, False, 12, 12 * width, data, bool(np.isfinite(image).all()))


def _row_type(message: Any, source: str) -> tuple[np.dtype, dict[str, int]]:
    """The type of a point with all its gaps, and how many numbers each field has."""
    # A count of zero is what old drivers write for one.
    fields = [
        PointField(str(field.name), int(field.offset), int(field.datatype), max(int(field.count), 1))
        for field in message.fields
        if field.name not in PADDING
    ]
    names = [field.name for field in fields]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{source}: declares the field(s) {', '.join(repeated)} more than once; rename one of them")
    require_axes((field.name for field in fields if field.count == 1), source)
    order = ">" if message.is_bigendian else "<"
    formats: list[tuple[str, tuple[int, ...]]] = []
    for field in fields:
        if field.datatype not in DATATYPES:
            raise InputError(f"{source}: field {field.name!r} has the unknown datatype {field.datatype} (1 to 8)")
        kind = order + DATATYPES[field.datatype]
        if field.offset + np.dtype(kind).itemsize * field.count > message.point_step:
            raise InputError(
                f"{source}: field {field.name!r} ends after byte {message.point_step}, the point_step; the message is "
                "damaged, or its writer is wrong"
            )
        formats.append((kind, (field.count,)))
    row_type = np.dtype(
        {
            "names": names,
            "formats": formats,
            "offsets": [field.offset for field in fields],
            "itemsize": int(message.point_step),
        }
    )
    return row_type, {field.name: field.count for field in fields}


def _rows(message: Any, row_type: np.dtype, source: str) -> np.ndarray:
    """The points as records [N]; copied only where the rows of the image are padded."""
    height, width, step = int(message.height), int(message.width), int(message.row_step)
    packed = width * row_type.itemsize
    if not height * width:
        return np.empty(0, row_type)
    # The step of a single row says nothing, and some drivers leave it at zero.
    step = packed if height == 1 else step
    data = np.ascontiguousarray(message.data, np.uint8)
    if step < packed or len(data) < step * (height - 1) + packed:
        raise InputError(
            f"{source}: declares {height} x {width} points of {row_type.itemsize} bytes and rows of {step}, "
            f"{len(data)} bytes are there; the message is cut off"
        )
    return np.ndarray((height, width), row_type, data, strides=(step, row_type.itemsize)).reshape(-1)
