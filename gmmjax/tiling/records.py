"""The results of tasks for each block, on disk.

Every worker appends to a file of its own; where each array of a block is in it is known to the one who asked for the
block. What a worker wrote before it died is in no index, and is not read.
"""

import math
import secrets
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from gmmjax.tiling.disk import disk_errors

Arrays = Mapping[str, npt.NDArray[np.generic]]
"""Arrays of any shape and of numbers or text, by name."""


# The name of each thread's file: a cluster has processes of several threads, and of one number on several hosts.
_of_thread = threading.local()


class StoredArray(NamedTuple):
    """The place of an array in a file, in C order.

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
    """The place of the record of a block.

    Attributes:
        number: of the block.
        file: name of the file.
        arrays: of the block, by name.
    """

    number: int
    file: str
    arrays: Mapping[str, StoredArray]


class BlockRecords:
    """The results of all blocks; each is read when it is asked for."""

    def __init__(self, folder: Path):
        """Have no records yet.

        Args:
            folder: in which workers write.
        """
        self._folder = folder
        self._places: dict[int, RecordPlace] = {}

    def add(self, place: RecordPlace) -> None:
        """Take note of a record."""
        self._places[place.number] = place

    def __len__(self) -> int:
        return len(self._places)

    @property
    def numbers(self) -> list[int]:
        """The numbers of the blocks, in their order."""
        return sorted(self._places)

    def values(self, number: int, *names: str) -> Arrays:
        """The arrays of a block; nothing else is read.

        Args:
            number: of the block.
            names: of the arrays; none: all of them.
        """
        place = self._places[number]
        with disk_errors(self._folder), (self._folder / place.file).open("rb") as file:
            return {name: place.arrays[name].read(file) for name in names or place.arrays}


def write_record(folder: Path, number: int, arrays: Arrays) -> RecordPlace:
    """Append what was computed of a block to this worker's file.

    Args:
        folder: that is there.
        number: of the block.
        arrays: by name.

    Raises:
        InputError: the disk is full.
        TypeError: an array of Python objects.
    """
    if not hasattr(_of_thread, "name"):
        _of_thread.name = f"{secrets.token_hex(8)}.records"
    places = {}
    with disk_errors(folder), (folder / _of_thread.name).open("ab") as file:
        for name, values in arrays.items():
            array = np.asarray(values)
            if array.dtype.hasobject:
                raise TypeError(f"{name}: Python objects cannot be written")
            places[name] = StoredArray(file.tell(), array.dtype, array.shape)
            file.write(array.tobytes())
    return RecordPlace(number, _of_thread.name, places)
