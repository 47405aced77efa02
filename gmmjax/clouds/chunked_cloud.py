"""Clouds that are given some points at a time, as often as they are asked for: open files and surveys."""

import dataclasses
from collections.abc import Iterator
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds.cloud_file import CHUNK_POINTS, CloudChunk
from gmmjax.clouds.filters import crop_box


@runtime_checkable
class ChunkedCloud(Protocol):
    """A cloud that is read in chunks, such as a `CloudFile` or `SurveyFiles`."""

    @property
    def count(self) -> int:
        """Number of rows, those without a position among them."""

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[CloudChunk]:
        """All points from the first on, at most `size` at a time; no result depends on the size."""


@dataclasses.dataclass(frozen=True, eq=False)
class CroppedCloud:
    """The part of a cloud in a box along the axes; the rows are those of the whole cloud.

    Attributes:
        cloud: the whole.
        lower: lowest corner of the box.
        upper: its highest one.
    """

    cloud: ChunkedCloud
    lower: Float64[np.ndarray, "3"]
    upper: Float64[np.ndarray, "3"]

    @property
    def count(self) -> int:
        """Number of rows of the whole cloud."""
        return self.cloud.count

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[CloudChunk]:
        """The points in the box, at most `size` at a time; some chunks may have none."""
        for points, rows in self.cloud.chunks(size):
            inside = crop_box(points, self.lower, self.upper)
            yield CloudChunk(points[inside], rows[inside])
