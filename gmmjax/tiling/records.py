"""What was computed of each block, on disk.

Every worker appends to a file of its own; where each array of a block is in it is known to the one who asked for the
block. What a worker wrote before it died is in no index, and is not read.
"""

import math
import secrets
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from gmmjax.pair import Pair
from gmmjax.tiling.folder import disk_errors

Arrays = Mapping[str, npt.NDArray[np.generic]]
"""Arrays of any shape and of numbers or text, by name."""


# The name of each thread's file: a cluster has processes of several threads, and of one number on several hosts.
_of_thread = threading.local()


class BlockResult(NamedTuple):
    """What was computed of a block.

    Attributes:
        values: of the block, or of what is in it.
        rows: of each point inside of the block, in their order, for either cloud: what goes to the rows of the files.
    """

    values: Arrays
    rows: Pair[Arrays]


class StoredArray(NamedTuple):
    """Where an array is in a file, in C order.

    Attributes:
        start: its first byte.
        dtype: of its numbers.
        shape: its shape.
    """

    start: int
    dtype: np.dtype[np.generic]
    shape: tuple[int, ...]

    def read(self, file: BinaryIO) -> npt.NDArray[np.generic]:
        """The array.

        Args:
            file: open.
        """
        file.seek(self.start)
        return np.fromfile(file, self.dtype, math.prod(self.shape)).reshape(self.shape)


class RecordPlace(NamedTuple):
    """Where the record of a block is.

    Attributes:
        number: of the block.
        file: name of the file.
        values: of the block, by name.
        rows: the columns of either cloud, by name.
    """

    number: int
    file: str
    values: Mapping[str, StoredArray]
    rows: Pair[Mapping[str, StoredArray]]


class BlockRecords:
    """The results of all blocks, in the order of the blocks' numbers; each is read when it is asked for."""

    def __init__(self, folder: Path):
        """Has no records yet.

        Args:
            folder: in which workers write.
        """
        self._folder = folder
        self._places: dict[int, RecordPlace] = {}

    def add(self, place: RecordPlace) -> None:
        """Takes note of a record."""
        self._places[place.number] = place

    def __len__(self) -> int:
        return len(self._places)

    @property
    def numbers(self) -> list[int]:
        """The numbers of the blocks, in their order."""
        return sorted(self._places)

    def __getitem__(self, number: int) -> BlockResult:
        """The result of a block."""
        place = self._places[number]
        return BlockResult(self._read(place, place.values), place.rows.map(lambda own: self._read(place, own)))

    def values(self, number: int, *names: str) -> Arrays:
        """Values of a block; nothing else is read.

        Args:
            number: of the block.
            names: of the values; none: all of them.
        """
        place = self._places[number]
        return self._read(place, {name: place.values[name] for name in names or place.values})

    def _read(self, place: RecordPlace, arrays: Mapping[str, StoredArray]) -> Arrays:
        with disk_errors(self._folder), (self._folder / place.file).open("rb") as file:
            return {name: array.read(file) for name, array in arrays.items()}

    def __iter__(self) -> Iterator[tuple[int, BlockResult]]:
        """The number and the result of each block."""
        for number in self.numbers:
            yield number, self[number]


def write_record(folder: Path, number: int, result: BlockResult) -> RecordPlace:
    """Appends a result to this worker's file.

    Args:
        folder: that is there.
        number: of the block.
        result: what was computed.

    Raises:
        InputError: the disk is full.
        TypeError: an array of Python objects.
    """
    if not hasattr(_of_thread, "name"):
        _of_thread.name = f"{secrets.token_hex(8)}.records"
    name = _of_thread.name
    with disk_errors(folder), (folder / name).open("ab") as file:
        values, rows = _written(file, result.values), result.rows.map(lambda own: _written(file, own))
    return RecordPlace(number, name, values, rows)


def _written(file: BinaryIO, arrays: Arrays) -> dict[str, StoredArray]:
    """Appends arrays to a file, and says where they are."""
    places = {}
    for name, values in arrays.items():
        array = np.asarray(values)
        if array.dtype.hasobject:
            raise TypeError(f"{name}: Python objects cannot be written")
        places[name] = StoredArray(file.tell(), array.dtype, array.shape)
        file.write(array.tobytes())
    return places
