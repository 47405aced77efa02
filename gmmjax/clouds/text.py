"""Reading clouds from lines of numbers: .xyz, .asc, .txt, .csv and .pts."""

import codecs
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds.colors import CHANNELS
from gmmjax.clouds.columns import AXES, cloud_of_columns, require_axes
from gmmjax.clouds.files import read_bytes
from gmmjax.clouds.number_table import NumberedLines, is_number
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.text_head import TextHead, cells_of, parse_head, plain_names
from gmmjax.errors import InputError, shown, warn

if TYPE_CHECKING:
    import pyarrow

LAYOUTS = {
    3: AXES,
    4: (*AXES, "intensity"),
    6: (*AXES, *CHANNELS),
    7: (*AXES, "intensity", *CHANNELS),
}
COMMENTS = (b"#", b"//")
# Lines below the first row. They begin with a line feed, which is found ten times as fast as the start of a line.
COMMENT_LINE = re.compile(rb"\n[ \t]*(?:#|//)[^\n]*")
BLANK_LINE = re.compile(rb"\n[ \t\v\f]*(?=\n|\Z)")
COUNT_LINE = re.compile(rb"\n[ \t]*(\d{1,18})[ \t]*(?=\n|\Z)")
GRID = re.compile(rb"\s*ncols\s+\d+\s+nrows\s", re.IGNORECASE)
# A number such as 1,234 is one with a decimal comma, or one of thousands.
MAY_BE_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
# NaN as C libraries and data frames write it; an empty cell is NaN, too.
MISSING = ["", "-nan", "-nan(ind)", "nan(ind)", "-NaN", "NA", "N/A", "NULL", "null", "None"]
# Numbers of returns, and most classes, do not exceed it in any row; each channel of a scan's colours does, or is 0.
DARK = 7


def open_text(path: Path) -> PointCloud:
    """Read the points of a text file, a point on each line, values separated by blanks, tabs, commas or semicolons.

    Lines that start with # or // are comments. A line of words, or a comment, that names x, y, z and all other columns
    above the first point is used; without one, 3 columns are x y z, 4 are x y z intensity, 6 are x y z red green blue
    and 7 are x y z intensity red green blue. Lines of one whole number are numbers of points, as a .pts file has them.

    Args:
        path: the file, in UTF-8 or any encoding that extends ASCII, or in UTF-16.

    Returns:
        The cloud, points in the order of the file.

    Raises:
        InputError: the file cannot be read, a coordinate is no number (the message has its line), columns that cannot
            be told, or not as many points as are declared.

    Warns:
        InputWarning: a column of text, which is left out, or columns without names that cannot be told.
    """
    source = str(path)
    text = _decoded(read_bytes(path), source)
    if GRID.match(text):
        raise InputError(f"{source}: is a raster (an ESRI ASCII grid), not points; export its cells as points x y z")
    head = parse_head(text, source)
    names = _names(head, source)
    if head.row is None:
        return cloud_of_columns({name: np.zeros(0) for name in names}, source)
    rows = _Rows(text, head, names, source)
    columns = rows.columns()
    if head.names is None:
        columns = _checked_guess(columns, head, source, known=path.suffix.lower() == ".pts")
    return cloud_of_columns(columns, source)


def _decoded(content: bytes, source: str) -> bytes:
    """The text in UTF-8, or in what extends ASCII, with line feeds alone."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        content = content.decode("utf-16", "replace").encode()
    content = content.removeprefix(codecs.BOM_UTF8)
    if content[:2].count(0) == 1:
        raise InputError(f"{source}: is no text in UTF-8, nor in UTF-16 with a byte order mark; save it as UTF-8")
    return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in content else content


def _names(head: TextHead, source: str) -> tuple[str, ...]:
    """A name for each column."""
    if head.names is None:
        cells = list(AXES) if head.row is None else cells_of(head.row.content, head.separator)
        width = len(cells) - (len(cells) > 3 and not cells[-1])
        if width not in LAYOUTS:
            assert head.row is not None
            raise InputError(
                f"{source}: line {head.row.number} has {width} values; without a header line, 3 (x y z), 4 (and "
                "intensity), 6 (x y z red green blue) or 7 (x y z intensity red green blue) are known: add a line of "
                "column names"
            )
        return LAYOUTS[width]
    names = plain_names(head.names)
    while names and not names[-1]:
        names.pop()
    lower = [name.lower() if name.lower() in AXES else name for name in names]
    if repeated := {name for name in lower if name and lower.count(name) > 1}:
        raise InputError(f"{source}: the header line names {sorted(repeated)} more than once; rename one of them")
    require_axes(names, source)
    return tuple(name or f"column_{number}" for number, name in enumerate(names, 1))


class _Rows:
    """The rows of a text file.

    Args:
        text: of the file.
        head: what stands above them.
        names: of their columns, without an empty last one.
        source: the file, for messages.
    """

    def __init__(self, text: bytes, head: TextHead, names: tuple[str, ...], source: str) -> None:
        assert head.row is not None
        self._text, self._head, self._names, self._source = text[head.row.start :], head, names, source
        self._first = head.row.number
        cells = cells_of(head.row.content, head.separator)
        # Separators after the last value.
        self._width = max(len(names), len(cells)) if not any(cells[len(names) :]) else len(names)
        self._decimal_commas = False

    def columns(self) -> dict[str, Float64[np.ndarray, " n"]]:
        """The columns of numbers.

        Raises:
            InputError: a row without as many values as there are columns, or a coordinate or colour that is no number.
        """
        body = self._without_other_lines()
        table = self._parsed(body)
        needed = {*AXES, *CHANNELS, "intensity"} if self._head.names else set(self._names)
        if b"," in body and self._head.separator in ";\t" and len(_numbers(table)) < len(self._names):
            table = self._with_decimal_commas(body, table)
        columns, numbers = {}, _numbers(table)
        for name, column in zip(table.column_names, table.columns, strict=True):
            if name in AXES and column.null_count:
                self._check(needed)
            if name in numbers:
                columns[name] = column.cast("float64", safe=False).to_numpy()
            else:
                self._left_out(name, needed)
        return columns

    def _without_other_lines(self) -> bytes:
        """The rows alone; blank lines, comments and the numbers of points are checked and left out."""
        body = self._text
        if b"#" in body or b"//" in body:
            body = COMMENT_LINE.sub(b"", body)
        if self._head.separator == " ":
            body = _single_blanks(body)
        body = BLANK_LINE.sub(b"", body)
        return self._without_counts(body) if self._head.counts else body

    def _without_counts(self, body: bytes) -> bytes:
        """The rows without the number of points above each block, which has to be right."""
        declared, start, blocks = int(self._head.counts[-1].content), 0, list[bytes]()
        for found in (*COUNT_LINE.finditer(body), None):
            block = body[start : None if found is None else found.start()]
            count = block.count(b"\n") + bool(block)
            if count != declared:
                where = f"line {self._head.counts[-1].number}" if not blocks else f"block {len(blocks) + 1}"
                raise InputError(
                    f"{self._source}: declares {declared} points in {where}, {count} are there; the file is "
                    "cut off, or the number must be corrected"
                )
            blocks.append(block)
            if found is not None:
                declared, start = int(found[1]), found.end() + 1
        return b"\n".join(filter(None, blocks))

    def _parsed(self, body: bytes, decimal_point: str = ".") -> "pyarrow.Table":
        import pyarrow
        from pyarrow import csv

        names = [*self._names, *[""] * (self._width - len(self._names))]
        try:
            table = csv.read_csv(
                pyarrow.BufferReader(body),
                read_options=csv.ReadOptions(column_names=names),
                parse_options=csv.ParseOptions(delimiter=self._head.separator),
                convert_options=csv.ConvertOptions(null_values=MISSING, check_utf8=False, decimal_point=decimal_point),
            )
        except pyarrow.ArrowInvalid as error:
            self._check(set())
            raise InputError(f"{self._source}: cannot be read ({shown(str(error))}); export it again") from error
        lines = body.count(b"\n") + 1
        if len(table) != lines or any(str(own.type) != "null" for own in table.columns[len(self._names) :]):
            self._check(set())
            raise InputError(f"{self._source}: has {len(table)} rows in {lines} lines; a quote is not closed")
        return table.select(range(len(self._names)))

    def _with_decimal_commas(self, body: bytes, table: "pyarrow.Table") -> "pyarrow.Table":
        """The rows with decimal commas, where more columns are numbers then, and none can be one of thousands."""
        with_commas = self._parsed(body, ",")
        numbers = _numbers(with_commas)
        if not set(AXES) <= numbers or len(numbers) <= len(_numbers(table)):
            return table
        commas = (cell for _, row in self._numbered() for cell in row if "," in cell)
        cells = [cell for cell in commas if is_number(cell.replace(",", "."))]
        if all(map(MAY_BE_THOUSANDS.fullmatch, cells)):
            raise InputError(
                f"{self._source}: has numbers such as {shown(cells[0])}, whose comma may be a decimal one or one of "
                "thousands; write decimal points"
            )
        self._decimal_commas = True
        return with_commas

    def _left_out(self, name: str, needed: set[str]) -> None:
        """Warn of a column of text, or say where one that is needed is no number."""
        if name in needed:
            self._check({name})
        place = self._names.index(name)
        cells = ((number, row[place]) for number, row in self._numbered() if place < len(row))
        number, cell = next(((n, own) for n, own in cells if not is_number(own) and own not in MISSING), (0, ""))
        if name in needed or not number:
            raise InputError(f"{self._source}: the column {shown(name)} cannot be read; write plain decimal numbers")
        warn(f"{self._source}: the column {shown(name)} has text (line {number}: {shown(cell)}), and is left out")

    def _numbered(self) -> Iterator[tuple[int, list[str]]]:
        """The rows with their line numbers, slowly."""
        for number, line in NumberedLines(self._text, self._first, COMMENTS):
            cells = cells_of(line.decode("utf-8", "replace"), self._head.separator)
            if not (self._head.counts and len(cells) == 1 and cells[0].isdigit()):
                yield number, cells

    def _check(self, needed: set[str]) -> None:
        """Raise an error for the first row that cannot be read, where there is one."""
        for number, cells in self._numbered():
            where = f"{self._source}: line {number}"
            if len(cells) != self._width or any(cells[len(self._names) :]):
                raise InputError(
                    f"{where} has {len(cells)} values where {self._width} are expected "
                    f"({shown(', '.join(self._names))}); the line is incomplete, or the names do not fit"
                )
            for name, cell in zip(self._names, cells, strict=False):
                if name in needed and not cell:
                    raise InputError(
                        f"{where} has an empty cell ({name}) between two separators; fill it, with nan if need be"
                    )
                plain = cell.replace(",", ".") if self._decimal_commas else cell
                if name in needed and not is_number(plain) and cell not in MISSING:
                    comma = ", nor are decimal commas beside decimal points read" if "," in cell else ""
                    remedy = "correct the line or make it a comment"
                    if not self._head.names:
                        remedy += ", or name the columns in a first line: those of text are left out"
                    raise InputError(f"{where}: {shown(cell)} is no number{comma}; {remedy}")


def _numbers(table: "pyarrow.Table") -> set[str]:
    """The columns that are numbers."""
    return {field.name for field in table.schema if str(field.type) in ("int64", "double", "null")}


def _single_blanks(body: bytes) -> bytes:
    """The text with one blank between the values, and none around a line."""
    body = body.replace(b"\t", b" ")
    while b"  " in body:
        body = body.replace(b"  ", b" ")
    if body.startswith(b" ") or b"\n " in body or b" \n" in body or body.endswith(b" "):
        body = body.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")
    return body


def _checked_guess(
    columns: Mapping[str, np.ndarray], head: TextHead, source: str, *, known: bool
) -> dict[str, np.ndarray]:
    """Rename the columns, as `LAYOUTS` names them, of a file without names to fields where their values contradict it.

    Args:
        columns: numbers by name.
        head: of the file.
        source: the file, for messages.
        known: whether the format tells the columns, as .pts does.

    Raises:
        InputError: the first column holds numbers of points or classes.
    """
    assert head.row is not None
    x, y, z = (columns[axis] for axis in AXES)
    if len(columns) > 3 and not known:
        counted = len(x) > 2 and x[0] in (0, 1) and (np.diff(x) == 1).all()
        if counted or (_whole(x) and not _whole(y) and not _whole(z)):
            raise InputError(
                f"{source}: the first of {len(columns)} columns has whole numbers, such as those of points or classes; "
                "add a line of column names"
            )
    if _plausible(columns, known):
        return dict(columns)
    warn(
        f"{source}: the columns beside x y z are taken for fields, since their numbers are not those of intensity and "
        "colours; add a line of column names"
    )
    return {name if name in AXES else f"column_{number}": own for number, (name, own) in enumerate(columns.items(), 1)}


def _plausible(columns: Mapping[str, np.ndarray], known: bool) -> bool:
    """True if the numbers can be an intensity and colours of 8 or 16 bits."""
    intensity = columns.get("intensity", np.zeros(0))
    if not _whole(intensity) and not known and np.nanmin(intensity) < 0:
        return False
    if "red" not in columns:
        return True
    colors = np.stack([columns[channel] for channel in CHANNELS])
    highest = np.nanmax(np.nan_to_num(colors), axis=1)
    if not _whole(colors) or np.nan_to_num(colors).min() < 0 or highest.max() > 65535:
        return False
    return not ((highest > 0) & (highest <= (1 if known else DARK))).any()


def _whole(values: np.ndarray) -> bool:
    numbers = values[np.isfinite(values)]
    return bool((numbers == np.rint(numbers)).all())
