"""The lines above the rows of a text file of points: names of columns, numbers of points, remarks."""

import csv
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gmmjax.clouds.columns import AXES, canonical_names
from gmmjax.clouds.number_table import is_number
from gmmjax.errors import InputError, shown, warn

# A semicolon starts a remark only above the rows: it may separate cells, the first of which is empty.
REMARK = re.compile(r"(?:#|//|%|;(?=[^;]*$))[#/%\s]*")
# Of a remark before the names, such as "columns: ".
LABEL = re.compile(r"[^,;:]*:\s*|(?:fields|columns)\s+", re.IGNORECASE)
WORD = re.compile(r'"[^"]*"|[^\s,;]+')
BLANK_SEPARATED = re.compile(r'"[^"]*"|[^\s"]\S*')
AXIS_WITH_UNIT = re.compile(r"([xyz])\s*[\[(].*[\])]", re.IGNORECASE)
# Characters of the longest line above the rows: a binary file may have no line ends.
LONGEST_LINE = 1 << 16


class Line(NamedTuple):
    """A line: its number as an editor counts, its first byte in the text, and what it says."""

    number: int
    start: int
    content: str


class TextHead(NamedTuple):
    """The content of the lines above the first row, and the first row itself.

    Attributes:
        row: the first row; None where there is none.
        names: of the columns, in their order; None where no line names them.
        counts: the numbers of points that are declared, with their lines.
        separator: between the cells of a row: a semicolon, a comma, a tab, or a blank for any number of blanks and
            tabs.
    """

    row: Line | None
    names: tuple[str, ...] | None
    counts: tuple[Line, ...]
    separator: str


def parse_head(text: bytes, source: str) -> TextHead:
    """Parse the lines above the first row.

    The names are those of the line without numbers, or of the remark, that is nearest to the first row, names x, y and
    z, and has as many names as the row has cells.

    Args:
        text: with line feeds.
        source: the file, for messages.

    Raises:
        InputError: names that do not fit the rows, so that columns could only be guessed against them.
    """
    remarks, counts = list[Line](), list[Line]()
    header, row = None, None
    for line in _lines(text, source):
        words = _words(line.content)
        if remark := REMARK.match(line.content):
            remarks.append(line._replace(content=line.content[remark.end() :]))
        elif len(words) == 1 and words[0].isascii() and words[0].isdigit() and len(words[0]) < 19:
            counts.append(line._replace(content=words[0]))
        elif _has_axes(words) or not (_has_numbers(words) or (header and _has_axes(_words(header.content)))):
            header = line
        elif row is None and words == [str(place) for place in range(max(len(words), 3))]:
            # Numbers of columns, as data frames write them, or a point: the next line tells.
            row = line
        else:
            if row is not None and not all(word.isdigit() for word in words):
                warn(f"{source}: line {row.number} has the numbers of the columns, as of a data frame, and is no point")
                row = None
            row = row or line
            break
    if len(counts) > 1 and int(counts[0].content):
        raise InputError(
            f"{source}: starts with two whole numbers, as a PTX file does, which holds scans with poses; "
            "export it as PTS, E57 or LAS"
        )
    if row is None:
        return TextHead(None, None if header is None else tuple(_words(header.content)), tuple(counts), " ")
    named = remarks if header is None else [header]
    separator = _separator(row, named, source)
    names = [own for line in named if (own := _fitting(line, row, separator))]
    if not names and header is not None:
        cells = cells_of(header.content, separator)
        names = [tuple(cells if _has_axes(cells) else _words(header.content))]
    elif not names:
        _check_remarks(remarks, row, separator, source)
    return TextHead(row, names[-1] if names else None, tuple(counts), separator)


def cells_of(line: str, separator: str) -> list[str]:
    """Split a line into its cells, without quotes and the blanks around them."""
    if separator == " ":
        cells = BLANK_SEPARATED.findall(line)
    else:
        try:
            cells = next(csv.reader([line.strip(" ")], delimiter=separator, skipinitialspace=True), [])
        # A cell of more than 128 KiB.
        except csv.Error:
            cells = line.split(separator)
    return [_unquoted(cell) for cell in cells] or [""]


def _lines(text: bytes, source: str) -> Iterator[Line]:
    """All lines that are not blank."""
    start = number = 0
    while start < len(text):
        end = text.find(b"\n", start)
        end = len(text) if end < 0 else end
        number += 1
        if end - start > LONGEST_LINE:
            raise InputError(f"{source}: line {number} has {end - start} characters; it is no text with a point a line")
        if b"\0" in text[start:end]:
            raise InputError(f"{source}: line {number} is binary, not text; give the file the ending of its format")
        content = text[start:end].decode("utf-8", "replace")
        if content.strip():
            # A tab may be an empty cell.
            yield Line(number, start, content.strip(" \v\f"))
        start = end + 1


def _words(line: str) -> list[str]:
    return [_unquoted(word) for word in WORD.findall(line)]


def _has_numbers(words: Sequence[str]) -> bool:
    """True if a line can be a point; a title may have a year in it."""
    numbers = sum(map(is_number, words))
    return numbers >= len(AXES) or 2 * numbers > len(words)


def _unquoted(cell: str) -> str:
    return cell.strip().strip("\"'").strip()


def _has_axes(names: Sequence[str]) -> bool:
    return set(AXES) <= set(plain_names(names))


def plain_names(names: Sequence[str]) -> list[str]:
    """Rename "X", "Y (m)" and "z[m]" to x, y and z, and so for colours and the intensity."""
    without_units = [found[1] if (found := AXIS_WITH_UNIT.fullmatch(name)) else name for name in names]
    return ["intensity" if name.lower() == "intensity" else name for name in canonical_names(without_units)]


def _separator(row: Line, named: Sequence[Line], source: str) -> str:
    """The separator of the cells of a row; `named` are the lines that may name its columns."""
    for separator in ";,\t":
        # A text in the row may have any of them.
        if any(separator in line.content and _fitting(line, row, separator) for line in named):
            return separator
    if ";" in row.content:
        return ";"
    if "," in row.content:
        cells = cells_of(row.content, ",")
        titles = [cells_of(line.content, ",") for line in named]
        # A cell of several numbers has a comma in one of them, or is a date as the names tell.
        if not any(map(_several_numbers, cells)) or any(
            len(title) == len(cells) and _has_axes(title) for title in titles
        ):
            return ","
    if "\t" in row.content.strip() and not any(
        not cell or _several_numbers(cell) for cell in cells_of(row.content.strip(), "\t")
    ):
        return "\t"
    if "," in row.content:
        raise InputError(
            f"{source}: line {row.number} has commas beside other separators: numbers with a decimal comma are read "
            "where semicolons or tabs separate them; write decimal points"
        )
    return " "


def _several_numbers(cell: str) -> bool:
    words = cell.split()
    return len(words) > 1 and all(map(is_number, words))


def _fitting(line: Line, row: Line, separator: str) -> tuple[str, ...] | None:
    """The names in a line, where they are those of the row's cells."""
    cells = cells_of(row.content, separator)
    for content in (line.content, LABEL.sub("", line.content, count=1)):
        for names in (cells_of(content, separator), _words(content)):
            count = len(names)
            # Separators after the last cell of a row or after the last name, as of empty columns of a spreadsheet.
            while names and not names[-1]:
                names.pop()
            fits = len(names) <= len(cells) and (count >= len(cells) or not any(cells[len(names) :]))
            if fits and _has_axes(names):
                return (*names, *[""] * (len(cells) - len(names)))
    return None


def _check_remarks(remarks: Sequence[Line], row: Line, separator: str, source: str) -> None:
    """Check that columns can be told without the remarks, none of which names them."""
    width = len(cells_of(row.content, separator))
    for remark in reversed(remarks):
        words = plain_names(_words(remark.content))
        axes = tuple(word for word in words if word in AXES)
        if set(AXES) <= set(axes) and not (width == 3 and axes == AXES):
            raise InputError(
                f"{source}: line {remark.number} names columns ({_shown(words)}), not one for each of the {width} "
                f"values in line {row.number}; correct the names, with quotes around those that have blanks"
            )
    last = remarks[-1] if remarks else row
    cells = cells_of(last.content, separator)
    if width > 3 and len(cells) == width and last is not row and not any(map(is_number, cells)):
        raise InputError(
            f"{source}: line {last.number} seems to name the columns ({_shown(cells)}), and none of them x, y and z; "
            "rename those of the coordinates, or remove the line"
        )


def _shown(names: Sequence[str]) -> str:
    return shown(", ".join(names[:20]))
