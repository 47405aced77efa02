"""Numbers in lines of text, fast where all is well and with the line number where it is not."""

import io
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds.records import cut_off
from gmmjax.errors import InputError


@dataclass(frozen=True)
class NumberedLines:
    """The lines of a text with their numbers, without blank lines and comments; any line ending.

    Attributes:
        text: the lines.
        first: the number of the first line, as an editor counts.
        comments: what a comment line starts with.
    """

    text: bytes
    first: int = 1
    comments: tuple[bytes, ...] = ()

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Line numbers and lines, stripped."""
        text = self.text
        if b"\r" in text:
            text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        for number, raw in enumerate(io.BytesIO(text), start=self.first):
            line = raw.strip()
            if line and not line.startswith(self.comments):
                yield number, line


def parse_table(
    lines: NumberedLines, columns: int, source: str, *, count: int, what: str, skip: int = 0
) -> Float64[np.ndarray, "n c"]:
    """Parse the numbers of consecutive lines, separated by blanks.

    Args:
        lines: the text.
        columns: how many numbers each line must have.
        source: the file, for messages.
        count: how many lines to read.
        what: they are, for messages.
        skip: how many lines to pass over first.

    Returns:
        The numbers, a row for each line.

    Raises:
        InputError: fewer lines, or one that is not `columns` numbers; the message has its number.
    """
    rows = (line for _, line in islice(lines, skip, skip + count))
    table, cause = np.zeros((0, columns)), None
    # NumPy warns where there is no line.
    if first := next(rows, None):
        try:
            table = np.loadtxt(itertools.chain([first], rows), comments=None, ndmin=2, encoding="latin1")
        except ValueError as error:
            table, cause = np.zeros((0, 0)), error
    if table.shape == (count, columns):
        return table
    if cause is None and table.shape[1] == columns:
        raise cut_off(count, len(table), what, source)
    _check_words(islice(lines, skip, skip + count), columns, source)
    raise InputError(f"{source}: the numbers cannot be read ({cause}); write plain decimal numbers") from cause


def is_number(token: bytes | str) -> bool:
    """True if a word of text is a number."""
    text = token.decode("latin-1") if isinstance(token, bytes) else token
    try:
        float(text)
    except ValueError:
        return False
    # Python takes more for numbers than files have.
    return text.isascii() and "_" not in text


def _check_words(lines: Iterator[tuple[int, bytes]], columns: int, source: str) -> None:
    """Raise an error for the first line that cannot be read, where there is one."""
    for number, line in lines:
        words = line.split()
        strange = next((word for word in words if not is_number(word)), None)
        if strange is not None:
            shown = strange[:40].decode("ascii", "backslashreplace")
            raise InputError(f"{source}: line {number}: {shown!r} is no number; correct the line or make it a comment")
        if len(words) != columns:
            raise InputError(
                f"{source}: line {number} has {len(words)} values where {columns} are expected; "
                "the line is incomplete or the file is cut off"
            )
