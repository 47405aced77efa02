"""Clouds in memory that are read as files of any size are."""

import dataclasses

import numpy as np

from gmmjax.clouds import CloudChunk


@dataclasses.dataclass(frozen=True, eq=False)
class ChunkedArray:
    """A `ChunkedCloud` in memory, in chunks of at most a size."""

    points: np.ndarray
    size: int = 1_000_000

    @property
    def count(self):
        return len(self.points)

    def chunks(self, size=1_000_000):
        step = min(size, self.size)
        for start in range(0, len(self.points), step):
            part = self.points[start : start + step]
            yield CloudChunk(part, np.arange(start, start + len(part), dtype=np.int64))


def slope(count, seed, *, lower=(0.0, 0.0, 0.0), change=0.0):
    """Points on a slope of 10 by 10, ever fewer with the distance from its corner."""
    random = np.random.default_rng(seed)
    x, y = 10 * random.uniform(size=(2, count)) ** 2
    z = 0.2 * x + 0.3 * np.sin(y) + change * ((x - 5) ** 2 + (y - 5) ** 2 < 4) + random.normal(0, 0.003, count)
    return np.stack([x, y, z], axis=1) + lower
