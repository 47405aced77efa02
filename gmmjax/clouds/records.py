"""Records of equal length in a file, read some at a time."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gmmjax.errors import InputError

# Bytes of records that are read at a time: beside the result, the memory that reading takes.
BLOCK = 1 << 25


def stored_records(file: Path, offset: int, row_type: np.dtype, count: int, beside: int = 1) -> Iterator[np.ndarray]:
    """The records of a file, a block at a time.

    They are read and not mapped into memory: where a mapped file is cut off by another program, or its disk fails, the
    system ends the process.

    Args:
        file: that holds them.
        offset: bytes before the first.
        row_type: of a record.
        count: how many there are.
        beside: how many such columns of records are read side by side, which share the memory of a block.

    Raises:
        InputError: the file ends before the last.
        OSError: it cannot be read.
    """
    left, length = count, max(BLOCK // beside // row_type.itemsize, 1)
    with file.open("rb") as stream:
        stream.seek(offset)
        while left:
            rows = np.fromfile(stream, row_type, min(left, length))
            if not len(rows):
                raise InputError(f"{file}: ends {left} points before its end; copy it again")
            left -= len(rows)
            yield rows
