"""The coordinate reference system that a file states: its unit, and its EPSG code or WKT, from GeoTIFF keys or WKT."""

import math
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

# Keys of GeoTIFF (OGC 19-008r4): kind of system, geographic and projected system, their units, and that of heights.
MODEL_TYPE, GEOGRAPHIC_SYSTEM, ANGULAR_UNIT = 1024, 2048, 2054
PROJECTED_SYSTEM, PROJECTED_UNIT, VERTICAL_UNIT = 3072, 3076, 4099
# What the system is called: the projected or geographic one, else the whole.
CITATIONS = (3073, 2049, 1026)
# The tag with the texts of the keys.
GEOTIFF_TEXTS = 34737
GEOGRAPHIC_MODEL, GEOCENTRIC_MODEL = 2, 3
USER_DEFINED = 32767
# EPSG codes of units, and lengths in metres with the names of the units.
UNIT_CODES = {9001: "m", 9002: "ft", 9003: "ftUS"}
UNIT_LENGTHS = {1.0: "m", 0.001: "mm", 0.01: "cm", 1000.0: "km", 0.3048: "ft", 1200 / 3937: "ftUS"}
# The two feet differ by 2e-6.
SAME_LENGTH = 1e-8
# The unit of coordinates that are angles, in degrees or another one.
DEGREE, ANGLE = ANGLES = "degree", "angle"
DEGREE_CODE = 9102
# Writers round the length of a degree; a grad is a tenth less.
SAME_ANGLE = 0.01
PROJECTED = ("PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS")
GEOGRAPHIC = ("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS")
# Geocentric, or in WKT 2 also geographic, which the unit tells.
GEODETIC = ("GEOCCS", "GEODCRS", "GEODETICCRS")
VERTICAL = ("VERT_CS", "VERTCRS", "VERTICALCRS")
LOCAL = ("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS")
SYSTEMS = (*PROJECTED, *GEOGRAPHIC, *GEODETIC, "BOUNDCRS")
UNITS = ("UNIT", "LENGTHUNIT", "ANGLEUNIT")
TOKEN = re.compile(r'"(?:[^"]|"")*"|[\[\](),]|[^\s\[\](),"]+')
DEEPEST = 50


@dataclass(frozen=True)
class ReferenceSystem:
    """The coordinate reference system of a cloud, as far as it is known.

    Attributes:
        unit: of all three coordinates, "m", "mm", "cm", "km", "ft" or "ftUS"; None where it is not stated, or is
            another one for the heights. Where x and y are angles "degree", or "angle" for other ones, whatever the
            heights are in.
        crs: of the horizontal coordinates, as "EPSG:25832", else as WKT, or what GeoTIFF keys call it that describe it
            by parameters; None where it is not stated.
        heights: the unit of the heights, where that is another one than of x and y.
    """

    unit: str | None = None
    crs: str | None = None
    heights: str | None = None


def epsg_code(crs: str | None) -> str | None:
    """A system that is known by its EPSG code, as it is; None for all others, which may be equal to any."""
    return crs if crs is not None and crs.startswith("EPSG:") else None


def is_wkt(crs: str) -> bool:
    """True for a system that is described by WKT."""
    return re.split(r"[\[(]", crs)[0].upper() in SYSTEMS


def is_geocentric_system(crs: str) -> bool:
    """True for WKT of a system of lengths whose origin is the centre of the Earth."""
    root = _parsed(crs) if is_wkt(crs) else None
    horizontal = None if root is None else _horizontal(root)
    return horizontal is not None and horizontal.name in GEODETIC


def system_name(crs: str) -> str:
    """A system in a message or on a page: its EPSG code or its name."""
    root = _parsed(crs) if is_wkt(crs) else None
    return root.values[0] if root is not None and root.values else crs


def of_geotiff_keys(directory: bytes, texts: bytes = b"") -> ReferenceSystem:
    """The system that a GeoKeyDirectoryTag names.

    Args:
        directory: the tag: a header of four 16-bit numbers, and four for each key. What is damaged states nothing.
        texts: the GeoAsciiParamsTag, with the names that keys refer to.
    """
    numbers = struct.unpack(f"<{len(directory) // 2}H", directory[: len(directory) // 2 * 2])
    entries = [numbers[start : start + 4] for start in range(4, len(numbers) - 3, 4)]
    # A location of 0: the value stands in the key itself.
    keys = {key: value for key, location, _, value in entries if location == 0}
    named = {key: texts[start : start + count] for key, location, count, start in entries if location == GEOTIFF_TEXTS}
    name = next((named[key].decode("ascii", "replace").strip("|\0 ") for key in CITATIONS if key in named), "")
    if (start := name.find("PROJCS[")) >= 0:
        return of_wkt(name[start:])
    alone = GEOGRAPHIC_SYSTEM in keys and not {PROJECTED_SYSTEM, PROJECTED_UNIT} & keys.keys()
    model = keys.get(MODEL_TYPE) or (GEOGRAPHIC_MODEL if alone else 0)
    code = keys.get(GEOGRAPHIC_SYSTEM if model in (GEOGRAPHIC_MODEL, GEOCENTRIC_MODEL) else PROJECTED_SYSTEM, 0)
    described = (name or "a system of GeoTIFF parameters") if model or code else None
    crs = f"EPSG:{code}" if 0 < code < USER_DEFINED else described
    if model == GEOGRAPHIC_MODEL:
        return ReferenceSystem(DEGREE if keys.get(ANGULAR_UNIT, DEGREE_CODE) == DEGREE_CODE else ANGLE, crs)
    units = [UNIT_CODES.get(keys[key]) for key in (PROJECTED_UNIT, VERTICAL_UNIT) if key in keys]
    if PROJECTED_UNIT not in keys:
        return ReferenceSystem(None, crs)
    return ReferenceSystem(units[0], crs) if len(set(units)) == 1 else ReferenceSystem(None, crs, units[1])


def of_wkt(text: str) -> ReferenceSystem:
    """The system that well-known text (OGC 01-009 or ISO 19162) describes; what is damaged states nothing."""
    root = _parsed(text)
    if root is None:
        return ReferenceSystem()
    nodes = list(root.walk())
    flat = _horizontal(root)
    height = next((node for node in nodes if node.name in VERTICAL), None)
    if flat is None:
        return ReferenceSystem()
    # With the shift of its datum, which is around it.
    bound = [node for node in nodes if node.name == "BOUNDCRS"]
    whole = next((node for node in bound if any(own is flat for own in node.walk())), flat)
    crs = flat.epsg() or (None if flat.name in LOCAL else whole.text)
    unit = flat.unit()
    if unit in ANGLES:
        return ReferenceSystem(unit, crs)
    if flat.name in GEODETIC:
        # The code alone would not tell that z is no height.
        return ReferenceSystem(unit, whole.text) if unit is not None else ReferenceSystem(ANGLE, crs)
    if flat.name in GEOGRAPHIC:
        return ReferenceSystem(ANGLE, crs)
    if height is None or height.unit() == unit:
        return ReferenceSystem(unit, crs)
    return ReferenceSystem(None, crs, height.unit() if unit is not None else None)


def _horizontal(root: "_Node") -> "_Node | None":
    """The system of x and y; a projected one also stands beside the geodetic one that it is based on."""
    kinds = (PROJECTED + LOCAL, GEODETIC + GEOGRAPHIC)
    return next((node for kind in kinds for node in root.walk() if node.name in kind), None)


@dataclass
class _Node:
    """A keyword of WKT with what stands in its brackets.

    Attributes:
        name: the keyword.
        start: which token it is.
        values: words, numbers and quoted texts.
        children: further keywords.
        text: all of it, without blanks.
    """

    name: str
    start: int = 0
    values: list[str] = field(default_factory=list)
    children: list["_Node"] = field(default_factory=list)
    text: str = ""

    def walk(self) -> Iterator["_Node"]:
        yield self
        for child in self.children:
            yield from child.walk()

    def unit(self) -> str | None:
        """The unit of the system itself, or of all its axes; where some are angles, that of these."""
        axes = [unit for axis in self.children if axis.name == "AXIS" for unit in axis.children]
        units = {unit.size() for unit in [*self.children, *axes] if unit.name in UNITS}
        angles = [unit for unit in ANGLES if unit in units]
        return angles[0] if angles else units.pop() if len(units) == 1 else None

    def size(self) -> str | None:
        """The name of a unit, by its size."""
        try:
            size = float(self.values[1])
        except (IndexError, ValueError):
            size = math.nan
        if abs(size - math.radians(1)) <= SAME_ANGLE * math.radians(1):
            return DEGREE
        if self.name == "ANGLEUNIT":
            return ANGLE
        return next((name for own, name in UNIT_LENGTHS.items() if abs(size - own) <= SAME_LENGTH * own), None)

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
            node = open_nodes.pop()
            node.text = "".join(tokens[node.start : index + 1])
        elif tokens[index + 1 : index + 2] in (["["], ["("]):
            node = _Node(token.upper(), index)
            open_nodes[-1].children.append(node)
            open_nodes.append(node)
            if len(open_nodes) > DEEPEST:
                return None
        elif token != ",":
            open_nodes[-1].values.append(token.strip('"'))
    roots = open_nodes[0].children
    return roots[0] if len(open_nodes) == 1 and roots else None
