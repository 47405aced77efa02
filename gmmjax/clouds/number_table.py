"""Numbers in lines of text, fast where all is well and with the line number where it is not."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float64

from gmmjax.errors import InputError

NEWLINE, CARRIAGE_RETURN = b"\n", b"\r"


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
        for number, raw in enumerate(_split(self.text), start=self.first):
            line = raw.strip()
            if line and not line.startswith(self.comments):
                yield number, line


def parse_table(
    lines: NumberedLines, columns: int, source: str, *, count: int, what: str, skip: int = 0
) -> Float64[np.ndarray, "n c"]:
    """The numbers of consecutive lines.

    Args:
        lines: the text; values are separated by blanks.
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
    stop = skip + count
    rows = (line for _, line in islice(lines, skip, stop))
    first = next(rows, None)
    if first is None or not columns:
        if count:
            raise cut_off(count, 0, what, source)
        return np.zeros((0, columns))
    cause: ValueError | None = None
    try:
        table = np.loadtxt(itertools.chain([first], rows), comments=None, ndmin=2, encoding="latin1")
    except ValueError as error:
        cause, table = error, np.zeros((0, 0))
    if table.shape == (count, columns):
        return table
    available = sum(1 for _ in lines) - skip
    if table.shape[1] == columns:
        raise cut_off(count, available, what, source)
    fault = _first_fault(lines, columns, source, skip, stop, cause)
    if available < count:
        raise InputError(f"{cut_off(count, available, what, source)} ({fault})") from cause
    raise fault from cause


def cut_off(declared: int, available: int, what: str, source: str) -> InputError:
    """The error of a file that ends early."""
    return InputError(
        f"{source}: declares {declared} {what}, {available} are there; the file is cut off, copy or export it again"
    )


def is_number(token: bytes | str) -> bool:
    """Whether a word of text is a number."""
    text = token.decode("latin-1") if isinstance(token, bytes) else token
    try:
        float(text)
    except ValueError:
        return False
    # Python takes more for numbers than files have.
    return text.isascii() and "_" not in text


def _split(text: bytes) -> Iterator[bytes]:
    """Lines one at a time, so that a text of gigabytes is not held twice."""
    if CARRIAGE_RETURN in text:
        text = text.replace(b"\r\n", NEWLINE).replace(CARRIAGE_RETURN, NEWLINE)
    start = 0
    while (end := text.find(NEWLINE, start)) >= 0:
        yield text[start:end]
        start = end + 1
    if start < len(text):
        yield text[start:]


def _first_fault(
    lines: NumberedLines, columns: int, source: str, skip: int, stop: int, cause: Exception | None
) -> InputError:
    """What to say about the first line that cannot be read."""
    for number, line in islice(lines, skip, stop):
        words = line.split()
        strange = next((word for word in words if not is_number(word)), None)
        if strange is not None:
            shown = strange[:40].decode("ascii", "backslashreplace")
            return InputError(f"{source}: line {number}: {shown!r} is no number; correct the line or make it a comment")
        if len(words) != columns:
            return InputError(
                f"{source}: line {number} has {len(words)} values where {columns} are expected; "
                "the line is incomplete or the file is cut off"
            )
    return InputError(f"{source}: the numbers cannot be read ({cause}); write plain decimal numbers")
