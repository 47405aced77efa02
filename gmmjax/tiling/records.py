"""What was computed of each block, on disk.

Every worker appends to a file of its own; where the record of a block begins is known to the one who asked for it. What
a worker wrote before it died is in no index, and is not read.
"""

import secrets
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

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


class RecordPlace(NamedTuple):
    """Where the record of a block is.

    Attributes:
        number: of the block.
        file: name of the file.
        start: its first byte there.
        names: of the values, of the columns of the before cloud, and of those of the after cloud.
    """

    number: int
    file: str
    start: int
    names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]


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
        values, before, after = self._groups(number, 3)
        return BlockResult(values, Pair(before, after))

    def values(self, number: int) -> Arrays:
        """The values of a block, without those of its rows, which are not read.

        Args:
            number: of the block.
        """
        return self._groups(number, 1)[0]

    def _groups(self, number: int, count: int) -> list[dict[str, npt.NDArray[np.generic]]]:
        place = self._places[number]
        with disk_errors(self._folder), (self._folder / place.file).open("rb") as file:
            file.seek(place.start)
            return [
                {name: np.lib.format.read_array(file, allow_pickle=False) for name in names}
                for names in place.names[:count]
            ]

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
    """
    groups = (result.values, result.rows.before, result.rows.after)
    if not hasattr(_of_thread, "name"):
        _of_thread.name = f"{secrets.token_hex(8)}.records"
    name = _of_thread.name
    with disk_errors(folder), (folder / name).open("ab") as file:
        start = file.tell()
        for arrays in groups:
            for values in arrays.values():
                np.lib.format.write_array(file, np.asanyarray(values), allow_pickle=False)
    names = tuple(groups[0]), tuple(groups[1]), tuple(groups[2])
    return RecordPlace(number, name, start, names)
