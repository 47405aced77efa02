"""Clouds that are given some points at a time, as often as they are asked for: open files, or arrays."""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64, Int64


@runtime_checkable
class PointChunk(Protocol):
    """Some points of a cloud, in its order."""

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """Finite coordinates."""

    @property
    def rows(self) -> Int64[np.ndarray, " n"]:
        """Number of each point's row in the cloud, ascending over all chunks."""


@runtime_checkable
class ChunkedCloud(Protocol):
    """A cloud that is read in chunks."""

    @property
    def count(self) -> int:
        """Number of rows, those without a position among them."""

    @property
    def bounds(self) -> Any:
        """Lowest and highest coordinates `(lower, upper)`, each [3], as they are declared; None: not known."""

    def chunks(self, size: int = 1_000_000) -> Iterator[PointChunk]:
        """All points from the first on, at most `size` at a time; no result depends on the size."""


class ArrayChunk(NamedTuple):
    """Some rows of an array.

    Attributes:
        points: coordinates.
        rows: their numbers.
    """

    points: Float64[np.ndarray, "n 3"]
    rows: Int64[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True, eq=False)
class ArrayCloud:
    """A cloud in memory, as `ChunkedCloud`.

    Attributes:
        points: finite coordinates.
    """

    points: Float64[np.ndarray, "n 3"]

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.points)

    @property
    def bounds(self) -> None:
        """Not known before the points are looked at."""
        return None

    def chunks(self, size: int = 1_000_000) -> Iterator[ArrayChunk]:
        """All points, at most `size` at a time."""
        for start in range(0, len(self.points), size):
            part = self.points[start : start + size]
            yield ArrayChunk(part, np.arange(start, start + len(part), dtype=np.int64))
