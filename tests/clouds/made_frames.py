"""A wall and a box before it, as a depth camera measures them."""

import numpy as np

COLUMNS, ROWS, FOCAL_LENGTH = 160, 120, 140.0
# The half width of the box, by its distance.
HALF_WIDTH = 0.15


def frame(seed=0, missing=0.3, noise=0.004, nearer=0.6):
    """The points of a frame in the camera's coordinates; some pixels have no return.

    Args:
        seed: of the noise.
        missing: share of the pixels without a return.
        noise: standard deviation of a depth of 1 m; it grows with the square of the depth.
        nearer: by how much the box is nearer than the wall.
    """
    random = np.random.default_rng(seed)
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    tangents = np.stack([column - 80.3, row - 59.1], axis=-1).reshape(-1, 2) / FOCAL_LENGTH
    depths = 3.0 + 0.2 * tangents[:, 0] - nearer * (np.abs(tangents) < HALF_WIDTH).all(axis=1)
    depths = depths + noise * depths**2 * random.normal(size=len(depths))
    points = np.c_[tangents * depths[:, None], depths]
    return points[random.uniform(size=len(points)) >= missing]


def on_box(points, margin=0.05):
    """Which points are where the box is, away from its edges."""
    return (np.abs(points[:, :2]) < (HALF_WIDTH - margin) * np.abs(points[:, 2:])).all(axis=1)
