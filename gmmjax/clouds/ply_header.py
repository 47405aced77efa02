"""The header of a PLY file (Turk, "The PLY polygon file format", 1994)."""

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from gmmjax.clouds.columns import canonical_names
from gmmjax.errors import InputError

# The types of the format; many programs write NumPy's names, and some integers of 64 bits.
KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
TYPES = dict(zip(("char", "uchar", "short", "ushort", "int", "uint", "float", "double"), KINDS, strict=True))
SCALARS = TYPES | {np.dtype(kind).name: kind for kind in (*KINDS, "i8", "u8")}
ByteOrder = Literal["=", "<", ">"]
BYTE_ORDERS: dict[str, ByteOrder] = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
MAGIC = re.compile(rb"ply[ \t]*(\r\n|\n|\r)")
END = re.compile(rb"[\r\n]end_header[ \t]*(\r\n|\n|\r)")


class Property(NamedTuple):
    """A scalar of an element, or a list whose length has the type `length`."""

    dtype: np.dtype
    length: np.dtype | None = None


@dataclass(frozen=True)
class Element:
    """`count` rows of properties, such as the vertices or the faces."""

    name: str
    count: int
    properties: dict[str, Property]

    @property
    def lists(self) -> list[str]:
        """Names of the properties that are lists."""
        return [name for name, own in self.properties.items() if own.length is not None]

    @property
    def row_type(self) -> np.dtype:
        """A row without lists, with the usual names for coordinates and colours."""
        names = canonical_names(list(self.properties))
        return np.dtype([(name, own.dtype) for name, own in zip(names, self.properties.values(), strict=True)])


@dataclass(frozen=True)
class PlyHeader:
    """Header of a PLY file.

    Attributes:
        encoding: ascii, binary_little_endian or binary_big_endian.
        before: the elements before the vertices; no lists are among them unless the file is ascii.
        vertex: the vertices, which have no lists.
        body: the byte after the header.
        lines: number of lines of the header.
    """

    encoding: str
    before: tuple[Element, ...]
    vertex: Element
    body: int
    lines: int


def parse_header(data: bytes, source: str) -> PlyHeader:
    """Parse the header at the start of a PLY file, with LF, CRLF or CR line ends.

    Raises:
        InputError: no PLY file, no end of the header, a line that is not PLY, no vertices, or lists before or in them.
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
    names = [own.name for own in elements]
    if "vertex" not in names:
        listed = ", ".join(names) or "nothing"
        raise InputError(f"{source}: declares no vertex element, only: {listed}; export the vertices")
    place = names.index("vertex")
    passed_over = elements[: place + 1] if encoding != "ascii" else elements[place : place + 1]
    if lists := [name for element in passed_over for name in element.lists]:
        raise InputError(
            f"{source}: its vertices have lists, or stand behind some ({', '.join(lists)}), which is not read; export "
            "it with vertices first, without lists"
        )
    return PlyHeader(encoding, elements[:place], elements[place], body, len(lines) + 1)


def _statements(lines: list[str], source: str) -> tuple[str, tuple[Element, ...]]:
    encoding = None
    elements: list[Element] = []
    for number, line in enumerate(lines[1:], start=2):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, *_] if name in BYTE_ORDERS:
                encoding = name
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 13:
                elements.append(Element(name, int(count), {}))
            case ["property", *words] if elements and encoding and (own := _property(words, BYTE_ORDERS[encoding])):
                if (name := words[-1]) in elements[-1].properties:
                    what = f"{elements[-1].name} declares {name!r} more than once"
                    raise InputError(f"{source}: {what}; rename one of them")
                elements[-1].properties[name] = own
            case _:
                raise InputError(f"{source}: line {number} of the PLY header is not understood: {line[:80]!r}")
    if encoding is None:
        raise InputError(f"{source}: the PLY header has no format line; add one, such as 'format ascii 1.0'")
    return encoding, tuple(elements)


def _property(words: list[str], order: ByteOrder) -> Property | None:
    match words:
        case [kind, _] if kind in SCALARS:
            return Property(np.dtype(SCALARS[kind]).newbyteorder(order))
        case ["list", length, kind, _] if kind in SCALARS and SCALARS.get(length, "f")[0] in "iu":
            length_type = np.dtype(SCALARS[length]).newbyteorder(order)
            return Property(np.dtype(SCALARS[kind]).newbyteorder(order), length_type)
    return None
