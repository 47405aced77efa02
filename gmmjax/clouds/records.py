"""Records of equal length in a file, read some at a time."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from gmmjax.clouds.cloud_file import CloudFile, RowBlock
from gmmjax.clouds.columns import block_of_columns
from gmmjax.errors import InputError

# Bytes of records that are read at a time: beside the result, the memory that reading takes.
BLOCK = 1 << 25


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class RecordFile(CloudFile):
    """A file of records of equal length, one for each point.

    Attributes:
        offset: bytes before the first.
        row_type: of a record, whose fields are the columns of the points.
    """

    offset: int
    row_type: np.dtype

    def columns_of(self, rows: np.ndarray) -> Mapping[str, np.ndarray]:
        """The columns of some records by name."""
        return {name: rows[name] for name in self.row_type.names or ()}

    def blocks(self) -> Iterator[RowBlock]:
        """Yield all points, some at a time; raises an `InputError` where the file is cut off."""
        for rows in stored_records(self.path, self.offset, self.row_type, self.count):
            yield block_of_columns(self.columns_of(rows), str(self.path))


def cut_off(declared: int, available: int, what: str, source: str) -> InputError:
    """The error of a file that ends early."""
    return InputError(
        f"{source}: declares {declared} {what}, {available} are there; the file is cut off, copy or export it again"
    )


def require_records(file: Path, size: int, row_type: np.dtype, count: int, what: str) -> None:
    """Check that there is room for so many records in the bytes of a file, and raise an `InputError` otherwise."""
    available = max(size, 0) // row_type.itemsize
    if available < count:
        raise cut_off(count, available, what, str(file))


def stored_records(file: Path, offset: int, row_type: np.dtype, count: int) -> Iterator[np.ndarray]:
    """Yield the records of a file, a block at a time.

    They are read and not mapped into memory: where a mapped file is cut off by another program, or its disk fails, the
    system ends the process.

    Args:
        file: that holds them.
        offset: bytes before the first.
        row_type: of a record.
        count: how many there are.

    Raises:
        InputError: the file ends before the last.
        OSError: it cannot be read.
    """
    left, length = count, max(BLOCK // row_type.itemsize, 1)
    with file.open("rb") as stream:
        stream.seek(offset)
        while left:
            rows = np.fromfile(stream, row_type, min(left, length))
            if not len(rows):
                raise InputError(f"{file}: ends {left} points before its end; copy it again")
            left -= len(rows)
            yield rows
