"""Reading PCD files, the format of the Point Cloud Library (version 0.7)."""

import dataclasses
import functools
import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8

from gmmjax.clouds.cloud_file import CloudFile, RowBlock
from gmmjax.clouds.columns import (
    AXES,
    block_of_columns,
    canonical_names,
    cast_column,
    cloud_of_columns,
    field_columns,
    require_axes,
)
from gmmjax.clouds.files import read_bytes, require_file
from gmmjax.clouds.number_table import NumberedLines, cut_off, parse_table
from gmmjax.clouds.ordered_frame import AT_ORIGIN, frame_views, pose_of
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.records import stored_records
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError

ENCODINGS = ("ascii", "binary", "binary_compressed")
TYPES = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
PADDING = "_"
# Bytes of the longest header.
LONGEST_HEADER = 1 << 20
# No three bytes of LZF stand for more than 264 bytes: data that claim more are damaged.
LONGEST_EXPANSION = 90


@dataclass(frozen=True)
class Field:
    """`count` numbers of a point; the name `_` is padding."""

    name: str
    dtype: np.dtype
    count: int

    @property
    def size(self) -> int:
        """Bytes in a point."""
        return self.dtype.itemsize * self.count


@dataclass(frozen=True)
class PcdHeader:
    """What a PCD file declares.

    Attributes:
        fields: in the order of the file.
        points: how many points, WIDTH times HEIGHT.
        encoding: ascii, binary or binary_compressed.
        body: the byte after the header.
        lines: how many lines the header has.
        width: columns of an ordered image, or None where the points are in no order.
        stated: position and quaternion of the sensor, as declared; empty where they are no numbers.
    """

    fields: tuple[Field, ...]
    points: int
    encoding: str
    body: int
    lines: int
    width: int | None
    stated: tuple[float, ...]

    @property
    def grid(self) -> tuple[int, int] | None:
        """Rows and columns of an ordered image; None where the points are in no order."""
        return None if self.width is None else (self.points // self.width, self.width)

    @property
    def viewpoint(self) -> tuple[float, ...]:
        """Position and quaternion of the sensor, those of the origin where none are stated."""
        return AT_ORIGIN if pose_of(self.stated) is None else self.stated

    @property
    def pose(self) -> Float64[np.ndarray, "4 4"]:
        """Of the sensor, in the frame of the points."""
        pose = pose_of(self.viewpoint)
        assert pose is not None
        return pose

    @property
    def dtype(self) -> np.dtype:
        """The type that holds all coordinates."""
        axes = [field.dtype for field in self.fields if field.name in AXES]
        return np.result_type(*axes) if axes else np.dtype(np.float64)

    @property
    def point_size(self) -> int:
        """Bytes of a point that is not compressed."""
        return sum(field.size for field in self.fields)


@dataclass(frozen=True, eq=False, kw_only=True)
class PcdFile(CloudFile):
    """A PCD file with the encoding binary.

    Attributes:
        header: of the file.
    """

    header: PcdHeader

    @functools.cached_property
    def views(self) -> SensorViews | None:
        """The view of an ordered frame, which is read for it; see `frame_views`."""
        return None if self.header.width is None else self.read().views

    def read(self) -> PointCloud:
        """All points, in memory.

        Raises:
            InputError: as `row_blocks`, or the memory does not hold them.
        """
        return _with_views(self._read(self.row_blocks()), self.header)

    def blocks(self) -> Iterator[RowBlock]:
        """All points, some at a time.

        Raises:
            InputError: the file is cut off.
        """
        row_type = np.dtype((np.void, self.header.point_size))
        for rows in stored_records(self.path, self.header.body, row_type, self.count):
            table = rows.view(np.uint8).reshape(len(rows), row_type.itemsize)
            blocks = _split_bytes(table, self.header.fields)
            yield block_of_columns(_columns(self.header, blocks), str(self.path))


def open_pcd(path: str | os.PathLike[str]) -> PcdFile | PointCloud:
    """The points of a PCD file: ascii, binary or binary_compressed.

    rgb or rgba, packed into four bytes, become colours; the other fields keep their type, and one with COUNT above 1
    becomes `name_0`, `name_1`, ...; padding is left out. Organised clouds are flattened row by row, and pixels without
    a depth (NaN) are dropped and counted.

    An organised cloud (HEIGHT above 1) whose VIEWPOINT is the pose of the pinhole camera that took it gets `views`; see
    `frame_views`.

    Args:
        path: the file.

    Returns:
        The file, of which the header is read; where it is ascii or compressed, its points in the order of the file.

    Raises:
        InputError: the file cannot be read, is no PCD, is cut off, or has no x, y, z.
    """
    file, source = require_file(path), str(path)
    written = SourceFile.of(file)
    header = read_layout(path)
    require_axes((field.name for field in header.fields if field.count == 1), source)
    if header.encoding == "binary":
        available = max(written.size - header.body, 0) // header.point_size
        if available < header.points:
            raise cut_off(header.points, available, "points", source)
        return PcdFile(path=file, source=written, count=header.points, header=header)
    blocks_of = _ascii_blocks if header.encoding == "ascii" else _compressed_blocks
    blocks = blocks_of(read_bytes(file), header, source)
    return _with_views(cloud_of_columns(_columns(header, blocks), source), header)


def _columns(header: PcdHeader, blocks: list[np.ndarray]) -> dict[str, np.ndarray]:
    """The columns of a table of all fields."""
    columns: dict[str, np.ndarray] = {}
    for field, block in zip(header.fields, blocks, strict=True):
        if field.name != PADDING:
            columns |= field_columns(field.name, block)
    return columns


def _with_views(cloud: PointCloud, header: PcdHeader) -> PointCloud:
    if header.width is None:
        return cloud
    return dataclasses.replace(cloud, views=frame_views(cloud.points, cloud.rows, header.width, header.stated))


def read_layout(path: str | os.PathLike[str]) -> PcdHeader:
    """What a PCD file says beside its points.

    Raises:
        InputError: the file cannot be read, or is no PCD.
    """
    file = require_file(path)
    with file.open("rb") as stream:
        return parse_header(stream.read(LONGEST_HEADER), str(file))


def parse_header(data: bytes, source: str) -> PcdHeader:
    """The header at the start of a PCD file.

    Args:
        data: the file.
        source: its name, for messages.

    Returns:
        What the header declares.

    Raises:
        InputError: no PCD file, or a header line that is missing or wrong.
    """
    entries: dict[str, list[str]] = {}
    position = lines = 0
    while "DATA" not in entries:
        end = data.find(b"\n", position)
        line = data[position : end if end >= 0 else len(data)].decode("ascii", "replace").strip()
        position, lines = end + 1, lines + 1
        key, *values = line.split() or [""]
        if key and not key.startswith("#"):
            if key not in ("VERSION", "FIELDS", "COLUMNS", *_NUMBERS, "VIEWPOINT", "TYPE", "DATA"):
                raise InputError(f"{source}: line {lines} of the PCD header is not understood: {line[:80]!r}")
            entries["FIELDS" if key == "COLUMNS" else key] = values
        if end < 0:
            break
    if entries.get("DATA", [""])[:1] not in [[encoding] for encoding in ENCODINGS]:
        raise InputError(
            f"{source}: the PCD header has no line DATA with one of {', '.join(ENCODINGS)}; is it cut off?"
        )
    body = position if position else len(data)
    points, encoding = _point_count(entries, source), entries["DATA"][0]
    viewpoint = _viewpoint(entries.get("VIEWPOINT", []))
    return PcdHeader(_fields(entries, source), points, encoding, body, lines, _image_width(entries, source), viewpoint)


_NUMBERS = ("SIZE", "COUNT", "WIDTH", "HEIGHT", "POINTS")


def _numbers(entries: dict[str, list[str]], key: str, length: int, source: str) -> list[int]:
    values = entries.get(key, [])
    if len(values) != length or not all(value.isascii() and value.isdigit() and len(value) < 10 for value in values):
        raise InputError(
            f"{source}: the PCD header needs a line {key} with {length} whole number(s), "
            f"not {' '.join(values)[:80]!r}; export the cloud again"
        )
    return [int(value) for value in values]


def _fields(entries: dict[str, list[str]], source: str) -> tuple[Field, ...]:
    names = entries.get("FIELDS", [])
    types = entries.get("TYPE", [])
    sizes = _numbers(entries, "SIZE", len(names), source)
    counts = _numbers(entries, "COUNT", len(names), source) if "COUNT" in entries else [1] * len(names)
    if len(types) != len(names) or not all(pair in TYPES for pair in zip(types, sizes, strict=True)):
        raise InputError(
            f"{source}: the PCD header's TYPE {' '.join(types)[:80]!r} and SIZE do not fit its FIELDS "
            f"{' '.join(names)[:80]!r}; TYPE is F with SIZE 4 or 8, or I or U with SIZE 1, 2, 4 or 8"
        )
    kept = [name for name in names if name != PADDING]
    if repeated := {name for name in kept if kept.count(name) > 1}:
        raise InputError(f"{source}: the PCD header declares {sorted(repeated)} more than once; rename one of them")
    return tuple(
        Field(name, np.dtype(f"<{kind.lower()}{size}"), count)
        for name, kind, size, count in zip(canonical_names(names), types, sizes, counts, strict=True)
    )


def _point_count(entries: dict[str, list[str]], source: str) -> int:
    declared = _numbers(entries, "POINTS", 1, source)[0] if "POINTS" in entries else None
    if "WIDTH" not in entries and declared is not None:
        return declared
    height = _numbers(entries, "HEIGHT", 1, source)[0] if "HEIGHT" in entries else 1
    area = _numbers(entries, "WIDTH", 1, source)[0] * height
    if declared not in (None, area):
        raise InputError(f"{source}: POINTS is {declared}, WIDTH times HEIGHT is {area}; correct the PCD header")
    return area


def _image_width(entries: dict[str, list[str]], source: str) -> int | None:
    """WIDTH where HEIGHT tells that the points are the rows of an image."""
    if "WIDTH" not in entries or "HEIGHT" not in entries or _numbers(entries, "HEIGHT", 1, source)[0] < 2:
        return None
    return _numbers(entries, "WIDTH", 1, source)[0]


def _viewpoint(values: list[str]) -> tuple[float, ...]:
    try:
        return tuple(float(value) for value in values)
    except ValueError:
        return ()


def _ascii_blocks(data: bytes, header: PcdHeader, source: str) -> list[np.ndarray]:
    lines = NumberedLines(data[header.body :], first=header.lines + 1, comments=(b"#",))
    width = sum(field.count for field in header.fields)
    table = parse_table(lines, width, source, count=header.points, what="points")
    ends = np.cumsum([field.count for field in header.fields])
    blocks = np.split(table, ends[:-1], axis=1)
    return [
        # What stands in a padding column need not be a number of its type.
        block if field.name == PADDING else cast_column(block, field.dtype, field.name, source)
        for field, block in zip(header.fields, blocks, strict=True)
    ]


def _compressed_blocks(data: bytes, header: PcdHeader, source: str) -> list[np.ndarray]:
    """Blocks of one field each; writers other than the Point Cloud Library's may store the padding too."""
    if len(data) < header.body + 8:
        raise cut_off(header.points, 0, "points", source)
    compressed, size = (int(number) for number in np.frombuffer(data, "<u4", 2, header.body))
    start = header.body + 8
    if len(data) - start < compressed:
        raise InputError(
            f"{source}: declares {header.points} points in {compressed} compressed bytes, {len(data) - start} bytes "
            "are there; the file is cut off, copy it again"
        )
    with_padding = header.point_size
    without_padding = sum(field.size for field in header.fields if field.name != PADDING)
    if size not in (header.points * with_padding, header.points * without_padding):
        raise InputError(
            f"{source}: holds {size} bytes for {header.points} points of {without_padding} bytes; the header is wrong"
        )
    try:
        expanded = expand_lzf(data[start : start + compressed], size)
    except ValueError as error:
        raise InputError(f"{source}: the compressed data are damaged ({error}); copy or export it again") from error
    blocks, offset = [], 0
    for field in header.fields:
        stored = field.name != PADDING or size == header.points * with_padding
        width = field.size if stored else 0
        block = np.frombuffer(expanded, np.uint8, header.points * width, offset)
        blocks.append(block.view(field.dtype).reshape(header.points, width // field.dtype.itemsize))
        offset += header.points * width
    return blocks


def expand_lzf(data: bytes, size: int) -> bytes:
    """Expand data of LibLZF (Lehmann, LibLZF 3.6), which binary_compressed data are.

    A control byte below 32 starts a run of that many bytes plus one, copied as they are. Any other one refers back:
    its top three bits are the length (7: a further byte is added) less two, its other bits and the next byte the
    distance less one.

    Args:
        data: compressed bytes.
        size: how many bytes they stand for.

    Returns:
        The `size` bytes.

    Raises:
        ValueError: the data end early, refer back to before their start, or stand for another number of bytes.
    """
    if size > LONGEST_EXPANSION * len(data):
        raise ValueError(f"{len(data)} compressed bytes cannot stand for {size}")
    expanded = bytearray()
    position, end = 0, len(data)
    try:
        while position < end:
            control = data[position]
            position += 1
            if control < 32:
                expanded += data[position : position + control + 1]
                position += control + 1
                continue
            length = (control >> 5) + 2
            if length == 9:
                length += data[position]
                position += 1
            distance = ((control & 31) << 8) + data[position] + 1
            position += 1
            start = len(expanded) - distance
            if start < 0:
                raise ValueError("a reference goes back to before the start")
            if length <= distance:
                expanded += expanded[start : start + length]
            else:
                # The reference overlaps what it writes: the last `distance` bytes repeat.
                expanded += (expanded[start:] * (length // distance + 1))[:length]
    except IndexError:
        raise ValueError("the compressed data end early") from None
    if position > end or len(expanded) != size:
        raise ValueError(f"the data expand to {len(expanded)} bytes, not {size}")
    return bytes(expanded)


def _split_bytes(rows: UInt8[np.ndarray, "n size"], fields: tuple[Field, ...]) -> list[np.ndarray]:
    ends = np.cumsum([field.size for field in fields])
    return [
        rows[:, end - field.size : end].reshape(-1).view(field.dtype).reshape(len(rows), field.count)
        for field, end in zip(fields, ends, strict=True)
    ]
