"""Nearest neighbours in a cloud."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from gmmjax._cores import available_cores

# Threads cost more than they save on fewer points.
POINTS_FOR_THREADS = 10_000


def nearest_neighbours(
    tree: cKDTree, points: Float[np.ndarray, "n d"], count: int
) -> tuple[Float[np.ndarray, "n k"], Int[np.ndarray, "n k"]]:
    """Distances and indices of the nearest points of a tree, the nearest first; k is the count, or all there are."""
    ranks = np.arange(1, min(count, tree.n) + 1)
    distances, indices = tree.query(points, k=ranks, workers=workers_for(len(points)))
    return distances, indices


def within_box(
    points: Float[np.ndarray, "n d"], lower: Float[np.ndarray, " d"], upper: Float[np.ndarray, " d"]
) -> Int[np.ndarray, " m"]:
    """The indices of the points in a box along the axes, in their order."""
    rows = np.arange(len(points))
    # One coordinate after the other, of what is left: few points are in a small box.
    for axis, (least, most) in enumerate(zip(lower, upper, strict=True)):
        values = points[rows, axis] if axis else points[:, 0]
        rows = rows[(values >= least) & (values <= most)]
    return rows


def workers_for(count: int) -> int:
    """The number of threads to look up so many points with, as SciPy's trees take it: one for each core, or one."""
    return available_cores() if count >= POINTS_FOR_THREADS else 1


def within_reach(tree: cKDTree, points: Float[np.ndarray, "n d"], reach: float) -> Bool[np.ndarray, " n"]:
    """Mask of the points within a distance of the points of a tree.

    Args:
        tree: of other points.
        points: coordinates.
        reach: the distance.
    """
    distances, _ = tree.query(points, distance_upper_bound=reach, workers=workers_for(len(points)))
    return np.asarray(np.isfinite(distances))


def points_within(tree: cKDTree, points: Float[np.ndarray, "n d"], reach: float) -> Float[np.ndarray, "m d"]:
    """Those of the points that are within a distance of the points of a tree.

    Args:
        tree: of other points.
        points: coordinates.
        reach: the distance.
    """
    near = points[within_box(points, tree.mins - reach, tree.maxes + reach)]
    if not len(near):
        return near
    return near[np.isfinite(tree.query(near, distance_upper_bound=reach)[0])]
