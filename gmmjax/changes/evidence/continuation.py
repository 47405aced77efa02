"""Without sensor poses: which segments only continue the unchanged surfaces beside them.

A wall that one survey saw further, or the floor that came out of an object's shadow, differs between the clouds, but
nothing changed there: it lies on a plane of the unchanged surface next to it, and the other cloud has a hole there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes.evidence.coverage_edge import MOST_COVERED, NEAR, at_observed_edge
from gmmjax.clouds import voxel_grid
from gmmjax.geometry.neighbours import nearest_neighbours
from gmmjax.geometry.planes import Plane, PlaneSettings, plane_surface, planes_of

# Unchanged points this near to a segment (in spacings) are beside it; where they have no plane that it continues, the
# next distance is tried: a wall goes on behind what hides it.
REACHES = (10.0, 60.0)
# Where so much of a segment continues what is beside it, nothing further away is looked at.
CLEAR_SHARE = 0.8
# The points beside a segment are thinned to voxels of this part of the reach, so that planes weigh areas, not points.
VOXELS_PER_REACH = 6.0
# A plane holds at least this share of those voxels and is this wide (standard deviation, in voxels) across its narrow
# side: the lowest strip of an object's side, too near the floor to be told from it, is no plane.
LEAST_SHARE = 0.08
LEAST_WIDTH = 0.9
# A plane that is further away is as wide as this many segments: the top of some other box is none.
FAR_WIDTH = 2.0
# A point is on a plane within so many standard deviations of the noise, and at least half a spacing.
NOISE_DEVIATIONS = 3.0
LEAST_SPACINGS = 0.5


def unobserved_points(
    points: Float64[np.ndarray, "n 3"],
    labels: Int[np.ndarray, " n"],
    unchanged: Bool[np.ndarray, " n"],
    other: Float64[np.ndarray, "k 3"],
    tolerance: float,
    spacing: float,
    *,
    edges: bool = True,
) -> Bool[np.ndarray, " n"]:
    """The points of segments that the other survey cannot have observed, as far as that shows without its views.

    That is what continues the unchanged surfaces beside the segment, where the other cloud has a hole, and walls at
    the edge of what the other cloud has (`at_observed_edge`). A point continues a plane of the unchanged points when
    it is on the plane within the noise. Where the other cloud has points of the plane at the same places, these were
    observed, and what lies on it is a thin object. A plane must be in both clouds, so that the sides of an object,
    whose lowest part passes for unchanged, are none.

    Args:
        points: one cloud.
        labels: -1, or the number of the segment that a point belongs to.
        unchanged: the points that are known to be unchanged.
        other: the other cloud.
        tolerance: how far apart, at the most, an unchanged surface may be in the two clouds.
        spacing: distance of neighbouring points on a surface.
        edges: whether walls at the edge of what the other cloud has count.

    Returns:
        For each point whether it is of a segment and was not observed.
    """
    unseen = np.zeros(len(points), bool)
    if not (labels >= 0).any() or not unchanged.any() or not len(other):
        return unseen
    around = Surroundings(cKDTree(points[unchanged]), cKDTree(other), tolerance, spacing)
    for label in np.unique(labels[labels >= 0]):
        unseen[labels == label] = _unseen(points[labels == label], around, edges)
    return unseen


class Surroundings(NamedTuple):
    """What a segment is held against.

    Attributes:
        unchanged: tree of the unchanged points of the same cloud.
        other: tree of the other cloud.
        tolerance: how far apart, at the most, an unchanged surface may be in the two clouds.
        spacing: distance of neighbouring points on a surface.
    """

    unchanged: cKDTree
    other: cKDTree
    tolerance: float
    spacing: float

    def flatness(self, points: Float64[np.ndarray, "n 3"]) -> float:
        """How far from a plane points may be that are as noisy as these."""
        noise = plane_surface(points).thickness
        return min(self.tolerance, max(NOISE_DEVIATIONS * noise, LEAST_SPACINGS * self.spacing))


def _unseen(segment: Float64[np.ndarray, "m 3"], around: Surroundings, edges: bool) -> Bool[np.ndarray, " m"]:
    """The points of one segment that the other survey cannot have observed."""
    of_segment = cKDTree(segment)
    beside = _within(of_segment, around.unchanged.data, REACHES[0] * around.spacing)
    # The segment may have curved sides; the noise is that of what is beside it, where there is something.
    flatness = around.flatness(beside if len(beside) else segment)
    unseen = _continued(segment, beside, REACHES[0], 0.0, flatness, around)
    if unseen.mean() <= CLEAR_SHARE:
        far = _within(of_segment, around.unchanged.data, REACHES[1] * around.spacing)
        width = np.sqrt(max(np.linalg.eigvalsh(np.cov(segment.T, bias=True))[1], 0.0))
        unseen |= _continued(segment, far, REACHES[1], FAR_WIDTH * width, flatness, around)
    if edges and unseen.mean() <= CLEAR_SHARE:
        wall = max(flatness, around.spacing)
        unseen |= at_observed_edge(segment, around.unchanged, around.other, wall, around.tolerance, around.spacing)
    return unseen


def _continued(
    segment: Float64[np.ndarray, "m 3"],
    unchanged: Float64[np.ndarray, "n 3"],
    reach: float,
    least_width: float,
    flatness: float,
    around: Surroundings,
) -> Bool[np.ndarray, " m"]:
    """The points of a segment that continue planes of the unchanged points within reach (in spacings)."""
    continued = np.zeros(len(segment), bool)
    voxel = reach * around.spacing / VOXELS_PER_REACH
    planes = _common_planes(
        voxel_grid(unchanged, voxel).points, flatness, max(LEAST_WIDTH * voxel, least_width), around
    )
    for plane in planes:
        on_plane = plane.distance(segment) <= flatness
        surface = around.other.data[plane.distance(around.other.data) <= flatness + around.tolerance]
        if not on_plane.any() or plane.near(segment[on_plane], surface, NEAR * around.spacing).mean() <= MOST_COVERED:
            continued |= on_plane
    return continued


def _within(of_segment: cKDTree, points: Float64[np.ndarray, "n 3"], reach: float) -> Float64[np.ndarray, "b 3"]:
    """The points that are within reach of a segment."""
    near = points[((points >= of_segment.mins - reach) & (points <= of_segment.maxes + reach)).all(axis=1)]
    if not len(near):
        return near
    return near[np.isfinite(of_segment.query(near, distance_upper_bound=reach)[0])]


def _common_planes(
    points: Float64[np.ndarray, "n 3"], flatness: float, least_width: float, around: Surroundings
) -> list[Plane]:
    """The planes that hold most of those points that the other cloud has too, at the same place of their surface."""
    if not len(points):
        return []
    surface = plane_surface(points)
    distances, neighbours = nearest_neighbours(around.other, points, PlaneSettings().neighbours)
    heights = np.abs(np.einsum("nki,ni->nk", around.other.data[neighbours] - points[:, None], surface.normals))
    along = distances**2 - heights**2
    both = ((heights <= around.tolerance) & (along <= (NEAR * around.spacing) ** 2)).any(axis=1)
    return planes_of(surface, flatness, least_width, LEAST_SHARE, both)
