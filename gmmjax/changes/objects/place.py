"""What stands in the place of some changes, before and after, without the walls and floors around it."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gmmjax.changes.objects.overlap import OverlapSettings, on_surface
from gmmjax.geometry import LocalSurface, PlaneSettings, evenly_chosen, occupied_cells, plane_surface, planes_of
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class PlaceSettings:
    """What is of a place. All values are empirical.

    Attributes:
        reach: radius of the place that is examined, in half diagonals of the group's bounding box. Too small: a part of
            the object is cut off.
        margin: added to that radius, in spacings. 0: around a small group nothing tells walls and floors.
        sample: number of points of a place, at most, that its planes are found from: a bound on the time.
        planes: how these are found.
        flatness: largest distance of a point from a plane that it belongs to, in standard deviations of the points
            about their local planes. Smaller: noisy points of a wall are taken for the object.
        border: outermost fraction of the radius; a plane with points there goes beyond the place. 0: none does.
        at_border: fraction of a plane's points there, at least, of a wall, a floor or another plane that the object
            merely touches. Above 1: none is removed, and the object cannot be told from what it stands on.
        parallel: cosine between a plane's normal and that of a point on it, at least. 0: surfaces that the plane cuts
            count for its size.
        apart: a point of such a plane that is further than this from the other cloud, in spacings, is kept: a door that
            is closed lies in the plane of its wall. Empirical. Infinite: none is.
        connected: points nearer to each other than this, in spacings, are of one thing. 0: every point is by itself.
        fewest_of_thing: changed points, at least, of a thing that is examined. 0: all things of the place are.
        fewest: points, at least, that differ in either cloud. 0: a motion is found from a few points by chance.
        most: points of the thing in either cloud, at most: a bound on the time.
        least_ratio: between the numbers of the points that differ in the two clouds, the smaller by the larger: what
            only appeared has not moved. 0: any.
    """

    reach: float = 1.6
    margin: float = 12.0
    sample: int = 1500
    planes: PlaneSettings = PlaneSettings(least_share=0.05, most_planes=8)
    flatness: float = 3.0
    border: float = 0.15
    at_border: float = 0.05
    parallel: float = 0.8
    apart: float = 4.0
    connected: float = 4.0
    fewest_of_thing: int = 5
    fewest: int = 15
    most: int = 20_000
    least_ratio: float = 0.1


class Place(NamedTuple):
    """What stands in a place, without the walls and floors around it.

    Attributes:
        things: the surfaces of the points, in either cloud.
        members: their indices.
        differs: which of them do not lie on the other cloud.
        axes: unit normals of the walls and floors.
        flatness: largest distance of a point from a plane that it belongs to.
    """

    things: Pair[LocalSurface]
    members: Pair[Int[np.ndarray, " _"]]
    differs: Pair[Bool[np.ndarray, " _"]]
    axes: Float64[np.ndarray, "a 3"]
    flatness: float


def place_around(
    seeds: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    noise: float,
    overlap: OverlapSettings = OverlapSettings(),
    settings: PlaceSettings = PlaceSettings(),
) -> Place | None:
    """What stands where the changes are.

    Args:
        seeds: indices of the points of the changes in either cloud.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        overlap: when a point lies on a surface.
        settings: what is of the place.

    Returns:
        The place; None where too little of it differs, or it is too large.
    """
    spacing = max(surface.nearest_distance for surface in surfaces)
    changed = np.concatenate([*each(lambda surface, own: surface.points[own], surfaces, seeds)])
    lower, upper = changed.min(axis=0), changed.max(axis=0)
    centre = (lower + upper) / 2
    radius = settings.reach * float(np.linalg.norm(upper - lower)) / 2 + settings.margin * spacing
    inside = surfaces.map(lambda surface: np.sort(np.array(surface.tree.query_ball_point(centre, radius), int)))
    if min(map(len, inside)) < settings.fewest:
        return None
    flatness = settings.flatness * max(noise, *(surface.thickness for surface in surfaces))
    points = each(lambda surface, own: surface.points[own], surfaces, inside)
    planes = _large_planes(np.concatenate([*points]), centre, radius, flatness, settings)
    apart = settings.apart * spacing

    def is_loose(own: np.ndarray, other: LocalSurface) -> np.ndarray:
        """Off all the planes; or in one where the other cloud has nothing, as a door that was closed."""
        off = np.all([np.abs(own @ n - d) > flatness for n, d in planes] or [own[:, 0] == own[:, 0]], axis=0)
        in_plane = np.flatnonzero(~off)
        off[in_plane] = np.isinf(other.tree.query(own[in_plane], distance_upper_bound=apart)[0])
        return np.asarray(off)

    loose = each(is_loose, points, surfaces.swapped)
    members = each(lambda own, kept: own[kept], inside, loose)
    members = _connected_to(seeds, members, surfaces, settings.connected * spacing, settings)
    if not settings.fewest <= min(map(len, members)) <= max(map(len, members)) <= settings.most:
        return None

    def differs(surface: LocalSurface, other: LocalSurface, own: np.ndarray) -> np.ndarray:
        return ~on_surface(surface.points[own], surface.means(own), other, noise, spacing, overlap)

    different = each(differs, surfaces, surfaces.swapped, members)
    counts = sorted(int(own.sum()) for own in different)
    if counts[0] < max(settings.fewest, settings.least_ratio * counts[1]):
        return None
    things = each(lambda surface, own: LocalSurface.of(surface.points[own]), surfaces, members)
    axes = np.array([normal for normal, _ in planes]).reshape(-1, 3)
    return Place(things, members, different, axes, flatness)


def _large_planes(
    points: Float[np.ndarray, "n 3"],
    centre: Float64[np.ndarray, " 3"],
    radius: float,
    flatness: float,
    settings: PlaceSettings,
) -> list[tuple[Float64[np.ndarray, " 3"], float]]:
    """The planes of a place that go beyond it: walls, floors, the table that an object stands on."""
    few = plane_surface(points[evenly_chosen(len(points), settings.sample)], settings.planes)
    outer = np.linalg.norm(few.points - centre, axis=1) > (1 - settings.border) * radius
    large = []
    for plane in planes_of(few, flatness, settings=settings.planes):
        # Without the points of other surfaces that the plane cuts, such as a wall at the height of a table.
        inliers = (plane.distance(few.points) <= flatness) & (np.abs(few.normals @ plane.normal) > settings.parallel)
        if inliers.any() and outer[inliers].mean() >= settings.at_border:
            large.append((plane.normal, plane.offset))
    return large


def _connected_to(
    seeds: Pair[Int[np.ndarray, " _"]],
    members: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    radius: float,
    settings: PlaceSettings,
) -> Pair[Int[np.ndarray, " _"]]:
    """Those points of both clouds that are of a thing, before or after, with changed points."""
    points = each(lambda surface, own: surface.points[own], surfaces, members)
    labels = connected_things(np.concatenate([*points]), radius)
    of_cloud = Pair(labels[: len(members.before)], labels[len(members.before) :])
    changed = np.concatenate([*each(lambda own, seed, label: label[np.isin(own, seed)], members, seeds, of_cloud)])
    counts = np.bincount(changed[changed >= 0], minlength=labels.max(initial=-1) + 1)
    things = np.flatnonzero(counts >= settings.fewest_of_thing)
    return each(lambda own, label: own[np.isin(label, things)], members, of_cloud)


def connected_things(points: Float64[np.ndarray, "n 3"], distance: float) -> Int[np.ndarray, " n"]:
    """The number of the connected thing that each point is of: points in cells of half the distance that touch.

    Args:
        points: of the things.
        distance: points nearer to each other than this are of one thing.
    """
    if not len(points):
        return np.zeros(0, int)
    cells, cell = occupied_cells(points - points.min(axis=0), distance / 2)
    links = cKDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray")
    graph = coo_array((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(len(cells), len(cells)))
    return connected_components(graph, directed=False)[1][cell]
