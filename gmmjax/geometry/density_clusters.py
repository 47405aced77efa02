"""Density clusters of points: DBSCAN on k-d trees, in memory that does not grow with the points within a radius."""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gmmjax.geometry.cells import occupied_cells
from gmmjax.geometry.neighbours import workers_for


def density_clusters(
    points: Float[np.ndarray, "n d"],
    radius: float | Float[np.ndarray, " n"],
    neighbours: int,
    *,
    chunk: int = 500_000,
) -> Int[np.ndarray, " n"]:
    """The clusters of DBSCAN (Ester et al. 1996).

    A point with at least `neighbours` points within the radius, itself counted, is a core point; core points within
    the radius of each other are one cluster; other points join that of the nearest core point within the radius.

    The radius may differ from point to point, where the density of the points does. Points of one radius are connected
    as ever; those of two radii are where one is the nearest of its radius to the other, within the mean of both.

    Args:
        points: coordinates.
        radius: in the unit of the points, positive; for each point one of a few values, or the same for all.
        neighbours: points that make a core point.
        chunk: points that are looked up in neighbouring cells at a time: bounds the memory, about 100 bytes each, and
            does not change the clusters.

    Returns:
        For each point the number of its cluster, counted in the order of the points, or -1.
    """
    labels = np.full(len(points), -1)
    if len(points) < neighbours:
        return labels
    radii = np.broadcast_to(np.asarray(radius, float), len(points))
    # The distance to the last of the neighbours, not their number: a radius may hold all points of the cloud.
    distances, _ = cKDTree(points).query(points, k=[neighbours], workers=workers_for(len(points)))
    core = np.flatnonzero(distances[:, 0] <= radii)
    if not len(core):
        return labels
    labels[core] = _connected_by_radius(points[core], radii[core], chunk)
    others = np.flatnonzero(labels < 0)
    workers = workers_for(len(others))
    reach = np.nextafter(radii.max(), np.inf)
    distances, nearest = cKDTree(points[core]).query(points[others], distance_upper_bound=reach, workers=workers)
    near = distances <= radii[others]
    labels[others[near]] = labels[core[nearest[near]]]
    return labels


def _connected_by_radius(
    points: Float[np.ndarray, "n d"], radii: Float[np.ndarray, " n"], chunk: int
) -> Int[np.ndarray, " n"]:
    """The groups of points that are connected, each within its radius, numbered in the order of the points."""
    values, of_value = np.unique(radii, return_inverse=True)
    if len(values) == 1:
        return _connected(points, float(values[0]), chunk)
    members = [np.flatnonzero(of_value == number) for number in range(len(values))]
    groups = np.empty(len(points), int)
    count = 0
    for rows, value in zip(members, values, strict=True):
        groups[rows] = count + _connected(points[rows], float(value), chunk)
        count = int(groups[rows].max()) + 1
    trees = [cKDTree(points[rows]) for rows in members]
    links = [
        groups[np.stack([members[first][own], members[second][nearest]])]
        for first, second in itertools.permutations(range(len(values)), 2)
        for own, nearest in [_nearest_within(trees[first], trees[second], float(values[[first, second]].mean()))]
    ]
    ends = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(ends.shape[1], bool), (ends[0], ends[1])), shape=(count, count))
    return _numbered_in_order(connected_components(graph, directed=False)[1][groups])


def _nearest_within(own: cKDTree, other: cKDTree, reach: float) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """The points of a tree that have a point of another one within reach, and the nearest one of these."""
    distances, nearest = other.query(own.data, distance_upper_bound=reach, workers=workers_for(own.n))
    near = np.flatnonzero(np.isfinite(distances))
    return near, nearest[near]


def _numbered_in_order(groups: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The groups numbered in the order of their first points."""
    _, first, members = np.unique(groups, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[members])


def _connected(points: Float[np.ndarray, "n d"], radius: float, chunk: int) -> Int[np.ndarray, " n"]:
    """The groups of points that are within the radius of each other, numbered in the order of the points.

    The points are gathered in cells whose diagonal is the radius (Gunawan 2013): those of one cell are one group, and
    of two cells near each other it only matters whether their nearest two points are within the radius.
    """
    dimension = points.shape[1]
    # A little less than the diagonal, so that rounding puts no two points further apart than the radius in one cell.
    side = radius / np.sqrt(dimension) * (1 - 1e-9)
    cells, cell = occupied_cells(points - np.median(points, axis=0), side)
    pairs, apart = _neighbouring(cells)
    links = _Links(points, cell, len(cells), radius, chunk)
    # The nearest cells first, and by one point of each: most of the others are in one group by then.
    for distance in np.unique(apart):
        links.join(pairs[apart == distance], max_points=1)
    for distance in np.unique(apart):
        links.join(pairs[apart == distance], max_points=len(points))
    return _numbered_in_order(links.groups[cell])


def _neighbouring(cells: Float[np.ndarray, "c d"]) -> tuple[Int[np.ndarray, "p 2"], Float[np.ndarray, " p"]]:
    """The pairs of cells that may hold points within the radius, and the squared distance of each pair's indices."""
    reach = np.ceil(np.sqrt(cells.shape[1]))
    pairs = cKDTree(cells).query_pairs(reach + 0.5, p=np.inf, output_type="ndarray")
    steps = np.abs(cells[pairs[:, 0]] - cells[pairs[:, 1]])
    gap = (np.maximum(steps - 1, 0) ** 2).sum(axis=1)
    near = gap <= cells.shape[1]
    return pairs[near], (steps[near] ** 2).sum(axis=1)


class _Links:
    """Disjoint sets of cells.

    Attributes:
        groups: of each cell the number of its group.
    """

    def __init__(
        self, points: Float[np.ndarray, "n d"], cell: Int[np.ndarray, " n"], cells: int, radius: float, chunk: int
    ) -> None:
        self.groups = np.arange(cells)
        self._points, self._radius, self._chunk = points, radius, chunk
        self._members = np.argsort(cell, kind="stable")
        self._counts = np.bincount(cell, minlength=cells)
        self._starts = np.cumsum(self._counts) - self._counts
        # One tree for all cells: twice the radius sets each apart from the others on an axis of their own.
        self._apart = 2 * radius * np.arange(cells)
        self._tree = cKDTree(np.column_stack([points, self._apart[cell]]))

    def join(self, pairs: Int[np.ndarray, "p 2"], max_points: int) -> None:
        """Makes one group of the cells of a pair when one has a point within the radius of the other one's.

        Args:
            pairs: of cells.
            max_points: of the smaller cell that are looked up in the larger one.
        """
        while True:
            pairs = pairs[self.groups[pairs[:, 0]] != self.groups[pairs[:, 1]]]
            if not len(pairs):
                return
            smaller = self._counts[pairs[:, 0]] <= self._counts[pairs[:, 1]]
            pairs = np.where(smaller[:, None], pairs, pairs[:, ::-1])
            tried = np.minimum(self._counts[pairs[:, 0]], max_points)
            taken = max(1, int(np.searchsorted(np.cumsum(tried), self._chunk, side="right")))
            near = self._near(pairs[:taken], tried[:taken])
            self._merge(pairs[:taken][near])
            pairs = pairs[taken:]

    def _near(self, pairs: Int[np.ndarray, "p 2"], counts: Int[np.ndarray, " p"]) -> Bool[np.ndarray, " p"]:
        """True where one of the first `counts` points of the first cell is within the radius of one of the second."""
        pair = np.repeat(np.arange(len(pairs)), counts)
        nth = np.arange(len(pair)) - np.repeat(np.cumsum(counts) - counts, counts)
        own = self._points[self._members[self._starts[pairs[pair, 0]] + nth]]
        places = np.column_stack([own, self._apart[pairs[pair, 1]]])
        bound = np.nextafter(self._radius, np.inf)
        distances, _ = self._tree.query(places, distance_upper_bound=bound, workers=workers_for(len(places)))
        return np.asarray(np.bincount(pair, np.isfinite(distances), len(pairs)) > 0)

    def _merge(self, pairs: Int[np.ndarray, "p 2"]) -> None:
        count = len(self.groups)
        ends = self.groups[pairs[:, 0]], self.groups[pairs[:, 1]]
        graph = coo_array((np.ones(len(pairs), bool), ends), shape=(count, count))
        self.groups = connected_components(graph, directed=False)[1][self.groups]
