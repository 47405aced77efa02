"""The objects in the place of some changes, before and after, without the walls and floors around it.

The numbers come from development on the scenes of docs/results.md.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gmmjax.changes.objects.overlap import on_surface
from gmmjax.geometry import (
    LocalSurface,
    Plane,
    PlaneSettings,
    evenly_chosen,
    occupied_cells,
    plane_surface,
    planes_of,
)
from gmmjax.pair import Pair, each

# Radius of the place, in half diagonals of the changes' box, and in spacings that are added: a smaller one cuts off a
# part of the object, or leaves nothing around it that tells walls and floors.
REACH, MARGIN = 1.6, 12.0
# Planes are found from so many points at most; standard deviations of the points about a plane within which one is on
# it.
PLANE_SAMPLE, PLANES, FLATNESS = 1500, PlaneSettings(min_share=0.05, max_planes=8), 3.0
# A plane goes beyond the place where this fraction of its points is in the outermost fraction of the radius; of its
# points are those whose normals are along its own by this cosine, not surfaces that it cuts.
BORDER, AT_BORDER, PARALLEL = 0.15, 0.05, 0.8
# Points nearer to each other than this, in spacings, are of one object; a point of a large plane that is as far from
# the other cloud is kept: a door that is closed lies in the plane of its wall.
CONNECTED = 4.0
# Changed points of an object and points that differ in either cloud, at least, and all points, at most: a bound on the
# time.
FEWEST_CHANGED, FEWEST, MOST = 5, 15, 20_000
# Between the numbers of points that differ in the two clouds: what only appeared has not moved.
MIN_RATIO = 0.1


class Place(NamedTuple):
    """The objects in a place, without the walls and floors around it.

    Attributes:
        objects: the surfaces of the points, in either cloud.
        members: their indices.
        differs: which of them do not lie on the other cloud.
        axes: unit normals of the walls and floors; those of the coordinates where there are none.
        flatness: largest distance of a point from a plane that it belongs to.
    """

    objects: Pair[LocalSurface]
    members: Pair[Int[np.ndarray, " _"]]
    differs: Pair[Bool[np.ndarray, " _"]]
    axes: Float64[np.ndarray, "a 3"]
    flatness: float

    @property
    def spacing(self) -> float:
        """Distance of neighbouring points, in the sparser cloud."""
        return max(own.nearest_distance for own in self.objects)


def place_around(seeds: Pair[Int[np.ndarray, " _"]], surfaces: Pair[LocalSurface], noise: float) -> Place | None:
    """Find what stands where the changes are.

    Args:
        seeds: indices of the points of the changes in either cloud.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.

    Returns:
        The place; None where too little of it differs, or it is too large.
    """
    spacing = max(surface.nearest_distance for surface in surfaces)
    flatness = FLATNESS * max(noise, *(surface.thickness for surface in surfaces))
    centre, radius = _sphere(np.concatenate([*points_of(surfaces, seeds)]), spacing)
    inside = surfaces.map(lambda surface: np.sort(np.array(surface.tree.query_ball_point(centre, radius), int)))
    if min(map(len, inside)) < FEWEST:
        return None
    planes = _large_planes(np.concatenate([*points_of(surfaces, inside)]), centre, radius, flatness)
    loose = functools.partial(_loose, planes=planes, flatness=flatness, apart=CONNECTED * spacing)
    members = each(loose, inside, surfaces, surfaces.swapped)
    members = _connected_to(seeds, members, surfaces, CONNECTED * spacing)
    if not FEWEST <= min(map(len, members)) <= max(map(len, members)) <= MOST:
        return None
    means = each(lambda surface, own: surface.means(own), surfaces, members)
    same = functools.partial(on_surface, noise=noise, spacing=spacing)
    differs = each(same, points_of(surfaces, members), means, surfaces.swapped).map(np.logical_not)
    fewer, more = sorted(int(own.sum()) for own in differs)
    if fewer < max(FEWEST, MIN_RATIO * more):
        return None
    axes = np.array([plane.normal for plane in planes]) if planes else np.eye(3)
    return Place(points_of(surfaces, members).map(LocalSurface.of), members, differs, axes, flatness)


def points_of(surfaces: Pair[LocalSurface], members: Pair[Int[np.ndarray, " _"]]) -> Pair[Float64[np.ndarray, "_ 3"]]:
    """Coordinates of some points of either cloud."""
    return each(lambda surface, own: surface.points[own], surfaces, members)


def _sphere(points: Float64[np.ndarray, "n 3"], spacing: float) -> tuple[Float64[np.ndarray, " 3"], float]:
    """Centre and radius of the place around the points of changes."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    return (lower + upper) / 2, REACH * float(np.linalg.norm(upper - lower)) / 2 + MARGIN * spacing


def _large_planes(
    points: Float[np.ndarray, "n 3"], centre: Float64[np.ndarray, " 3"], radius: float, flatness: float
) -> list[Plane]:
    """The planes of a place that go beyond it: walls, floors, the table that an object stands on."""
    few = plane_surface(points[evenly_chosen(len(points), PLANE_SAMPLE)], PLANES)
    outer = np.linalg.norm(few.points - centre, axis=1) > (1 - BORDER) * radius
    large = []
    for plane in planes_of(few, flatness, settings=PLANES):
        inliers = (plane.distance(few.points) <= flatness) & (np.abs(few.normals @ plane.normal) > PARALLEL)
        if inliers.any() and outer[inliers].mean() >= AT_BORDER:
            large.append(plane)
    return large


def _loose(
    members: Int[np.ndarray, " n"],
    surface: LocalSurface,
    other: LocalSurface,
    planes: list[Plane],
    flatness: float,
    apart: float,
) -> Int[np.ndarray, " m"]:
    """The points off all the planes, and those in one where the other cloud has nothing: a door that was closed."""
    points = surface.points[members]
    off = np.ones(len(points), bool)
    for plane in planes:
        off &= plane.distance(points) > flatness
    in_plane = np.flatnonzero(~off)
    off[in_plane] = np.isinf(other.tree.query(points[in_plane], distance_upper_bound=apart)[0])
    return members[off]


def _connected_to(
    seeds: Pair[Int[np.ndarray, " _"]],
    members: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    distance: float,
) -> Pair[Int[np.ndarray, " _"]]:
    """Those points of both clouds that are of an object, before or after, with changed points."""
    labels = _connected_objects(np.concatenate([*points_of(surfaces, members)]), distance)
    of_cloud = Pair(labels[: len(members.before)], labels[len(members.before) :])
    changed = np.concatenate([*each(lambda own, seed, label: label[np.isin(own, seed)], members, seeds, of_cloud)])
    objects = np.flatnonzero(np.bincount(changed) >= FEWEST_CHANGED)
    return each(lambda own, label: own[np.isin(label, objects)], members, of_cloud)


def _connected_objects(points: Float64[np.ndarray, "n 3"], distance: float) -> Int[np.ndarray, " n"]:
    """The number of each point's connected object: points in cells of half the distance that touch."""
    if not len(points):
        return np.zeros(0, int)
    cells, cell = occupied_cells(points - points.min(axis=0), distance / 2)
    links = cKDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray")
    graph = coo_array((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(len(cells), len(cells)))
    return connected_components(graph, directed=False)[1][cell]
