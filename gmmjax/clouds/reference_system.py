"""The coordinate reference system that a file states: its linear unit and its EPSG code, from GeoTIFF keys or WKT."""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

# Keys of GeoTIFF (OGC 19-008r4): system and linear unit of projected coordinates, and the unit of heights.
PROJECTED_SYSTEM, PROJECTED_UNIT, VERTICAL_UNIT = 3072, 3076, 4099
USER_DEFINED = 32767
# EPSG codes of units, and lengths in metres with the names of the units.
UNIT_CODES = {9001: "m", 9002: "ft", 9003: "ftUS"}
UNIT_LENGTHS = {1.0: "m", 0.001: "mm", 0.01: "cm", 1000.0: "km", 0.3048: "ft", 1200 / 3937: "ftUS"}
# The two feet differ by 2e-6.
SAME_LENGTH = 1e-8
PROJECTED = ("PROJCS", "PROJCRS", "PROJECTEDCRS")
VERTICAL = ("VERT_CS", "VERTCRS", "VERTICALCRS")
LOCAL = ("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS")
TOKEN = re.compile(r'"(?:[^"]|"")*"|[\[\](),]|[^\s\[\](),"]+')
DEEPEST = 50


@dataclass(frozen=True)
class ReferenceSystem:
    """What is known of the coordinate reference system of a cloud.

    Attributes:
        unit: of all three coordinates, "m", "mm", "cm", "km", "ft" or "ftUS"; None where it is not stated, is an angle,
            or is another one for the heights.
        crs: of the horizontal coordinates, as "EPSG:25832"; None where it is not stated.
    """

    unit: str | None = None
    crs: str | None = None


def of_geotiff_keys(directory: bytes) -> ReferenceSystem:
    """The system that a GeoKeyDirectoryTag names.

    Args:
        directory: the tag: a header of four 16-bit numbers, and four for each key. What is damaged states nothing.
    """
    numbers = struct.unpack(f"<{len(directory) // 2}H", directory[: len(directory) // 2 * 2])
    entries = [numbers[start : start + 4] for start in range(4, len(numbers) - 3, 4)]
    # A location of 0: the value stands in the key itself.
    keys = {key: value for key, location, _, value in entries if location == 0}
    code = keys.get(PROJECTED_SYSTEM, 0)
    units = [UNIT_CODES.get(keys[key]) for key in (PROJECTED_UNIT, VERTICAL_UNIT) if key in keys]
    stated = PROJECTED_UNIT in keys and len(set(units)) == 1
    return ReferenceSystem(units[0] if stated else None, f"EPSG:{code}" if 0 < code < USER_DEFINED else None)


def of_wkt(text: str) -> ReferenceSystem:
    """The system that well-known text (OGC 01-009 or ISO 19162) describes; what is damaged states nothing."""
    root = _parsed(text)
    if root is None:
        return ReferenceSystem()
    nodes = list(root.walk())
    flat = next((node for node in nodes if node.name in PROJECTED + LOCAL), None)
    height = next((node for node in nodes if node.name in VERTICAL), None)
    if flat is None:
        return ReferenceSystem()
    units = {node.unit() for node in (flat, height) if node is not None}
    return ReferenceSystem(units.pop() if len(units) == 1 else None, flat.epsg())


@dataclass
class _Node:
    """A keyword of WKT with what stands in its brackets."""

    name: str
    values: list[str] = field(default_factory=list)
    children: list["_Node"] = field(default_factory=list)

    def walk(self) -> Iterator["_Node"]:
        yield self
        for child in self.children:
            yield from child.walk()

    def unit(self) -> str | None:
        """The linear unit of the system itself, or of all its axes."""
        axes = [unit for axis in self.children if axis.name == "AXIS" for unit in axis.children]
        lengths = {unit.length() for unit in [*self.children, *axes] if unit.name in ("UNIT", "LENGTHUNIT")}
        return lengths.pop() if len(lengths) == 1 else None

    def length(self) -> str | None:
        try:
            metres = float(self.values[1])
        except (IndexError, ValueError):
            return None
        return next((name for own, name in UNIT_LENGTHS.items() if abs(metres - own) <= SAME_LENGTH * own), None)

    def epsg(self) -> str | None:
        for child in self.children:
            if child.name in ("AUTHORITY", "ID") and child.values[:1] == ["EPSG"]:
                code = "".join(child.values[1:2])
                return f"EPSG:{code}" if code.isascii() and code.isdigit() and len(code) < 10 else None
        return None


def _parsed(text: str) -> _Node | None:
    """The first keyword with all that is in it; None where brackets do not match."""
    open_nodes: list[_Node] = [_Node("")]
    tokens: Sequence[str] = TOKEN.findall(text.rstrip("\0 \n"))
    for index, token in enumerate(tokens):
        if token in "[(":
            continue
        if token in "])":
            if len(open_nodes) < 2:
                return None
            open_nodes.pop()
        elif tokens[index + 1 : index + 2] in (["["], ["("]):
            node = _Node(token.upper())
            open_nodes[-1].children.append(node)
            open_nodes.append(node)
            if len(open_nodes) > DEEPEST:
                return None
        elif token != ",":
            open_nodes[-1].values.append(token.strip('"'))
    roots = open_nodes[0].children
    return roots[0] if len(open_nodes) == 1 and roots else None
