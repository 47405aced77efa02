"""Detection of planes in scanned surfaces: the local planes are the hypotheses, so that nothing is drawn at random."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax.geometry.local_surface import LocalSurface, evenly_chosen
from gmmjax.geometry.neighbours import within_box


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
        """The points whose projection onto the plane is within the distance of the projection of another point."""
        if not len(others) or not len(points):
            return np.zeros(len(points), bool)
        own, others = self.projections(points), self.projections(others)
        # Most of a large surface is far from a small part of it.
        rows = within_box(own, others.min(axis=0) - distance, others.max(axis=0) + distance)
        near = np.zeros(len(own), bool)
        if len(rows):
            beside = others[within_box(others, own[rows].min(axis=0) - distance, own[rows].max(axis=0) + distance)]
            near[rows] = np.isfinite(cKDTree(beside).query(own[rows], distance_upper_bound=distance)[0])
        return near


@dataclasses.dataclass(frozen=True)
class PlaneSettings:
    """Settings of the plane detection.

    Attributes:
        min_share: fraction of the points that are inliers of a plane, at least. 0: every few points that are flat
            by chance make a plane.
        min_inliers: number of them, at least; what has fewer points has no plane. Fewer than 3 determine no plane.
        max_planes: number of planes, at most: a bound on the time, above the sides that are seen of any segment.
        hypotheses: number of local planes, at most and evenly chosen, that are tried: a bound on the time, which grows
            with their product with the points. Fewer: small planes of large clouds are missed.
        neighbours: nearest neighbours that a local plane is fitted to. Fewer: the noise tilts the local planes, and
            large planes lose inliers; more: those at edges are averages of two sides.
    """

    min_share: float = 0.1
    min_inliers: int = 8
    max_planes: int = 6
    hypotheses: int = 800
    neighbours: int = 12


def plane_surface(points: Float64[np.ndarray, "n 3"], settings: PlaneSettings = PlaneSettings()) -> LocalSurface:
    """The surface of a cloud with the local planes that `planes_of` starts from."""
    return LocalSurface.of(points, settings.neighbours)


def planes_of(
    surface: LocalSurface,
    flatness: float,
    min_width: float = 0.0,
    chosen: Bool[np.ndarray, " n"] | None = None,
    settings: PlaneSettings = PlaneSettings(),
) -> list[Plane]:
    """The planes with the most inliers, one by one: each the best of the local planes, refitted to its inliers.

    Args:
        surface: with evenly spread points, so that the number of inliers measures an area.
        flatness: largest distance of an inlier from its plane.
        min_width: standard deviation of a plane's inliers along their shorter axis, at least; narrower strips are
            left out.
        chosen: the points that planes are searched for in; None: all.
        settings: how planes are detected.
    """
    found: list[Plane] = []
    kept = slice(None) if chosen is None else chosen
    points, normals, centres = surface.points[kept], surface.normals[kept], surface.centres[kept]
    if len(points) < settings.min_inliers:
        return found
    tried = evenly_chosen(len(points), settings.hypotheses)
    normals, centres = normals[tried], centres[tried]
    inliers = np.abs(points @ normals.T - (normals * centres).sum(axis=1)) <= flatness
    counts = np.count_nonzero(inliers, axis=0)
    for _ in range(settings.max_planes):
        best = inliers[:, int(counts.argmax())].copy()
        if best.sum() < max(settings.min_inliers, settings.min_share * len(points)):
            break
        centre = points[best].mean(axis=0)
        variances, axes = np.linalg.eigh(np.cov((points[best] - centre).T, bias=True))
        if variances[1] >= min_width**2:
            found.append(Plane(axes[:, 0], float(axes[:, 0] @ centre)))
        counts -= np.count_nonzero(inliers[best], axis=0)
        inliers[best] = False
    return found
