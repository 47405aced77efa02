"""Planes through points of scanned surfaces, without random numbers."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax.geometry.local_surface import LocalSurface


class Plane(NamedTuple):
    """A plane n . x = d."""

    normal: Float64[np.ndarray, " 3"]
    offset: float

    def distance(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Distance of each point to the plane."""
        return np.abs(points @ self.normal - self.offset)

    def projections(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """The projections of the points onto the parallel plane through the origin."""
        return points - np.outer(points @ self.normal, self.normal)

    def near(
        self, points: Float64[np.ndarray, "n 3"], others: Float64[np.ndarray, "k 3"], distance: float
    ) -> Bool[np.ndarray, " n"]:
        """The points whose projection has that of one of the others within the distance."""
        if not len(others) or not len(points):
            return np.zeros(len(points), bool)
        tree = cKDTree(self.projections(others))
        return np.isfinite(tree.query(self.projections(points), distance_upper_bound=distance)[0])


@dataclasses.dataclass(frozen=True)
class PlaneSettings:
    """How planes are searched for.

    Attributes:
        neighbours: that the local planes go through.
        planes: at most.
        points: that a plane has, at least.
    """

    neighbours: int = 12
    planes: int = 6
    points: int = 8


def plane_surface(points: Float64[np.ndarray, "n 3"], settings: PlaneSettings = PlaneSettings()) -> LocalSurface:
    """The surface of a cloud with the local planes that `planes_of` starts from."""
    return LocalSurface.of(points, settings.neighbours)


def planes_of(
    surface: LocalSurface,
    flatness: float,
    least_width: float,
    least_share: float,
    chosen: Bool[np.ndarray, " n"] | None = None,
    settings: PlaneSettings = PlaneSettings(),
) -> list[Plane]:
    """The planes that hold most of the points, one by one: each the best of the local planes, fitted again.

    Args:
        surface: with evenly spread points, so that planes weigh areas.
        flatness: largest distance of a plane's points from it.
        least_width: standard deviation of a plane's points across its narrow side, at least.
        least_share: how much of the points a plane holds, at least.
        chosen: which of the points planes are searched for in; None: all.
        settings: how they are searched for.
    """
    found: list[Plane] = []
    kept = slice(None) if chosen is None else chosen
    points, normals, centres = surface.points[kept], surface.normals[kept], surface.centres[kept]
    if len(points) < settings.points:
        return found
    held = np.abs(points @ normals.T - (normals * centres).sum(axis=1)) <= flatness
    for _ in range(settings.planes):
        best = held[:, int(held.sum(axis=0).argmax())].copy()
        if best.sum() < max(settings.points, least_share * len(points)):
            break
        centre = points[best].mean(axis=0)
        variances, axes = np.linalg.eigh(np.cov((points[best] - centre).T, bias=True))
        if variances[1] >= least_width**2:
            found.append(Plane(axes[:, 0], float(axes[:, 0] @ centre)))
        held[best] = False
    return found
