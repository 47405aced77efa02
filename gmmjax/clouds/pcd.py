"""Reading PCD files, the format of the Point Cloud Library (version 0.7)."""

import dataclasses
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds.cloud_file import RowBlock
from gmmjax.clouds.columns import (
    AXES,
    canonical_names,
    cast_column,
    cloud_of_columns,
    field_columns,
    require_axes,
)
from gmmjax.clouds.files import read_bytes, require_file
from gmmjax.clouds.number_table import NumberedLines, parse_table
from gmmjax.clouds.ordered_frame import AT_ORIGIN, frame_views, pose_of
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.records import RecordFile, cut_off, require_records
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError

ENCODINGS = ("ascii", "binary", "binary_compressed")
TYPES = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
NUMBERS = ("SIZE", "COUNT", "WIDTH", "HEIGHT", "POINTS")
KEYS = {"VERSION", "FIELDS", "COLUMNS", *NUMBERS, "VIEWPOINT", "TYPE", "DATA"}
PADDING = "_"
# Bytes of the longest header, and of the largest point that NumPy has a type for.
LONGEST_HEADER, LARGEST_POINT = 1 << 20, 2**31 - 1
# No three bytes of LZF stand for more than 264 bytes: data that claim more are damaged.
LONGEST_EXPANSION = 90


@dataclass(frozen=True)
class PcdHeader:
    """Header of a PCD file.

    Attributes:
        row_type: of a point; each field has an axis for its COUNT, and those with a blank in the name are padding.
        points: how many points, WIDTH times HEIGHT.
        encoding: ascii, binary or binary_compressed.
        body: the byte after the header.
        lines: how many lines the header has.
        width: columns of an ordered image, or None where the points are in no order.
        stated: position and quaternion of the sensor, as declared; empty where they are no numbers.
    """

    row_type: np.dtype
    points: int
    encoding: str
    body: int
    lines: int
    width: int | None
    stated: tuple[float, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Number of values that each field has for a point."""
        return {name: self.row_type[name].shape[0] for name in self.row_type.names or ()}

    @property
    def names(self) -> list[str]:
        """The fields that are no padding."""
        return [name for name in self.counts if " " not in name]

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
        """Pose of the sensor in the frame of the points."""
        pose = pose_of(self.viewpoint)
        assert pose is not None
        return pose

    @property
    def dtype(self) -> np.dtype:
        """The type that holds all coordinates."""
        return np.result_type(*(self.row_type[axis].base for axis in AXES))

    def columns(self, blocks: np.ndarray | Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The columns of points, of the numbers [N, COUNT] of each field."""
        columns: dict[str, np.ndarray] = {}
        for name in self.names:
            columns |= field_columns(name, blocks[name])
        return columns

    def views(self, points: Float64[np.ndarray, "n 3"], rows: Int64[np.ndarray, " n"]) -> SensorViews | None:
        """The view that an ordered frame was taken from, of its points and their rows; see `frame_views`."""
        return None if self.width is None else frame_views(points, rows, self.width, self.stated)


@dataclass(frozen=True, eq=False, kw_only=True)
class PcdFile(RecordFile):
    """A PCD file with the encoding binary.

    Attributes:
        header: of the file.
    """

    header: PcdHeader

    def views_of(self, blocks: Callable[[], Iterable[RowBlock]]) -> SensorViews | None:
        """The view of an ordered frame; see `frame_views`."""
        if self.header.width is None or not (parts := list(blocks())):
            return None
        rows = [part.rows for part in parts if part.rows is not None]
        return self.header.views(np.concatenate([part.points for part in parts]), np.concatenate(rows))

    def columns_of(self, rows: np.ndarray) -> Mapping[str, np.ndarray]:
        """The columns of some points by name; see `open_pcd`."""
        return self.header.columns(rows)


def open_pcd(path: Path) -> PcdFile | PointCloud:
    """Open a PCD file: ascii, binary or binary_compressed.

    rgb or rgba, packed into four bytes, become colours; the other fields keep their type, and one with COUNT above 1
    becomes `name_0`, `name_1`, ...; padding is left out. Organised clouds are flattened row by row, and pixels without
    a depth (NaN) are dropped and counted.

    An organised cloud (HEIGHT above 1) whose VIEWPOINT is the pose of the pinhole camera that took it gets `views`; see
    `frame_views`.

    Args:
        path: the file.

    Returns:
        The file, with its header read; where it is ascii or compressed, its points in the order of the file.

    Raises:
        InputError: the file cannot be read, is no PCD, is cut off, or has no x, y, z.
    """
    source = SourceFile.of(path)
    header = read_layout(path)
    require_axes((name for name, count in header.counts.items() if count == 1), str(path))
    if header.encoding == "binary":
        require_records(path, source.size - header.body, header.row_type, header.points, "points")
        return PcdFile(
            path=path,
            source=source,
            count=header.points,
            offset=header.body,
            row_type=header.row_type,
            header=header,
        )
    blocks_of = _ascii_blocks if header.encoding == "ascii" else _compressed_blocks
    columns = header.columns(blocks_of(read_bytes(path)[header.body :], header, str(path)))
    cloud = cloud_of_columns(columns, str(path))
    return dataclasses.replace(cloud, views=header.views(cloud.points, cloud.rows))


def read_layout(path: str | os.PathLike[str]) -> PcdHeader:
    """Read what a PCD file says beside its points.

    Raises:
        InputError: the file cannot be read, is no PCD, or a header line is missing or wrong.
    """
    file = require_file(path)
    with file.open("rb") as stream:
        data = stream.read(LONGEST_HEADER)
    source = str(file)
    entries, body, lines = _entries(data, source)
    points, width = _shape(entries, source)
    try:
        stated = tuple(map(float, entries.get("VIEWPOINT", [])))
    except ValueError:
        stated = ()
    return PcdHeader(_row_type(entries, source), points, entries["DATA"][0], body, lines, width, stated)


def _entries(data: bytes, source: str) -> tuple[dict[str, list[str]], int, int]:
    """The values of each line of the header by its key, the byte after the header, and the number of its lines."""
    entries: dict[str, list[str]] = {}
    position = lines = 0
    while "DATA" not in entries and position < len(data):
        end = data.find(b"\n", position) + 1 or len(data)
        line = data[position:end].decode("ascii", "replace").strip()
        position, lines = end, lines + 1
        key, *values = line.split() or [""]
        if key and not key.startswith("#"):
            if key not in KEYS:
                raise InputError(f"{source}: line {lines} of the PCD header is not understood: {line[:80]!r}")
            entries["FIELDS" if key == "COLUMNS" else key] = values
    if entries.get("DATA", [""])[:1] not in [[encoding] for encoding in ENCODINGS]:
        raise InputError(
            f"{source}: the PCD header has no line DATA with one of {', '.join(ENCODINGS)}; is it cut off?"
        )
    return entries, position, lines


def _numbers(entries: dict[str, list[str]], key: str, length: int, source: str) -> list[int]:
    values = entries.get(key, [])
    if len(values) != length or not all(value.isascii() and value.isdigit() and len(value) < 10 for value in values):
        raise InputError(
            f"{source}: the PCD header needs a line {key} with {length} whole number(s), "
            f"not {' '.join(values)[:80]!r}; export the cloud again"
        )
    return [int(value) for value in values]


def _row_type(entries: dict[str, list[str]], source: str) -> np.dtype:
    """The type of a point, as of `PcdHeader`."""
    names, types = entries.get("FIELDS", []), entries.get("TYPE", [])
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
    if (length := sum(size * count for size, count in zip(sizes, counts, strict=True))) > LARGEST_POINT:
        raise InputError(f"{source}: the PCD header declares points of {length} bytes, which cannot be; correct it")
    own = [f"{name} {place}" if name == PADDING else name for place, name in enumerate(canonical_names(names))]
    kinds = [(f"<{kind.lower()}{size}", (count,)) for kind, size, count in zip(types, sizes, counts, strict=True)]
    return np.dtype([(name, *kind) for name, kind in zip(own, kinds, strict=True)])


def _shape(entries: dict[str, list[str]], source: str) -> tuple[int, int | None]:
    """The number of points, and WIDTH where HEIGHT tells that they are the rows of an image."""
    declared = _numbers(entries, "POINTS", 1, source)[0] if "POINTS" in entries else None
    if "WIDTH" not in entries and declared is not None:
        return declared, None
    (width,) = _numbers(entries, "WIDTH", 1, source)
    height = _numbers(entries, "HEIGHT", 1, source)[0] if "HEIGHT" in entries else 1
    if declared not in (None, width * height):
        raise InputError(
            f"{source}: POINTS is {declared}, WIDTH times HEIGHT is {width * height}; correct the PCD header"
        )
    return width * height, width if height > 1 else None


def _ascii_blocks(body: bytes, header: PcdHeader, source: str) -> dict[str, np.ndarray]:
    lines = NumberedLines(body, first=header.lines + 1, comments=(b"#",))
    ends = np.cumsum(list(header.counts.values()))
    table = parse_table(lines, int(ends[-1]), source, count=header.points, what="points")
    blocks = dict(zip(header.counts, np.split(table, ends[:-1], axis=1), strict=True))
    # What stands in a padding column need not be a number of its type.
    return {name: cast_column(blocks[name], header.row_type[name].base, name, source) for name in header.names}


def _compressed_blocks(body: bytes, header: PcdHeader, source: str) -> dict[str, np.ndarray]:
    """The numbers of the fields, one after the other; writers other than PCL's may store the padding too."""
    if len(body) < 8:
        raise cut_off(header.points, 0, "points", source)
    compressed, size = (int(number) for number in np.frombuffer(body, "<u4", 2))
    if len(body) - 8 < compressed:
        raise InputError(
            f"{source}: declares {header.points} points in {compressed} compressed bytes, {len(body) - 8} bytes are "
            "there; the file is cut off, copy it again"
        )
    stored = header.names
    length = sum(header.row_type[name].itemsize for name in stored)
    if size == header.points * header.row_type.itemsize:
        stored = list(header.counts)
    elif size != header.points * length:
        raise InputError(
            f"{source}: holds {size} bytes for {header.points} points of {length} bytes; the header is wrong"
        )
    try:
        expanded = expand_lzf(body[8 : 8 + compressed], size)
    except ValueError as error:
        raise InputError(f"{source}: the compressed data are damaged ({error}); copy or export it again") from error
    blocks, offset = {}, 0
    for name in stored:
        kind = header.row_type[name]
        block = np.frombuffer(expanded, kind.base, header.points * kind.shape[0], offset)
        blocks[name] = block.reshape(header.points, kind.shape[0])
        offset += block.nbytes
    return blocks


def expand_lzf(data: bytes, size: int) -> bytes:
    """Expand data of LibLZF (Lehmann, LibLZF 3.6), which binary_compressed data are, to `size` bytes.

    A control byte below 32 starts a run of that many bytes plus one, copied as they are. Any other one refers back:
    its top three bits are the length (7: a further byte is added) less two, its other bits and the next byte the
    distance less one.

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
            # Where the reference overlaps what it writes, the last `distance` bytes repeat.
            expanded += (expanded[start : start + length] * (length // distance + 1))[:length]
    except IndexError:
        raise ValueError("the compressed data end early") from None
    if position > end or len(expanded) != size:
        raise ValueError(f"the data expand to {len(expanded)} bytes, not {size}")
    return bytes(expanded)
