"""Clouds that blocks are made of in the tests."""

import dataclasses

import numpy as np

from gmmjax.clouds import AbstractBlockStore, Bounds, CloudChunk, StoredPoints
from gmmjax.pair import each


@dataclasses.dataclass(frozen=True, eq=False)
class ArrayCloud:
    """A cloud in memory, as `ChunkedCloud`."""

    points: np.ndarray

    @property
    def count(self):
        return len(self.points)

    @property
    def bounds(self):
        return None

    def chunks(self, size=1_000_000):
        for start in range(0, len(self.points), size):
            part = self.points[start : start + size]
            yield CloudChunk(part, np.arange(start, start + len(part), dtype=np.int64))


class MemoryBlockStore(AbstractBlockStore):
    """The points of two clouds in memory, sorted into blocks."""

    def __init__(self, clouds, tree):
        self._tree, self._row_counts = tree, clouds.row_counts
        read = clouds.chunks(tree.lattice).map(lambda own: zip(*own, strict=True))
        together = read.map(lambda own: StoredPoints(*map(np.concatenate, own)))
        self._points = together.map(lambda own: own.part(np.argsort(tree.blocks_of(own.points), kind="stable")))

    @property
    def tree(self):
        return self._tree

    @property
    def row_counts(self):
        return self._row_counts

    def inside(self, number):
        ends = self._tree.counts.map(lambda own: np.cumsum(np.append(0, own))[number : number + 2])
        return each(lambda points, place: points.part(slice(*place)), self._points, ends)


@dataclasses.dataclass(frozen=True, eq=False)
class ChunkedArray(ArrayCloud):
    """A cloud in memory that gives its points in chunks of another size, and declares bounds."""

    size: int = 7
    declared: Bounds | None = None

    @property
    def bounds(self):
        return self.declared

    def chunks(self, size=1_000_000):
        return super().chunks(min(size, self.size))


def slope(count, seed, *, lower=(0.0, 0.0, 0.0), change=0.0):
    """Points on a slope of 10 by 10, ever fewer with the distance from its corner."""
    random = np.random.default_rng(seed)
    x, y = 10 * random.uniform(size=(2, count)) ** 2
    z = 0.2 * x + 0.3 * np.sin(y) + change * ((x - 5) ** 2 + (y - 5) ** 2 < 4) + random.normal(0, 0.003, count)
    return np.stack([x, y, z], axis=1) + lower
