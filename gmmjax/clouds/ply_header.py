"""The header of a PLY file (Turk, "The PLY polygon file format", 1994)."""

import re
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gmmjax.clouds.columns import canonical_names
from gmmjax.errors import InputError

SCALARS = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
ByteOrder = Literal["=", "<", ">"]
BYTE_ORDERS: dict[str, ByteOrder] = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
MAGIC = re.compile(rb"ply[ \t]*(\r\n|\n|\r)")
END = re.compile(rb"[\r\n]end_header[ \t]*(\r\n|\n|\r|\Z)")


@dataclass(frozen=True)
class Property:
    """A property of an element: a scalar, or a list whose length has the type `length`."""

    name: str
    dtype: np.dtype
    length: np.dtype | None = None


@dataclass(frozen=True)
class Element:
    """An element, such as vertex or face: `count` rows of its properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(prop.length is not None for prop in self.properties)

    @property
    def without_lists(self) -> "Element":
        """The same of the scalars alone, with the usual names for coordinates and colours."""
        scalars = [prop for prop in self.properties if prop.length is None]
        names = canonical_names([prop.name for prop in scalars])
        renamed = (replace(prop, name=name) for prop, name in zip(scalars, names, strict=True))
        return replace(self, properties=tuple(renamed))

    @property
    def row_type(self) -> np.dtype:
        """The bytes of a row of an element without lists."""
        return np.dtype([(prop.name, prop.dtype) for prop in self.properties])


@dataclass(frozen=True)
class PlyHeader:
    """What a PLY file declares.

    Attributes:
        encoding: ascii, binary_little_endian or binary_big_endian.
        elements: in the order of the file.
        body: the byte after the header.
        lines: how many lines the header has.
    """

    encoding: str
    elements: tuple[Element, ...]
    body: int
    lines: int

    @property
    def vertex_index(self) -> int:
        """Where `vertex` stands among the elements; -1 if it is not there."""
        return next((index for index, element in enumerate(self.elements) if element.name == "vertex"), -1)


def parse_header(data: bytes, source: str) -> PlyHeader:
    """The header at the start of a PLY file, with LF, CRLF or CR line ends.

    Args:
        data: the file.
        source: its name, for messages.

    Returns:
        What the header declares.

    Raises:
        InputError: no PLY file, no end of the header, or a line that is not PLY.
    """
    magic = MAGIC.match(data)
    if magic is None:
        raise InputError(f"{source}: is no PLY file (the first line is not 'ply'); rename it to its real format")
    end = END.search(data)
    if end is None:
        raise InputError(f"{source}: the PLY header has no end_header; the file is cut off, copy it again")
    # With CR line ends, a line feed after the header is the first byte of the data.
    body = end.start(1) + 1 if magic.group(1) == b"\r" else end.end()
    text = data[: end.start() + 1].replace(b"\r\n", b"\n").replace(b"\r", b"\n").decode("utf-8", "replace")
    lines = text.split("\n")[:-1]
    encoding, elements = _statements(lines, source)
    return PlyHeader(encoding, elements, body, len(lines) + 1)


def _statements(lines: list[str], source: str) -> tuple[str, tuple[Element, ...]]:
    encoding = None
    elements: list[tuple[str, int, list[Property]]] = []
    for number, line in enumerate(lines[1:], start=2):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, *_] if name in BYTE_ORDERS:
                encoding = name
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 13:
                elements.append((name, int(count), []))
            case ["property", *words] if elements and encoding and (prop := _property(words, BYTE_ORDERS[encoding])):
                elements[-1][2].append(prop)
            case _:
                raise InputError(f"{source}: line {number} of the PLY header is not understood: {line[:80]!r}")
    if encoding is None:
        raise InputError(f"{source}: the PLY header has no format line; add one, such as 'format ascii 1.0'")
    return encoding, tuple(_element(name, count, properties, source) for name, count, properties in elements)


def _property(words: list[str], order: ByteOrder) -> Property | None:
    match words:
        case [kind, name] if kind in SCALARS:
            return Property(name, np.dtype(SCALARS[kind]).newbyteorder(order))
        case ["list", length, kind, name] if kind in SCALARS and SCALARS.get(length, "f")[0] in "iu":
            length_type = np.dtype(SCALARS[length]).newbyteorder(order)
            return Property(name, np.dtype(SCALARS[kind]).newbyteorder(order), length_type)
    return None


def _element(name: str, count: int, properties: list[Property], source: str) -> Element:
    names = [prop.name for prop in properties]
    if repeated := {other for other in names if names.count(other) > 1}:
        raise InputError(f"{source}: element {name!r} declares {sorted(repeated)} more than once; rename one of them")
    return Element(name, count, tuple(properties))
