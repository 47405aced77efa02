"""Nearest neighbours in a cloud."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

# Threads cost more than they save on fewer points.
POINTS_FOR_THREADS = 10_000


def nearest_neighbours(
    tree: cKDTree, points: Float[np.ndarray, "n 3"], count: int
) -> tuple[Float[np.ndarray, "n k"], Int[np.ndarray, "n k"]]:
    """Distances and indices of the nearest points of a tree, the nearest first; k is the count, or all there are."""
    workers = -1 if len(points) >= POINTS_FOR_THREADS else 1
    distances, indices = tree.query(points, k=np.arange(1, min(count, tree.n) + 1), workers=workers)
    return distances, indices
