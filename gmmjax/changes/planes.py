"""Planes through points of scanned surfaces, without random numbers."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax.clouds.local_surface import local_planes
from gmmjax.clouds.neighbours import nearest_neighbours

NEIGHBOURS = 12
MOST_PLANES = 6
LEAST_POINTS = 8


class Plane(NamedTuple):
    """A plane n . x = d."""

    normal: Float64[np.ndarray, " 3"]
    offset: float

    def distance(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Distance of each point to the plane."""
        return np.abs(points @ self.normal - self.offset)

    def feet(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """The points moved along the normal onto the parallel plane through the origin."""
        return points - np.outer(points @ self.normal, self.normal)

    def near(
        self, points: Float64[np.ndarray, "n 3"], others: Float64[np.ndarray, "k 3"], distance: float
    ) -> Bool[np.ndarray, " n"]:
        """The points that have one of the others so near, along the plane; how far they are across does not count."""
        if not len(others) or not len(points):
            return np.zeros(len(points), bool)
        tree = cKDTree(self.feet(others))
        return np.isfinite(tree.query(self.feet(points), distance_upper_bound=distance)[0])


class LocalPlanes(NamedTuple):
    """For each of n points the plane through it and its nearest neighbours.

    Attributes:
        normals: unit vectors.
        offsets: n . x of the neighbourhood's mean.
        noise: standard deviation of the neighbourhood from its plane, the median over the points.
    """

    normals: Float64[np.ndarray, "n 3"]
    offsets: Float64[np.ndarray, " n"]
    noise: float

    @classmethod
    def of(cls, points: Float64[np.ndarray, "n 3"]) -> "LocalPlanes":
        """The planes of least squares through twelve neighbours each."""
        neighbours = nearest_neighbours(cKDTree(points), points, NEIGHBOURS)[1]
        centres, normals, variances = local_planes(points[neighbours])
        return cls(normals, (normals * centres).sum(axis=1), float(np.sqrt(np.median(variances[:, 0]))))


def planes_of(
    points: Float64[np.ndarray, "n 3"],
    flatness: float,
    least_width: float,
    least_share: float,
    local: LocalPlanes | None = None,
) -> list[Plane]:
    """The planes that hold most of the points, one by one: each the best of the local planes, fitted again.

    Args:
        points: evenly spread, so that planes weigh areas.
        flatness: how far from a plane its points are, at the most.
        least_width: standard deviation of a plane's points across its narrow side, at least.
        least_share: how much of the points a plane holds, at least.
        local: the points' local planes, where they are known.
    """
    found: list[Plane] = []
    if len(points) < LEAST_POINTS:
        return found
    local = local or LocalPlanes.of(points)
    held = np.abs(points @ local.normals.T - local.offsets) <= flatness
    for _ in range(MOST_PLANES):
        best = held[:, int(held.sum(axis=0).argmax())].copy()
        if best.sum() < max(LEAST_POINTS, least_share * len(points)):
            break
        centre = points[best].mean(axis=0)
        variances, axes = np.linalg.eigh(np.cov((points[best] - centre).T, bias=True))
        if variances[1] >= least_width**2:
            found.append(Plane(axes[:, 0], float(axes[:, 0] @ centre)))
        held[best] = False
    return found
