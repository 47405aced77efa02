"""Free space: whether a survey observed that the places of another cloud's points are empty."""

import dataclasses
import enum
import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int8, Int64
from scipy.spatial import cKDTree

from gmmjax.clouds import SensorViews
from gmmjax.geometry import DepthImage, DepthImageSettings, Frustum, LocalSurface, Nearest, frustums


@dataclasses.dataclass(frozen=True)
class FreeSpaceSettings:
    """What the points of a survey occlude, and how far from its surface free space begins.

    Attributes:
        spacing_neighbour: the distance to this nearest neighbour is the spacing of points on a surface: exact for 4 on
            a square grid, and right on average for points at random. Fewer: surfaces have holes to see through.
        widest_spacing: largest spacing of a point, in median spacings; beyond it a point is an outlier, unless it is of
            a sparse surface, or so far from the nearest view that its spacing by angle is not as many times the median
            one. Larger: isolated points occlude much of a view; 1: bent surfaces occlude less.
        sparse_flatness: as `flatness`, for the surface of such a point. 0: near sparse surfaces do not occlude.
        outlier_distance: a point whose spacing exceeds this many times the median spacing of its neighbours is an
            outlier, such as the flying pixels of a depth camera at the edges of objects, and occludes nothing.
            Infinite: outliers occlude; 1: half of the points of a surface occlude nothing.
        least_indegree: a point is an outlier, too, when it is among the nearest neighbours of less than this fraction
            of as many points as it has neighbours itself (the in-degree of Hautamäki, Kärkkäinen and Fränti 2004, which
            does not depend on the density): outliers beside each other are near to one another, and to nothing else. 0:
            such groups occlude; 0.5: the rims of surfaces occlude nothing.
        most_blocked: number of the eight bins around a direction that may be occluded there, for each size of bins; of
            a surface that continues at least three are. 0: what is left of the outliers occludes three by three bins.
        flatness: largest standard deviation of the points about the plane of their neighbourhood, as a fraction of
            that along it, for the plane to be trusted nearer than the margin. 0: no free space within the margin;
            1: planes through noise and around edges are used.
        images: the size of the depth images and of their bins.
    """

    spacing_neighbour: int = 4
    widest_spacing: float = 3.0
    outlier_distance: float = 2.0
    least_indegree: float = 0.5
    most_blocked: int = 1
    flatness: float = 0.5
    sparse_flatness: float = 0.15
    images: DepthImageSettings = DepthImageSettings()


class Observed(enum.IntEnum):
    """What a survey observed at a place."""

    unobserved = -1
    """Nothing: occluded, outside every field of view, or without a return."""

    surface = 0
    """A surface."""

    free = 1
    """Free space: a view saw a surface behind the place."""


@dataclasses.dataclass(frozen=True, eq=False)
class Survey:
    """One cloud with the views it was taken from; what is computed from them is cached.

    Attributes:
        surface: the cloud, with the planes through the points' neighbourhoods.
        views: where it was taken from, or None where that is not known.
        settings: what its points occlude.
    """

    surface: LocalSurface
    views: SensorViews | None = None
    settings: FreeSpaceSettings = FreeSpaceSettings()
    _images: dict[int, list[tuple[Frustum, DepthImage]]] = dataclasses.field(
        default_factory=dict, init=False, repr=False
    )

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        views: SensorViews | None = None,
        settings: FreeSpaceSettings = FreeSpaceSettings(),
    ) -> "Survey":
        """The survey of a cloud of at least one point, whose planes are computed."""
        return cls(LocalSurface.of(points), views, settings)

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """The points of the cloud."""
        return self.surface.points

    @functools.cached_property
    def spacing(self) -> Float64[np.ndarray, " n"]:
        """Distance of each point to its neighbours on the surface; isolated points have a bounded one."""
        distances = self._neighbour_distances
        return np.asarray(np.minimum(distances, self.settings.widest_spacing * np.median(distances)))

    @functools.cached_property
    def outliers(self) -> Bool[np.ndarray, " n"]:
        """Which points belong to no surface."""
        distances, neighbours = self._neighbour_distances, self.surface.neighbours[:, 1:]
        if not neighbours.shape[1]:
            return np.zeros(len(distances), bool)
        isolated = distances > self.settings.outlier_distance * np.median(distances[neighbours], axis=1)
        in_degree = np.bincount(neighbours.ravel(), minlength=len(distances))
        return np.asarray(isolated | self._sparse | (in_degree < self.settings.least_indegree * neighbours.shape[1]))

    @property
    def _sparse(self) -> Bool[np.ndarray, " n"]:
        """Which points, on no flat surface, are farther apart than usual at their range from the nearest view."""
        distances, widest = self._neighbour_distances, self.settings.widest_spacing
        sparse = (distances > widest * np.median(distances)) & ~self._flat(self.settings.sparse_flatness)
        if self.views is None or not sparse.any():
            return np.asarray(sparse)
        ranges = cKDTree(self.views.poses[:, :3, 3]).query(self.points)[0]
        angles = distances / np.maximum(ranges, np.finfo(float).tiny)
        return np.asarray(sparse & (angles > widest * np.median(angles)))

    @functools.cached_property
    def occluders(self) -> Int64[np.ndarray, " m"]:
        """The indices of the points that the depth images show: all but outliers."""
        return np.flatnonzero(~self.outliers)

    @functools.cached_property
    def flat(self) -> Bool[np.ndarray, " n"]:
        """Around which points the surface is flat enough for its plane to be trusted."""
        return self._flat(self.settings.flatness)

    def _flat(self, flatness: float) -> Bool[np.ndarray, " n"]:
        least, middle, _ = self.surface.variances.T
        return np.asarray(least <= flatness**2 * middle)

    @functools.cached_property
    def _neighbour_distances(self) -> Float64[np.ndarray, " n"]:
        neighbour = min(self.settings.spacing_neighbour, self.surface.neighbours.shape[1] - 1)
        neighbours = self.points[self.surface.neighbours[:, neighbour]]
        return np.asarray(np.linalg.norm(neighbours - self.points, axis=1))

    def images(self, view: int) -> list[tuple[Frustum, DepthImage]]:
        """The depth images of a view, without outliers; its points are numbered as in `occluders`."""
        assert self.views is not None
        if view not in self._images:
            points = self.views.in_camera(self.points[self.occluders], view)
            spacing, settings = self.spacing[self.occluders], self.settings.images
            self._images[view] = [
                (frustum, DepthImage.of(points, spacing, frustum, settings))
                for frustum in frustums(self.views.field_of_view, settings)
            ]
        return self._images[view]


class Sightlines(NamedTuple):
    """How surely a survey observed places to be empty: by the views that have them in their field of view and range.

    Attributes:
        through: number of views that saw past the place, to a surface behind it.
        blocked: number of views in which a surface in front occludes it.
        beyond: how far the surface behind is beyond the place, in limits: the offset's from the plane of a flat
            surface, the margin along the ray elsewhere; the greatest over the views with nothing in front; 0: none.
    """

    through: Int64[np.ndarray, " n"]
    blocked: Int64[np.ndarray, " n"]
    beyond: Float64[np.ndarray, " n"]


def observation(
    points: Float64[np.ndarray, "n 3"],
    survey: Survey,
    margin: float | Float64[np.ndarray, " n"],
    offset: float | Float64[np.ndarray, " n"] = np.inf,
) -> Int8[np.ndarray, " n"]:
    """What a survey observed at the places of points of another one.

    Where its cloud has a point within the margin there is a surface. A place farther from it is free when at least one
    view saw past it: it lies in the field of view and range, the cloud has a surface behind it in the same direction,
    by more than the margin, and nothing in front of it in that direction or those next to it. The distance to the
    surface, not the depth along the ray, is compared with the margin, so that a slightly misregistered surface seen at
    a grazing angle is not taken for free space.

    Within the margin a place is free when it is off the plane of the nearest points by more than the offset (or the
    nearest point is an outlier), and a view saw past it to a flat surface, off whose plane it is by that much, too.

    Args:
        points: the places, of the one cloud.
        survey: of the other cloud; without views it has only its surfaces.
        margin: largest displacement of a surface by noise and registration error, in the unit of the clouds; for each
            of the points, or for all.
        offset: the same along the normal of a flat surface. Infinite: nothing within the margin is free.

    Returns:
        A value of `Observed` for each of the points.
    """
    result = np.full(len(points), Observed.unobserved, np.int8)
    if not len(points):
        return result
    places = _Places.of(points, survey, margin, offset)
    result[places.near] = Observed.surface
    open_places = np.flatnonzero(~places.near | places.off_plane)
    for view in range(0 if survey.views is None else len(survey.views)):
        free = np.zeros(len(open_places), bool)
        for sight in _sights(places.chosen(open_places), survey, view):
            free[sight.shown] = sight.through
        result[open_places[free]] = Observed.free
        open_places = open_places[~free]
    return result


def sightlines(
    points: Float64[np.ndarray, "n 3"],
    survey: Survey,
    margin: float | Float64[np.ndarray, " n"],
    offset: float | Float64[np.ndarray, " n"] = np.inf,
) -> Sightlines:
    """How surely a survey observed the places of points to be empty.

    Every view is asked about every place, while `observation` asks until one has seen past it: for the points of
    candidates, not for whole clouds.

    Args:
        points: the places, of the one cloud.
        survey: of the other cloud; without views nothing is seen through or blocked.
        margin: as of `observation`.
        offset: as of `observation`.
    """
    result = Sightlines(np.zeros(len(points), int), np.zeros(len(points), int), np.zeros(len(points)))
    if survey.views is None or not len(points):
        return result
    places = _Places.of(points, survey, margin, offset)
    for view in range(len(survey.views)):
        for sight in _sights(places, survey, view):
            result.through[sight.shown] += sight.through & (~places.near | places.off_plane)[sight.shown]
            result.blocked[sight.shown] += sight.blocked
            unblocked = np.where(sight.blocked, 0.0, sight.beyond)
            result.beyond[sight.shown] = np.maximum(result.beyond[sight.shown], unblocked)
    return result


class _Places(NamedTuple):
    """Places of points of another cloud, each with its limits.

    Attributes:
        points: their coordinates.
        margin: up to which a point of the survey's cloud is at the place.
        offset: from which a place is off a flat surface.
        near: whether the survey's cloud has a point within the margin.
        off_plane: of these whether the place is off the plane of the nearest point, or that point is an outlier.
    """

    points: Float64[np.ndarray, "n 3"]
    margin: Float64[np.ndarray, " n"]
    offset: Float64[np.ndarray, " n"]
    near: Bool[np.ndarray, " n"]
    off_plane: Bool[np.ndarray, " n"]

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        survey: Survey,
        margin: float | Float64[np.ndarray, " n"],
        offset: float | Float64[np.ndarray, " n"],
    ) -> "_Places":
        margin, offset = (np.broadcast_to(np.asarray(limit, float), len(points)) for limit in (margin, offset))
        distance, nearest = survey.surface.tree.query(points, distance_upper_bound=margin.max(), workers=-1)
        near = distance <= margin
        off_plane = np.zeros(len(points), bool)
        chosen = np.flatnonzero(near & np.isfinite(offset))
        there = nearest[chosen]
        off = np.abs(_height(points[chosen], survey.surface, there)) > offset[chosen]
        off_plane[chosen] = survey.outliers[there] | (survey.flat[there] & off)
        return cls(points, margin, offset, near, off_plane)

    def chosen(self, which: Int64[np.ndarray, " m"]) -> "_Places":
        return _Places(*(values[which] for values in self))


class _Sight(NamedTuple):
    """Some of the places as one image shows them.

    Attributes:
        shown: their indices.
        through: whether the view saw past them.
        blocked: whether a surface occludes them.
        beyond: how far the surface behind them is from them, in limits.
    """

    shown: Int64[np.ndarray, " m"]
    through: Bool[np.ndarray, " m"]
    blocked: Bool[np.ndarray, " m"]
    beyond: Float64[np.ndarray, " m"]


def _sights(places: _Places, survey: Survey, view: int) -> Iterator[_Sight]:
    """The places in the field of view and range of one view, image by image."""
    assert survey.views is not None
    in_camera = survey.views.in_camera(places.points, view)
    visible = np.flatnonzero(survey.views.in_field_of_view(in_camera))
    if not len(visible):
        return
    position = survey.views.poses[view, :3, 3]
    for frustum, image in survey.images(view):
        inside, directions, ranges = frustum.project(in_camera[visible])
        group = places.chosen(visible[inside])
        found = image.nearest(directions)
        beyond = _beyond(group, found, ranges, survey, position)
        through = beyond > 1
        doubtful = np.flatnonzero((beyond > 0) & (found.range_around <= ranges))
        blocked = found.range < ranges - group.margin
        blocked[doubtful] = _occluded(
            group.chosen(doubtful), survey, position, image.around(directions[doubtful]), ranges[doubtful]
        )
        yield _Sight(visible[inside], through & ~blocked, blocked, beyond)


def _beyond(
    places: _Places,
    found: Nearest,
    ranges: Float64[np.ndarray, " n"],
    survey: Survey,
    position: Float64[np.ndarray, " 3"],
) -> Float64[np.ndarray, " n"]:
    """How far the surface in the direction of each place is behind it, in limits; 0 where none is."""
    beyond = np.where(np.isfinite(found.range), np.maximum(found.range - ranges, 0) / places.margin, 0.0)
    near = np.flatnonzero((beyond > 0) & places.near)
    behind = survey.occluders[found.point[near]]
    in_front = _in_front(places.points[near], survey.surface, behind, position) / places.offset[near]
    beyond[near] = np.where(survey.flat[behind], np.maximum(in_front, 0), 0.0)
    return beyond


def _occluded(
    places: _Places,
    survey: Survey,
    position: Float64[np.ndarray, " 3"],
    around: Int64[np.ndarray, "n l 9"],
    ranges: Float64[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Whether surfaces next to the directions of the places occlude them: points nearer to the sensor.

    The points of a flat surface do not, where the place is in front of its plane: a floor that rises towards the
    sensor does not occlude what stands on it.

    Args:
        places: with a surface behind them.
        survey: whose surfaces they are.
        position: of the sensor.
        around: points of the survey in the bins around the direction of each place, of each size of bins.
        ranges: of the places.
    """
    occluders = np.where(around < 0, -1, survey.occluders[around])
    distances = np.linalg.norm(survey.points[occluders] - position, axis=-1)
    nearer = (occluders >= 0) & (distances < ranges[:, None, None])
    place, level, bin_around = np.nonzero(nearer)
    of = occluders[place, level, bin_around]
    in_front = _in_front(places.points[place], survey.surface, of, position) > places.offset[place]
    nearer[place, level, bin_around] = ~(in_front & survey.flat[of])
    return np.asarray((nearer.sum(axis=2) > survey.settings.most_blocked).any(axis=1))


def _height(
    points: Float64[np.ndarray, "n 3"], surface: LocalSurface, of: Int64[np.ndarray, " n"]
) -> Float64[np.ndarray, " n"]:
    """The signed distance of each place from the plane of one of the surface's points."""
    return np.asarray(((points - surface.centres[of]) * surface.normals[of]).sum(axis=1))


def _in_front(
    points: Float64[np.ndarray, "n 3"],
    surface: LocalSurface,
    of: Int64[np.ndarray, " n"],
    position: Float64[np.ndarray, " 3"],
) -> Float64[np.ndarray, " n"]:
    """How far each place is in front of that plane, on the side of the sensor."""
    return np.asarray(
        np.sign(_height(np.broadcast_to(position, points.shape), surface, of)) * _height(points, surface, of)
    )
