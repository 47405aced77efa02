"""Values for each row of a cloud, on disk: filled block by block, read in the order of the rows."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from jaxtyping import Int64

from gmmjax.changes import PointFigures
from gmmjax.tiling.disk import disk_errors, reserve

MISSING: Mapping[str, np.generic] = {
    "label": np.int32(-1),
    "kind": np.uint8(0),
    "probability": np.float32(0),
    "unobserved": np.bool_(False),
    **{name: np.float32(np.nan) for name in PointFigures._fields},
}
"""The columns, with the values of rows that were not compared: without a position, outside the crop box, or stray."""

# Rows that are kept before they are written, in their order: rows that are far apart cost a page each.
BATCH = 1_000_000


class RowColumns:
    """The columns of `MISSING` for each row of a cloud, each a file of its own; memory does not grow with the rows."""

    def __init__(self, folder: Path, count: int):
        """Make the columns, with no row compared.

        Args:
            folder: for their files; it is made.
            count: of the rows.

        Raises:
            InputError: the disk is full.
        """
        self.count = count
        self._folder = folder
        self._kept: list[tuple[Int64[np.ndarray, " n"], Mapping[str, npt.NDArray[np.generic]]]] = []
        with disk_errors(folder, count * sum(own.itemsize for own in MISSING.values())):
            folder.mkdir()
            for name, value in MISSING.items():
                self._make(name, value)

    def fill(self, rows: Int64[np.ndarray, " n"], values: Mapping[str, npt.NDArray[np.generic]]) -> None:
        """Set the values of some rows, at the latest when `flush` is called.

        Args:
            rows: their numbers.
            values: of each, for some of the columns, the same at every call.
        """
        self._kept.append((rows, values))
        if sum(len(rows) for rows, _ in self._kept) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what was kept."""
        rows = np.concatenate([np.empty(0, np.int64), *(own for own, _ in self._kept)])
        if len(rows):
            order = np.argsort(rows)
            for name in self._kept[0][1]:
                # Mapped while it is written only: mapped pages count as memory of the process.
                self._mapped(name, "r+")[rows[order]] = np.concatenate([own[name] for _, own in self._kept])[order]
        self._kept = []

    def column(self, name: str) -> npt.NDArray[np.generic]:
        """The values of all rows, which are read from the disk as they are looked at.

        Args:
            name: of the column.
        """
        return self._mapped(name, "r") if self.count else np.empty(0, MISSING[name].dtype)

    def fields(self) -> dict[str, npt.NDArray[np.generic]]:
        """All columns by name, as files of points have them, which know no truth values."""
        values = {name: self.column(name) for name in MISSING}
        return values | {"unobserved": values["unobserved"].view(np.uint8)}

    def _mapped(self, name: str, mode: str) -> np.memmap:
        return np.memmap(self._folder / name, MISSING[name].dtype, mode, shape=(self.count,))  # type: ignore[call-overload]

    def _make(self, name: str, value: np.generic) -> None:
        # Written, not left empty: a mapped file without room on the disk ends the process.
        with (self._folder / name).open("xb") as file:
            reserve(file.fileno(), self.count * value.itemsize)
            for start in range(0, self.count, BATCH):
                file.write(np.full(min(BATCH, self.count - start), value).tobytes())
