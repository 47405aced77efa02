"""Values for each row of a cloud, on disk: filled block by block, read in the order of the rows."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from jaxtyping import Int64

from gmmjax.tiling.folder import disk_errors, reserve


class RowColumns:
    """Columns of a number of rows, each a file of its own; memory does not grow with the rows."""

    def __init__(self, folder: Path, count: int, missing: Mapping[str, np.generic]):
        """Makes the columns.

        Args:
            folder: for their files; it is made.
            count: of the rows.
            missing: the value of rows that are not filled, by the name of the column, whose type it gives.

        Raises:
            InputError: the disk is full.
        """
        self.count = count
        self.names = tuple(missing)
        self._folder = folder
        self._types = {name: value.dtype for name, value in missing.items()}
        with disk_errors(folder, count * sum(own.itemsize for own in self._types.values())):
            folder.mkdir()
            for name, value in missing.items():
                self._make(name, value)

    def fill(self, rows: Int64[np.ndarray, " n"], values: Mapping[str, npt.NDArray[np.generic]]) -> None:
        """Sets the values of some rows.

        Args:
            rows: their numbers.
            values: of each, for some of the columns.
        """
        for name, own in values.items():
            if len(rows):
                # Mapped while it is written only: mapped pages count as memory of the process.
                self._mapped(name, "r+")[rows] = own

    def column(self, name: str) -> npt.NDArray[np.generic]:
        """The values of all rows, which are read from the disk as they are looked at.

        Args:
            name: of the column.
        """
        return self._mapped(name, "r") if self.count else np.empty(0, self._types[name])

    def slices(self, size: int = 1_000_000) -> Iterator[dict[str, npt.NDArray[np.generic]]]:
        """The values of all rows, some at a time, in memory.

        Args:
            size: rows at a time, at most.
        """
        for start in range(0, self.count, size):
            yield {name: np.array(self._mapped(name, "r")[start : start + size]) for name in self.names}

    def _mapped(self, name: str, mode: str) -> np.memmap:
        return np.memmap(self._folder / name, self._types[name], mode, shape=(self.count,))  # type: ignore[call-overload]

    def _make(self, name: str, value: np.generic, piece: int = 1_000_000) -> None:
        # Written, not left empty: a mapped file without room on the disk ends the process.
        with (self._folder / name).open("xb") as file:
            reserve(file.fileno(), self.count * self._types[name].itemsize)
            for start in range(0, self.count, piece):
                file.write(np.full(min(piece, self.count - start), value).tobytes())


class FilledInBatches:
    """Columns that are filled many rows at a time, in their order: rows that are far apart cost a page each."""

    def __init__(self, columns: RowColumns, batch: int = 1_000_000):
        """Has nothing to fill yet.

        Args:
            columns: that are filled.
            batch: rows that are kept before they are written.
        """
        self._columns, self._batch = columns, batch
        self._parts: list[tuple[Int64[np.ndarray, " n"], Mapping[str, npt.NDArray[np.generic]]]] = []

    def fill(self, rows: Int64[np.ndarray, " n"], values: Mapping[str, npt.NDArray[np.generic]]) -> None:
        """Sets the values of some rows, at the latest when `flush` is called; all calls name the same columns.

        Args:
            rows: their numbers.
            values: of each, for some of the columns.
        """
        self._parts.append((rows, values))
        if sum(len(rows) for rows, _ in self._parts) >= self._batch:
            self.flush()

    def flush(self) -> None:
        """Writes what was kept."""
        if not self._parts:
            return
        rows = np.concatenate([own for own, _ in self._parts])
        order = np.argsort(rows)
        names = self._parts[0][1]
        values = {name: np.concatenate([own[name] for _, own in self._parts])[order] for name in names}
        self._columns.fill(rows[order], values)
        self._parts = []
