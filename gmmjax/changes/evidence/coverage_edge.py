"""Without sensor poses: which segments are walls at the edge of the other survey's coverage.

Occlusion decides. The other survey can only report that a surface came or went if it observed the space behind it. A
wall behind which the other cloud has no point is outside its coverage, not built or torn down. The flat top of a box on
a bare floor has no point above it either, but it occludes the floor: the other cloud has that floor, and this one has
not.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax.clouds import voxel_grid
from gmmjax.geometry import Plane, PlaneSettings, plane_surface, planes_of


@dataclasses.dataclass(frozen=True)
class CoverageEdgeSettings:
    """When a segment is a wall at the edge of the coverage.

    Attributes:
        voxel: edge of the voxels that a segment is thinned to, in spacings, so that the number of a plane's inliers
            measures an area. 0 is not allowed; smaller: dense parts of a segment outweigh large ones.
        planes: how a segment is split into walls.
        max_behind: fraction of the other cloud's points behind a wall, at most: those are outliers. 0: one stray point
            makes a wall a change; 1: walls that were built are taken for unobserved.
        near: distance, in spacings, within which points of the two clouds are at the same place of a surface. Smaller:
            the gaps between points look like holes.
        max_covered: fraction of a plane's points, at most, that may have points of the other cloud at the same place
            of the plane: above it the other cloud has no hole there. 1: thin objects on a surface are taken for that
            surface.
        max_occluded: fraction of what the other cloud has straight in front of a wall, at most, that is missing in
            this cloud because the wall occludes it. 1: the top of a new box is taken for a wall.
    """

    voxel: float = 2.0
    planes: PlaneSettings = PlaneSettings(min_share=0.15)
    max_behind: float = 0.01
    near: float = 2.0
    max_covered: float = 0.75
    max_occluded: float = 0.5


class ReferenceSurfaces(NamedTuple):
    """The surfaces that a segment is compared with.

    Attributes:
        unchanged: tree of the unchanged points of the segment's own cloud.
        other: tree of the other cloud.
        tolerance: largest distance between an unchanged surface in the two clouds.
        spacing: distance of neighbouring points on a surface.
    """

    unchanged: cKDTree
    other: cKDTree
    tolerance: float
    spacing: float

    @classmethod
    def of(
        cls,
        unchanged: Float64[np.ndarray, "n 3"],
        other: Float64[np.ndarray, "k 3"],
        tolerance: float,
        spacing: float,
    ) -> "ReferenceSurfaces":
        """The surfaces of the unchanged points of a cloud and of the other cloud, either of which may be empty."""
        return cls(cKDTree(unchanged), cKDTree(other), tolerance, spacing)


def at_coverage_edge(
    segment: Float64[np.ndarray, "m 3"],
    reference: ReferenceSurfaces,
    flatness: float,
    settings: CoverageEdgeSettings = CoverageEdgeSettings(),
) -> Bool[np.ndarray, " m"]:
    """The points of a segment that lie on a wall at the edge of the other survey's coverage.

    Args:
        segment: the points of one segment.
        reference: what it is compared with.
        flatness: largest distance of a wall's points from its plane.
        settings: when a wall is at the edge.
    """
    at_edge = np.zeros(len(segment), bool)
    thinned = voxel_grid(segment, settings.voxel * reference.spacing).points
    for wall in planes_of(plane_surface(thinned, settings.planes), flatness, settings=settings.planes):
        on_wall = wall.distance(segment) <= flatness
        if on_wall.any() and _outside_coverage(wall, segment[on_wall], reference, flatness, settings):
            at_edge |= on_wall
    return at_edge


def _outside_coverage(
    wall: Plane,
    points: Float64[np.ndarray, "m 3"],
    reference: ReferenceSurfaces,
    flatness: float,
    settings: CoverageEdgeSettings,
) -> bool:
    """Whether the other survey observed neither the points of a wall nor anything behind it."""
    other, near = reference.other.data, settings.near * reference.spacing
    clear = flatness + reference.tolerance
    heights = other @ wall.normal - wall.offset
    heights *= 1 if np.median(heights) >= 0 else -1
    if (heights < -clear).mean() > settings.max_behind:
        return False
    if wall.near(points, other[np.abs(heights) <= clear], near).mean() > settings.max_covered:
        return False
    in_front = other[heights > clear]
    in_front = in_front[wall.near(in_front, points, near)]
    return _missing(in_front, reference.unchanged, near) <= settings.max_occluded


def _missing(others: Float64[np.ndarray, "k 3"], unchanged: cKDTree, near: float) -> float:
    """The fraction of points of the other cloud that have no unchanged point of this cloud nearby."""
    return float(np.isinf(unchanged.query(others, distance_upper_bound=near)[0]).mean()) if len(others) else 0.0
