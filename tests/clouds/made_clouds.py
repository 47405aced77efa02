"""Clouds that blocks are made of in the tests."""

import dataclasses

import numpy as np

from gmmjax.clouds import ArrayCloud, Bounds


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
