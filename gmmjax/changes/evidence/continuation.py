"""Without sensor poses: which segments only continue the unchanged surfaces adjacent to them.

A wall that one survey observed further along, or the floor that an object had occluded, differs between the clouds, but
nothing changed there: it lies on a plane of the adjacent unchanged surface, where the other cloud has a hole.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax.changes.evidence.coverage_edge import CoverageEdgeSettings, ReferenceSurfaces, at_coverage_edge
from gmmjax.clouds import voxel_grid
from gmmjax.geometry import (
    Plane,
    PlaneSettings,
    nearest_neighbours,
    plane_surface,
    planes_of,
    points_within,
    within_box,
)


@dataclasses.dataclass(frozen=True)
class ContinuationSettings:
    """When a point continues an unchanged surface. Lengths in spacings are in multiples of the points' spacing.

    Attributes:
        reach: distance, in spacings, within which unchanged points are adjacent to a segment. Smaller: too few of them
            to fit planes to.
        far_reach: the same for a second search, where the adjacent points have no plane that most of the segment
            continues: a wall goes on behind what occludes it. The same as `reach`: such walls are reported as changes.
        continued: fraction of a segment above which it is clear that it continues the surfaces, and no more is
            searched. 1: all searches are always made, and more of an object passes for a far wall.
        voxels_per_reach: the unchanged points are thinned to voxels of this part of the reach, so that the number of a
            plane's inliers measures an area, not a density. More: small surfaces make planes.
        planes: how planes are searched for in those voxels.
        min_width: standard deviation of a plane's inliers along their shorter axis, at least, in voxels. 0: the
            lowest strip of an object's side, too near the floor to be distinguished from it, is a plane that the object
            continues.
        far_width: the same for planes of the second search, in widths of the segment. 0: the top of some other box is a
            plane that an object may continue.
        noise_deviations: largest distance of a point from its plane, in standard deviations of the noise. Smaller:
            noisy points of a continued wall are reported as changes.
        min_flatness: the same, in spacings, at least, where the surfaces are without noise. 0: only rounding is
            allowed for.
        bare: the other cloud shows the surface below a segment bare where the density of the segment's own cloud there
            is at most this fraction of that of the other cloud, each relative to its density beside the segment. 0: the
            floor on either side of a pipe counts as floor below it; 1: any surface below a segment is bare.
        coverage_edge: walls at the edge of the coverage, and when points of the two clouds are at the same place.
    """

    reach: float = 10.0
    far_reach: float = 60.0
    continued: float = 0.8
    voxels_per_reach: float = 6.0
    planes: PlaneSettings = PlaneSettings(min_share=0.08)
    min_width: float = 0.9
    far_width: float = 2.0
    noise_deviations: float = 3.0
    min_flatness: float = 0.5
    bare: float = 0.75
    coverage_edge: CoverageEdgeSettings = CoverageEdgeSettings()


@dataclasses.dataclass(frozen=True, eq=False)
class Continuation:
    """How one segment continues the surfaces adjacent to it, as far as the clouds show it without views.

    A point continues a plane of the unchanged points when it is within the noise of the plane. Where the other cloud
    has points of the plane at the same places, these were observed, and what lies on the plane is a thin object. A
    plane must be in both clouds, so that the sides of an object, whose lowest part passes for unchanged, are excluded.
    Each answer is computed when it is first asked for.

    Attributes:
        segment: points of one cloud.
        reference: the unchanged points of the same cloud, and the other cloud.
        settings: when a point continues a surface.
    """

    segment: Float64[np.ndarray, "m 3"]
    reference: ReferenceSurfaces
    settings: ContinuationSettings = ContinuationSettings()

    @functools.cached_property
    def continued(self) -> Bool[np.ndarray, " m"]:
        """The points on planes that both clouds have beside the segment, where the other cloud has a hole."""
        if self._alone:
            return np.zeros(len(self.segment), bool)
        continued = self._continued(self._adjacent_planes)
        if continued.mean() > self.settings.continued:
            return continued
        width = np.sqrt(max(np.linalg.eigvalsh(np.cov(self.segment.T, bias=True))[1], 0.0))
        far, min_width = self._unchanged_within(self.settings.far_reach), self.settings.far_width * width
        return continued | self._continued(self._planes_of(far, self.settings.far_reach, min_width))

    @functools.cached_property
    def at_edge(self) -> Bool[np.ndarray, " m"]:
        """The points on walls at the edge of the other survey's coverage; none where nearly all are continued."""
        if self._alone or self.continued.mean() > self.settings.continued:
            return np.zeros(len(self.segment), bool)
        flatness = max(self._flatness, self.reference.spacing)
        return at_coverage_edge(self.segment, self.reference, flatness, self.settings.coverage_edge)

    @functools.cached_property
    def shown(self) -> float:
        """Largest fraction of the segment's footprint on an adjacent plane that only the other cloud has there.

        What the other survey observed there, the segment hides or replaces.
        """
        if self._alone:
            return 0.0
        planes = self._adjacent_planes
        return _shown(self.segment, self._adjacent, planes, self._flatness, self.reference, self.settings)

    @property
    def unobserved(self) -> Bool[np.ndarray, " m"]:
        """The points that the other survey cannot have observed, as far as the clouds show it."""
        return self.continued | self.at_edge

    @property
    def _alone(self) -> bool:
        return not self.reference.unchanged.n or not self.reference.other.n

    @functools.cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.segment)

    def _unchanged_within(self, reach: float) -> Float64[np.ndarray, "n 3"]:
        return points_within(self._tree, self.reference.unchanged.data, reach * self.reference.spacing)

    @functools.cached_property
    def _adjacent(self) -> Float64[np.ndarray, "n 3"]:
        return self._unchanged_within(self.settings.reach)

    @functools.cached_property
    def _flatness(self) -> float:
        """The largest distance of an inlier from its plane, by the noise of the adjacent points, where there are any.

        The segment itself may have curved sides.
        """
        points = self._adjacent if len(self._adjacent) else self.segment
        noise = self.settings.noise_deviations * plane_surface(points, self.settings.planes).thickness
        return min(self.reference.tolerance, max(noise, self.settings.min_flatness * self.reference.spacing))

    @functools.cached_property
    def _adjacent_planes(self) -> list[Plane]:
        return self._planes_of(self._adjacent, self.settings.reach, 0.0)

    def _planes_of(self, unchanged: Float64[np.ndarray, "n 3"], reach: float, min_width: float) -> list[Plane]:
        """The planes, common to both clouds, of the unchanged points within reach (in spacings) of the segment."""
        voxel = reach * self.reference.spacing / self.settings.voxels_per_reach
        min_width = max(self.settings.min_width * voxel, min_width)
        voxels = voxel_grid(unchanged, voxel).points
        return _common_planes(voxels, self._flatness, min_width, self.reference, self.settings)

    def _continued(self, planes: Sequence[Plane]) -> Bool[np.ndarray, " m"]:
        """The points that continue these planes, where the other cloud has a hole."""
        continued = np.zeros(len(self.segment), bool)
        for plane in planes:
            on_plane = plane.distance(self.segment) <= self._flatness
            points, edge = self.segment[on_plane], self.settings.coverage_edge
            if not _covered(plane, points, self._flatness, self.reference, edge):
                continued |= on_plane
        return continued


def _shown(
    segment: Float64[np.ndarray, "m 3"],
    adjacent: Float64[np.ndarray, "n 3"],
    planes: Sequence[Plane],
    flatness: float,
    reference: ReferenceSurfaces,
    settings: ContinuationSettings,
) -> float:
    """The largest share of a segment's footprint on a plane that only the other cloud has there."""
    clear, shares = flatness + reference.tolerance, [0.0]
    for plane in planes:
        distances = plane.distance(segment)
        on_plane = distances <= flatness
        if on_plane.mean() > settings.continued:
            continue
        # What is near the plane, and near the footprint on it, is near the segment but for the height of the segment.
        reach = distances.max() + clear + settings.reach * reference.spacing
        near = within_box(reference.other.data, segment.min(axis=0) - reach, segment.max(axis=0) + reach)
        clouds = reference.other.data[near], adjacent
        other, own = (plane.projections(cloud[plane.distance(cloud) <= clear]) for cloud in clouds)
        footprint = plane.projections(segment[~on_plane])
        shares.append(_share_shown(footprint, other, own, reference.spacing, settings))
    return max(shares)


def _share_shown(
    segment: Float64[np.ndarray, "m 3"],
    other: Float64[np.ndarray, "k 3"],
    own: Float64[np.ndarray, "n 3"],
    spacing: float,
    settings: ContinuationSettings,
) -> float:
    """The share of a footprint where the other cloud has a surface that the segment's own cloud largely lacks.

    Densities are compared, because within reach of something as narrow as a pipe there is floor on either side.

    Args:
        segment: its points, projected onto the plane of the surface.
        other: points of the other cloud on that plane, projected likewise.
        own: those of the segment's own cloud.
        spacing: distance of neighbouring points.
        settings: when the surface is bare.
    """
    near, reach = settings.coverage_edge.near * spacing, settings.reach * spacing
    # Cells of one size: the footprint of an upright side is a line, however many points it has.
    footprint, fine = (voxel_grid(segment, size).points for size in (near, spacing))
    other = other[within_box(other, footprint.min(axis=0) - reach, footprint.max(axis=0) + reach)]
    if not len(other):
        return 0.0
    outline = cKDTree(fine)

    def around(points: Float64[np.ndarray, "n 3"]) -> int:
        distances = outline.query(points, distance_upper_bound=reach)[0]
        return int(((distances > near) & np.isfinite(distances)).sum())

    own_by_other = (around(own) + 1) / (around(other) + 1)
    others, owns = (cKDTree(points).query_ball_point(footprint, near, return_length=True) for points in (other, own))
    return float(((others > 0) & (owns <= settings.bare * own_by_other * others)).mean())


def _covered(
    plane: Plane,
    points: Float64[np.ndarray, "m 3"],
    flatness: float,
    reference: ReferenceSurfaces,
    settings: CoverageEdgeSettings,
) -> bool:
    """Whether the other cloud has points of a plane at the places of these points."""
    if not len(points):
        return False
    near, clear = settings.near * reference.spacing, flatness + reference.tolerance
    # No further from the points, which are within the flatness of the plane, can be at their places of it.
    reach = near + flatness + clear
    others = reference.other.data
    others = others[within_box(others, points.min(axis=0) - reach, points.max(axis=0) + reach)]
    surface = others[plane.distance(others) <= clear]
    return bool(plane.near(points, surface, near).mean() > settings.max_covered)


def _common_planes(
    points: Float64[np.ndarray, "n 3"],
    flatness: float,
    min_width: float,
    reference: ReferenceSurfaces,
    settings: ContinuationSettings,
) -> list[Plane]:
    """The planes with the most inliers among those points that the other cloud has at the same place of its surface."""
    if not len(points):
        return []
    surface = plane_surface(points, settings.planes)
    distances, neighbours = nearest_neighbours(reference.other, points, settings.planes.neighbours)
    heights = np.abs(np.einsum("nki,ni->nk", reference.other.data[neighbours] - points[:, None], surface.normals))
    lateral = distances**2 - heights**2
    near = settings.coverage_edge.near * reference.spacing
    in_both = ((heights <= reference.tolerance) & (lateral <= near**2)).any(axis=1)
    return planes_of(surface, flatness, min_width, in_both, settings.planes)
