"""Density clusters of points: DBSCAN on a k-d tree."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

# Core points whose neighbours are listed at a time: what bounds the memory where a radius holds very many points.
CHUNK = 20_000


def density_clusters(points: Float[np.ndarray, "n d"], radius: float, neighbours: int) -> Int[np.ndarray, " n"]:
    """The clusters of DBSCAN (Ester et al. 1996).

    A point with at least `neighbours` points within the radius, itself counted, is a core point; core points within
    the radius of each other are one cluster; other points join that of the nearest core point within the radius.

    Args:
        points: coordinates.
        radius: in the unit of the points.
        neighbours: points that make a core point.

    Returns:
        For each point the number of its cluster, counted in the order of the points, or -1.
    """
    labels = np.full(len(points), -1)
    if not len(points):
        return labels
    tree = cKDTree(points)
    core = np.flatnonzero(tree.query_ball_point(points, radius, return_length=True, workers=-1) >= neighbours)
    if not len(core):
        return labels
    core_tree = cKDTree(points[core])
    labels[core] = _connected(core_tree, radius)
    others = np.flatnonzero(labels < 0)
    distances, nearest = core_tree.query(points[others], distance_upper_bound=radius, workers=-1)
    near = np.isfinite(distances)
    labels[others[near]] = labels[core[nearest[near]]]
    return labels


def _connected(tree: cKDTree, radius: float) -> Int[np.ndarray, " n"]:
    """The groups of the tree's points that are within the radius of each other, chunk after chunk."""
    groups = np.arange(tree.n)
    for start in range(0, tree.n, CHUNK):
        chunk = cKDTree(tree.data[start : start + CHUNK])
        pairs = chunk.sparse_distance_matrix(tree, radius, output_type="ndarray")
        ends = groups[start + pairs["i"]], groups[pairs["j"]]
        graph = coo_array((np.ones(len(pairs), bool), ends), shape=(tree.n, tree.n))
        groups = connected_components(graph, directed=False)[1][groups]
    _, first, members = np.unique(groups, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[members]
