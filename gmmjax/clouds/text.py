"""Reading clouds from lines of numbers: .xyz, .asc, .txt, .csv and .pts."""

import os
import re
from pathlib import Path

from gmmjax.clouds.colors import CHANNELS
from gmmjax.clouds.columns import AXES, cloud_of_columns, require_axes
from gmmjax.clouds.files import read_bytes
from gmmjax.clouds.number_table import NumberedLines, is_number, parse_table
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.errors import InputError

COMMENTS = (b"#", b"//")
LAYOUTS = {
    3: AXES,
    4: (*AXES, "intensity"),
    6: (*AXES, *CHANNELS),
    7: (*AXES, "intensity", *CHANNELS),
}
SHORT_NAMES = {"r": "red", "g": "green", "b": "blue"}
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
EMPTY_CELL = re.compile(rb"[,;][ \t]*[,;]")
# In lines of numbers alone: words and comments may have any commas.
COMMA_IN_NUMBER = rb"(?m)^(?=[ \t]*[-+.0-9])(?=[^\n]*\d,\d)"
SEMICOLONS = re.compile(rb"(?m)^[ \t]*[-+.0-9][^\n;]*;")
BESIDE_SEMICOLONS = re.compile(COMMA_IN_NUMBER)
BESIDE_BLANKS = re.compile(COMMA_IN_NUMBER + rb"(?=[^\n]*[^\s,][ \t]+[^\s,])")
GRID = re.compile(rb"\s*ncols\s+\d+\s+nrows\s", re.IGNORECASE)


def read_text(path: str | os.PathLike[str]) -> PointCloud:
    """The points of a text file, a point on each line, values separated by blanks, tabs, commas or semicolons.

    Lines that start with # or // are comments. A first line of words names the columns; without one, 3 columns are
    x y z, 4 are x y z intensity, 6 are x y z red green blue and 7 are x y z intensity red green blue. A .pts file
    starts with the number of its points.

    Args:
        path: the file.

    Returns:
        The cloud, points in the order of the file.

    Raises:
        InputError: the file cannot be read, or a line is not numbers (the message has its number), or the number of
            points at the head of a .pts file is wrong.
    """
    source = str(path)
    text = read_bytes(path).removeprefix(BYTE_ORDER_MARK)
    lines = NumberedLines(_separated_by_blanks(text, source), comments=COMMENTS)
    skip, declared = 0, None
    if Path(path).suffix.lower() == ".pts":
        skip, declared = 1, _declared_count(lines, source)
    names = _header_names(lines, skip)
    skip += names is not None
    columns = names or _layout(lines, skip, source)
    if repeated := {name for name in columns if columns.count(name) > 1}:
        raise InputError(f"{source}: the header line names {sorted(repeated)} more than once; rename one of them")
    require_axes(columns, source)
    table = parse_table(lines, len(columns), source, skip=skip)
    if declared not in (None, len(table)):
        raise InputError(
            f"{source}: declares {declared} points in its first line, {len(table)} are there; "
            "the file is cut off, or the first line must be corrected"
        )
    return cloud_of_columns({name: table[:, index] for index, name in enumerate(columns)}, source)


def _separated_by_blanks(text: bytes, source: str) -> bytes:
    """The text with blanks in place of commas or semicolons, where it is clear which of them separate the numbers."""
    if GRID.match(text):
        raise InputError(f"{source}: is a raster (an ESRI ASCII grid), not points; export its cells as points x y z")
    # Lines end in any way; for the search all in one.
    ends = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text
    if gap := EMPTY_CELL.search(ends):
        raise InputError(
            f"{source}: line {_line(ends, gap)} has an empty cell between two separators; fill it, with nan if need be"
        )
    mixed = BESIDE_SEMICOLONS if b";" in text and SEMICOLONS.search(ends) else BESIDE_BLANKS
    if b"," in text and (comma := mixed.search(ends)):
        raise InputError(
            f"{source}: line {_line(ends, comma)} has commas beside other separators: numbers with a decimal comma are "
            "not read; write decimal points"
        )
    return ends.replace(b",", b" ").replace(b";", b" ")


def _line(text: bytes, found: re.Match[bytes]) -> int:
    return text.count(b"\n", 0, found.end()) + 1


def _words(lines: NumberedLines, skip: int) -> tuple[int, list[bytes]]:
    """The number and the words of the first line after `skip` lines; no words at the end of the file."""
    for index, (number, line) in enumerate(lines):
        if index == skip:
            return number, line.split()
    return 0, []


def _declared_count(lines: NumberedLines, source: str) -> int:
    number, words = _words(lines, 0)
    if len(words) != 1 or not words[0].isdigit() or len(words[0]) > 18:
        shown = b" ".join(words)[:60].decode("ascii", "backslashreplace")
        raise InputError(
            f"{source}: line {number} of a .pts file must be the number of points, not {shown!r}; "
            "add it, or rename the file to .xyz"
        )
    return int(words[0])


def _header_names(lines: NumberedLines, skip: int) -> tuple[str, ...] | None:
    """The names in the header line, or None where the first line is numbers."""
    _, words = _words(lines, skip)
    if not words or any(is_number(word) for word in words):
        return None
    names = [word.decode("utf-8", "replace").strip("\"'") for word in words]
    known = {*AXES, *CHANNELS, *SHORT_NAMES, "intensity"}
    plain = [name.lower() if name.lower() in known else name for name in names]
    return tuple(SHORT_NAMES.get(name, name) for name in plain)


def _layout(lines: NumberedLines, skip: int, source: str) -> tuple[str, ...]:
    number, words = _words(lines, skip)
    if not words:
        return AXES
    if len(words) not in LAYOUTS:
        raise InputError(
            f"{source}: line {number} has {len(words)} values; without a header line, 3 (x y z), 4 (and intensity), "
            "6 (x y z red green blue) or 7 (x y z intensity red green blue) are known: add a line of column names"
        )
    return LAYOUTS[len(words)]
