"""Reading the vertices of PLY files, and writing clouds as PLY."""

import dataclasses
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.cloud_file import CloudFile, RowBlock
from gmmjax.clouds.colors import CHANNELS
from gmmjax.clouds.columns import AXES, block_of_columns, cast_column, cloud_of_columns, require_axes
from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.clouds.files import read_bytes, require_file
from gmmjax.clouds.number_table import NumberedLines, cut_off, parse_table
from gmmjax.clouds.ply_header import END, Element, PlyHeader, parse_header
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.records import stored_records
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError

# Bytes of the longest header that is read without the rest of the file.
LONGEST_HEADER = 1 << 20
WRITTEN_TYPES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class PlyFile(CloudFile):
    """A binary PLY file.

    Attributes:
        vertex: the element of its points.
        offset: bytes before them.
    """

    vertex: Element
    offset: int

    def blocks(self) -> Iterator[RowBlock]:
        """All vertices, some at a time.

        Raises:
            InputError: the file is cut off.
        """
        for rows in stored_records(self.path, self.offset, self.vertex.row_type, self.count):
            yield block_of_columns({prop.name: rows[prop.name] for prop in self.vertex.properties}, str(self.path))


def open_ply(path: str | os.PathLike[str]) -> PlyFile | PointCloud:
    """The vertices of a PLY file: ascii or binary of either byte order, a cloud or a mesh.

    red, green and blue become colours, other scalar properties become fields in their declared type; lists, faces and
    other elements are passed over. Names are in upper or lower case.

    Args:
        path: the file.

    Returns:
        The file, of which the header is read; where it is ascii or its vertices have lists, its points in the order of
        the file.

    Raises:
        InputError: the file cannot be read, is no PLY, is cut off, or has no x, y, z.
    """
    file, source = require_file(path), str(path)
    written = SourceFile.of(file)
    header = parse_header(_head(file), source)
    index = header.vertex_index
    if index < 0:
        names = ", ".join(element.name for element in header.elements) or "nothing"
        raise InputError(f"{source}: declares no vertex element, only: {names}; export the vertices")
    vertex = header.elements[index].without_lists
    require_axes((prop.name for prop in vertex.properties), source)
    if header.encoding == "ascii":
        return cloud_of_columns(_ascii_columns(read_bytes(file), header, index, source), source)
    offset = _vertex_offset(file, header, index)
    if header.elements[index].has_lists:
        rows = _rows_without_lists(read_bytes(file), offset, header.elements[index], header.encoding, source)
        return cloud_of_columns({prop.name: rows[prop.name] for prop in vertex.properties}, source)
    available = max(written.size - offset, 0) // vertex.row_type.itemsize
    if available < vertex.count:
        raise cut_off(vertex.count, available, "vertices", source)
    return PlyFile(path=file, source=written, count=vertex.count, vertex=vertex, offset=offset)


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
    """`write_ply` for a cloud that comes in parts, such as one that is larger than the memory.

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
    rows = np.empty(len(cloud), np.dtype([(name, own.dtype.newbyteorder("<")) for name, own in columns.items()]))
    for name, values in columns.items():
        rows[name] = values
    return rows


def _head(file: Path) -> bytes:
    """The beginning of a file with its header, and all of the file where that has no end."""
    with file.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
        # The end of what was read may look like the end of the header.
        whole = END.search(head, 0, len(head) - 2) if len(head) == LONGEST_HEADER else True
        return head if whole else head + stream.read()


def _vertex_offset(file: Path, header: PlyHeader, index: int) -> int:
    """Bytes before the vertices."""
    before = header.elements[:index]
    # Lists are of any length: the rows have to be gone through.
    data = read_bytes(file) if any(element.has_lists for element in before) else b""
    offset = header.body
    for element in before:
        offset = _after_element(data, offset, element, header.encoding, str(file))
    return offset


def _after_element(data: bytes, offset: int, element: Element, encoding: str, source: str) -> int:
    """The byte after an element that is passed over."""
    if not element.has_lists:
        return offset + element.count * element.row_type.itemsize
    for place in _list_places(data, offset, element, encoding, source):
        offset = place[-1]
    return offset


def _list_places(data: bytes, offset: int, element: Element, encoding: str, source: str) -> Iterator[list[int]]:
    """Where each row of an element with lists begins, and the byte after each of its lists and after its end."""
    order: Literal["big", "little"] = "big" if encoding == "binary_big_endian" else "little"
    sizes = [(prop.dtype.itemsize, 0 if prop.length is None else prop.length.itemsize) for prop in element.properties]
    for row in range(element.count):
        places = [offset]
        for size, length_size in sizes:
            # A negative length, read here as a huge positive one, ends behind the file like any other wrong length.
            length = int.from_bytes(data[offset : offset + length_size], order) if length_size else 1
            offset += length_size + length * size
            if length_size:
                places.append(offset)
        if offset > len(data):
            raise InputError(
                f"{source}: declares {element.count} rows of {element.name}, {row} are there; the file is cut off, "
                "copy it again"
            )
        yield [*places, offset]


def _rows_without_lists(data: bytes, offset: int, element: Element, encoding: str, source: str) -> np.ndarray:
    """The scalars of an element with lists, as rows of `element.without_lists`."""
    if element.count > len(data):
        raise cut_off(element.count, 0, "vertices", source)
    places = np.array(list(_list_places(data, offset, element, encoding, source)), np.int64).reshape(element.count, -1)
    rows = np.empty(element.count, element.without_lists.row_type)
    content, names, run, start = np.frombuffer(data, np.uint8), iter(rows.dtype.names or ()), 0, 0
    for prop in element.properties:
        if prop.length is not None:
            run, start = run + 1, 0
            continue
        bytes_of = content[places[:, run, None] + np.arange(start, start + prop.dtype.itemsize)]
        rows[next(names)] = bytes_of.view(prop.dtype)[:, 0]
        start += prop.dtype.itemsize
    return rows


def _ascii_columns(data: bytes, header: PlyHeader, index: int, source: str) -> dict[str, np.ndarray]:
    vertex = header.elements[index]
    lines = NumberedLines(data[header.body :], first=header.lines + 1)
    before = sum(element.count for element in header.elements[:index] if element.properties)
    if vertex.has_lists:
        lines = _without_lists(lines, before, vertex, source)
    vertex = vertex.without_lists
    width = len(vertex.properties)
    table = parse_table(lines, width, source, count=vertex.count, what="vertices", skip=before)
    # Coordinates keep all the digits of the text, even where the header says float.
    return {
        prop.name: table[:, column]
        if prop.name in AXES
        else cast_column(table[:, column], prop.dtype, prop.name, source)
        for column, prop in enumerate(vertex.properties)
    }


def _without_lists(lines: NumberedLines, before: int, element: Element, source: str) -> NumberedLines:
    """The lines without the lists in the rows of an element, with their numbers."""
    kept: list[bytes] = []
    for index, (number, line) in enumerate(lines):
        kept += [b""] * (number - lines.first - len(kept))
        is_row = before <= index < before + element.count
        kept.append(_scalars(line, element, f"{source}: line {number}") if is_row else line)
    return NumberedLines(b"\n".join(kept), lines.first)


def _scalars(line: bytes, element: Element, where: str) -> bytes:
    """The words of a row that are of no list."""
    words, scalars, place = line.split(), list[bytes](), 0
    for prop in element.properties:
        if prop.length is None:
            scalars += words[place : place + 1]
            place += 1
        elif place < len(words) and words[place].isdigit() and len(words[place]) < 10:
            place += 1 + int(words[place])
        else:
            raise InputError(f"{where}: the list {prop.name!r} has no length; the line is incomplete, export it again")
    if place != len(words):
        raise InputError(f"{where} has {len(words)} values where {place} are expected; export it again")
    return b" ".join(scalars)


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
    if values.dtype.str[1:] not in WRITTEN_TYPES:
        raise InputError(f"{name} is {values.dtype}, which PLY does not have; make it float64")
    return values


def _header_text(row_type: np.dtype, count: int, comments: Sequence[str], source: str) -> bytes:
    if any(character in comment for comment in comments for character in "\r\n"):
        raise InputError(f"{source}: a comment has a line break; give one comment for each line")
    assert row_type.fields is not None
    properties = [f"property {WRITTEN_TYPES[kind.str[1:]]} {name}" for name, (kind, *_) in row_type.fields.items()]
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {comment}" for comment in comments),
        f"element vertex {count}",
        *properties,
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode()
