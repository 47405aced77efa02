"""Free space: whether a survey observed that the places of another cloud's points are empty."""

import enum
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int8, Int64

from gmmjax.changes.evidence.facing import Facing
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.geometry import LocalSurface, Nearest


class Observed(enum.IntEnum):
    """What a survey observed at a place."""

    unobserved = -1
    """Nothing: occluded, outside every field of view, or without a return."""

    surface = 0
    """A surface."""

    free = 1
    """Free space: a view saw a surface behind the place."""


class Sightlines(NamedTuple):
    """How surely a survey observed places to be empty: by the views that have them in their field of view and range.

    Attributes:
        through: number of views that saw past the place, to a surface behind it.
        blocked: number of views in which a surface in front occludes it.
        beyond: how far the surface behind is beyond the place, in limits: the offset's from the plane of a flat
            surface, the margin along the ray elsewhere; the greatest over the views with nothing in front; 0: none.
        reached: number of views of which a line of sight ends at the place or behind it, however near the surface that
            it ends on: in front of a place that none reaches a surface hides it. A view that did not see past the place
            reached no surface that faces away from it.
    """

    through: Int64[np.ndarray, " n"]
    blocked: Int64[np.ndarray, " n"]
    beyond: Float64[np.ndarray, " n"]
    reached: Int64[np.ndarray, " n"]


def observation(
    points: Float64[np.ndarray, "n 3"],
    survey: ScanVisibility,
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
    survey: ScanVisibility,
    margin: float | Float64[np.ndarray, " n"],
    offset: float | Float64[np.ndarray, " n"] = np.inf,
    facing: Facing | None = None,
) -> Sightlines:
    """How surely a survey observed the places of points to be empty.

    Every view is asked about every place, while `observation` asks until one has seen past it: for the points of
    candidates, not for whole clouds.

    Args:
        points: the places, of the one cloud.
        survey: of the other cloud; without views nothing is seen through or blocked.
        margin: as of `observation`.
        offset: as of `observation`.
        facing: to which side the surfaces of the points face; None: to all sides.
    """
    through, blocked, reached = np.zeros((3, len(points)), int)
    result = Sightlines(through, blocked, np.zeros(len(points)), reached)
    if survey.views is None or not len(points):
        return result
    places = _Places.of(points, survey, margin, offset)
    for view in range(len(survey.views)):
        for sight in _sights(places, survey, view):
            result.through[sight.shown] += sight.through & (~sight.places.near | sight.places.off_plane)
            result.blocked[sight.shown] += sight.blocked
            unblocked = np.where(sight.blocked, 0.0, sight.beyond)
            result.beyond[sight.shown] = np.maximum(result.beyond[sight.shown], unblocked)
            reached = _reached(sight, survey, view)
            if facing is not None:
                away = facing.chosen(sight.shown).away(sight.places.points, survey.views.poses[view, :3, 3])
                reached &= sight.through | ~away
            result.reached[sight.shown] += reached
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
        survey: ScanVisibility,
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
        places: these places.
        ranges: their distances from the sensor.
        found: the nearest point in the direction of each; those without one have an infinite range.
        through: whether the view saw past them.
        blocked: whether a surface occludes them.
        beyond: how far the surface behind them is from them, in limits.
    """

    shown: Int64[np.ndarray, " m"]
    places: _Places
    ranges: Float64[np.ndarray, " m"]
    found: Nearest
    through: Bool[np.ndarray, " m"]
    blocked: Bool[np.ndarray, " m"]
    beyond: Float64[np.ndarray, " m"]


def _sights(places: _Places, survey: ScanVisibility, view: int) -> Iterator[_Sight]:
    """The places in the field of view and range of one view, image by image."""
    assert survey.views is not None
    in_camera = survey.views.in_camera(places.points, view)
    visible = np.flatnonzero(survey.views.in_field_of_view(in_camera))
    if not len(visible):
        return
    position = survey.views.poses[view, :3, 3]
    survey = survey.sighted or survey
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
        yield _Sight(visible[inside], group, ranges, found, through & ~blocked, blocked, beyond)


def _beyond(
    places: _Places,
    found: Nearest,
    ranges: Float64[np.ndarray, " n"],
    survey: ScanVisibility,
    position: Float64[np.ndarray, " 3"],
) -> Float64[np.ndarray, " n"]:
    """How far the surface in the direction of each place is behind it, in limits; 0 where none is."""
    beyond = np.where(np.isfinite(found.range), np.maximum(found.range - ranges, 0) / places.margin, 0.0)
    chosen = np.flatnonzero(beyond > 0)
    behind = survey.occluders[found.point[chosen]]
    in_front = _in_front(places.points[chosen], survey.surface, behind, position)
    if survey.cell is not None:
        in_front -= survey.settings.tilts * _height_error(places.points[chosen], survey.surface, behind)
    in_front /= places.offset[chosen]
    near, flat = places.near[chosen], survey.flat[behind]
    beyond[chosen[near]] = np.where(flat, np.maximum(in_front, 0), 0.0)[near]
    if survey.cell is not None:
        # No line of sight passes a place in the plane that it ends on: a floor at a grazing angle, with a hole in it.
        limited = np.isfinite(places.offset[chosen])
        beyond[chosen[~near & flat & limited & (in_front <= 1)]] = 0.0
    return beyond


def _reached(sight: _Sight, survey: ScanVisibility, view: int) -> Bool[np.ndarray, " m"]:
    """Which places are not behind the surface in their direction: its plane where it is flat, else its nearest point.

    At a grazing angle a place on a surface is far in front of or behind the next point of it, and not off its plane.
    """
    assert survey.views is not None
    position = survey.views.poses[view, :3, 3]
    survey = survey.sighted or survey
    result, ends = np.zeros(len(sight.shown), bool), np.flatnonzero(np.isfinite(sight.found.range))
    met, places = survey.occluders[sight.found.point[ends]], sight.places.chosen(ends)
    error = survey.settings.tilts * _height_error(places.points, survey.surface, met)
    behind_plane = -_in_front(places.points, survey.surface, met, position) > places.offset + error
    tolerance = np.minimum(places.margin, survey.settings.behind * survey.spacing[met])
    behind_point = sight.found.range[ends] < sight.ranges[ends] - tolerance
    result[ends] = ~np.where(survey.flat[met], behind_plane, behind_point)
    return result


def _occluded(
    places: _Places,
    survey: ScanVisibility,
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
    return np.asarray((nearer.sum(axis=2) > survey.settings.max_blocked).any(axis=1))


def _height(
    points: Float64[np.ndarray, "n 3"], surface: LocalSurface, of: Int64[np.ndarray, " n"]
) -> Float64[np.ndarray, " n"]:
    """The signed distance of each place from the plane of one of the surface's points."""
    return np.asarray(((points - surface.centres[of]) * surface.normals[of]).sum(axis=1))


def _height_error(
    points: Float64[np.ndarray, "n 3"], surface: LocalSurface, of: Int64[np.ndarray, " n"]
) -> Float64[np.ndarray, " n"]:
    """The standard deviation of the height of each place above the plane of one of the points, by the plane's tilt."""
    return surface.tilts(of) * surface.heights(points, of).beside


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
