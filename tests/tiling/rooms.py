"""A scanned room, without and with a box on its floor."""

import numpy as np

BOX = np.array([2.0, 3.0, 0.0]), np.array([0.8, 0.6, 0.5])
"""Lowest corner, and edges."""


def surface(random, count, corner, first, second):
    """Points of a rectangle, with the noise of a scanner."""
    u, v = random.uniform(size=(2, count, 1))
    return corner + u * np.asarray(first) + v * np.asarray(second) + random.normal(0, 0.001, (count, 3))


def room(seed, *, box):
    """A floor of 6 by 5 m, two walls, and a box on the floor; the floor is denser in one half."""
    random = np.random.default_rng(seed)
    parts = [
        surface(random, 18_750, (0, 0, 0), (6, 0, 0), (0, 5, 0)),
        surface(random, 18_750, (0, 0, 0), (3, 0, 0), (0, 5, 0)),
        surface(random, 11_250, (0, 0, 0), (6, 0, 0), (0, 0, 2)),
        surface(random, 10_000, (0, 0, 0), (0, 5, 0), (0, 0, 2)),
    ]
    lower, size = BOX
    if box:
        floor = np.concatenate(parts[:2])
        below = ((floor[:, :2] > lower[:2]) & (floor[:, :2] < (lower + size)[:2])).all(axis=1)
        parts[:2] = [floor[~below]]
        x, y, z = np.diag(size)
        parts += [
            surface(random, 1_200, lower + z, x, y),
            surface(random, 1_000, lower, x, z),
            surface(random, 1_000, lower + y, x, z),
            surface(random, 800, lower, y, z),
            surface(random, 800, lower + x, y, z),
        ]
    return np.concatenate(parts)


def of_box(points):
    """Which points are of the box, but for those next to the floor."""
    lower, size = BOX
    return ((points > lower - [0.01, 0.01, -0.03]) & (points < lower + size + 0.01)).all(axis=1)
