"""The cells of a plane that points are gathered in."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int


class PlaneGrid(NamedTuple):
    """Cells of a plane, in rows and columns.

    Attributes:
        lower: corner of the first cell.
        edge: of each cell.
        shape: number of rows and of columns.
    """

    lower: Float64[np.ndarray, " 2"]
    edge: float
    shape: tuple[int, int]

    def cells(self, places: Float64[np.ndarray, "n 2"], parts: int = 1) -> Int[np.ndarray, " n"]:
        """The number of the cell of each place, or of the part of a cell; -1 outside."""
        indices = np.floor((places - self.lower) / (self.edge / parts)).astype(int)
        rows, columns = (parts * length for length in self.shape)
        inside = ((indices >= 0) & (indices < [rows, columns])).all(axis=1)
        return np.where(inside, indices[:, 0] * columns + indices[:, 1], -1)

    def counts(self, places: Float64[np.ndarray, "n 2"]) -> Int[np.ndarray, "r c"]:
        """How many places each cell has."""
        cells = self.cells(places)
        return np.bincount(cells[cells >= 0], minlength=self.shape[0] * self.shape[1]).reshape(self.shape)

    def greatest(
        self, places: Float64[np.ndarray, "n 2"], values: Float64[np.ndarray, " n"]
    ) -> Float64[np.ndarray, "r c"]:
        """The greatest value of each cell; NaN where there are none."""
        cells = self.cells(places)
        inside = cells >= 0
        found = np.full(self.shape[0] * self.shape[1], -np.inf)
        np.maximum.at(found, cells[inside], values[inside])
        return np.where(np.isfinite(found), found, np.nan).reshape(self.shape)

    def seen(self, places: Float64[np.ndarray, "n 2"], parts: int) -> Int[np.ndarray, "r c"]:
        """How many of the parts of each cell have places."""
        cells = self.cells(places, parts)
        number = np.bincount(cells[cells >= 0], minlength=self.shape[0] * self.shape[1] * parts**2)
        return (number > 0).reshape(self.shape[0], parts, self.shape[1], parts).sum(axis=(1, 3))

    def means(
        self, places: Float64[np.ndarray, "n 2"], values: Float64[np.ndarray, " n"], parts: int
    ) -> Float64[np.ndarray, "r c"]:
        """The mean over the parts of each cell of their mean values; NaN where there are none."""
        cells = self.cells(places, parts)
        inside, count = cells >= 0, self.shape[0] * self.shape[1] * parts**2
        cells, values = cells[inside], values[inside]
        number = np.bincount(cells, minlength=count)
        sums = np.bincount(cells, values, minlength=count)
        part = np.divide(sums, number, out=np.zeros(count), where=number > 0)
        blocks = (self.shape[0], parts, self.shape[1], parts)
        filled = (number > 0).reshape(blocks).sum(axis=(1, 3))
        total = part.reshape(blocks).sum(axis=(1, 3))
        return np.divide(total, filled, out=np.full(self.shape, np.nan), where=filled > 0)
