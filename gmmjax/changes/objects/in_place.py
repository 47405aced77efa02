"""Objects that were turned or shifted within their old place: what stands there before, registered to what does after.

Where an object and its moved self overlap, the clouds differ in slivers only: those of its old sides disappeared, those
of its new ones appeared. One motion that explains both kinds of slivers makes one object of them, with all the points
between them that look unchanged. The numbers come from development on the scenes of docs/results.md.
"""

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.match import Compared, Match, match_of, rotation_cost
from gmmjax.changes.objects.overlap import on_surface
from gmmjax.changes.objects.place import FEWEST, PLANES, Place, place_around
from gmmjax.changes.objects.rigid_match import FIRST_REACH, best_starts, refined
from gmmjax.geometry import (
    LocalSurface,
    evenly_chosen,
    plane_surface,
    planes_of,
    rigid_transform,
    rotation_about,
    transformed,
)
from gmmjax.pair import Pair, each

# Groups of adjacent changes that are examined at most, the largest first: a bound on the time. Changes nearer to each
# other than this, in spacings, are adjacent.
MAX_GROUPS, ADJACENT = 6, 8.0
# Rotations that the search starts from, in either sense, and the best starts, which are refined.
ANGLES, BEST_STARTS = np.radians([8.0, 20.0, 35.0, 50.0]), 5
# A panel on a hinge has this fraction of the points that differ in one plane; the others came into sight behind it. Its
# rotation may explain less than another motion by this fraction: a panel is often slid along itself.
PANEL_SAMPLE, PANEL, HINGE_BONUS = 600, 0.4, 0.1
# `InPlaceMotion.explained`, at least; the rest of the decision is the model's.
MIN_EXPLAINED = 0.5
# Points of the object lie within the hull of what differs, or this many spacings outside of it.
MARGIN_OF_HULL = 3.0


class InPlaceMotion(NamedTuple):
    """An object that moved within its place.

    Attributes:
        match: of what stood there to what stands there.
        members: of either cloud, the indices of its points.
        parts: the surfaces of those points.
        explained: fraction of the points of the changes that the motion explains, in the cloud where it is smaller;
            where a cloud has no changes, of the points that differ.
    """

    match: Match
    members: Pair[Int[np.ndarray, " _"]]
    parts: Pair[LocalSurface]
    explained: float


def adjacent_groups(parts: Sequence[Float[np.ndarray, "_ 3"]], spacing: float) -> list[list[int]]:
    """Group the changes that are near each other, those with the most points first.

    Args:
        parts: the points of each change.
        spacing: of neighbouring points, of the sparser cloud.
    """
    trees = [cKDTree(points) for points in parts]
    near = np.zeros((len(parts), len(parts)), bool)
    for i, j in itertools.combinations(range(len(parts)), 2):
        near[i, j] = trees[i].count_neighbors(trees[j], ADJACENT * spacing) > 0
    count, group = connected_components(near, directed=False)
    groups = [np.flatnonzero(group == number).tolist() for number in range(count)]
    return sorted(groups, key=lambda own: -sum(len(parts[index]) for index in own))[:MAX_GROUPS]


def motion_in_place(
    seeds: Pair[Int[np.ndarray, " _"]], surfaces: Pair[LocalSurface], noise: float
) -> InPlaceMotion | None:
    """Find the motion that explains adjacent changes as one object that was turned or shifted.

    Args:
        seeds: indices of the points of the changes in either cloud.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.

    Returns:
        The motion; None where there is none that explains enough.
    """
    place = place_around(seeds, surfaces, noise)
    if place is None:
        return None
    transform = _best_transform(place, noise)
    explained = _explained(place, transform, noise)
    share = min(each(lambda own, asked: float(own[asked].mean()), explained, _to_explain(place, seeds)))
    if share < MIN_EXPLAINED:
        return None
    chosen = _moved_points(place, explained, transform)
    if chosen is None:
        return None
    parts = each(lambda own, kept: LocalSurface.of(own.points[kept]), place.objects, chosen)
    members = each(lambda own, kept: own[kept], place.members, chosen)
    return InPlaceMotion(match_of(Compared(parts, surfaces, noise), transform), members, parts, share)


def _to_explain(place: Place, seeds: Pair[Int[np.ndarray, " _"]]) -> Pair[Bool[np.ndarray, " _"]]:
    """In either cloud the points of the changes; where there are hardly any, all that differ.

    Of what differs, but is no change, much came into sight: the room behind a door that was opened.
    """
    changed = each(lambda own, seed, differs: differs & np.isin(own, seed), place.members, seeds, place.differs)
    return each(lambda own, differs: own if own.sum() >= FEWEST else differs, changed, place.differs)


def _best_transform(place: Place, noise: float) -> Float64[np.ndarray, "4 4"]:
    """The motion that explains most of what differs.

    Of equal ones the smallest rotation is taken, and a hinge before any other: a panel's planes do not tell how far it
    slid along itself.
    """
    different = each(lambda own, differs: own.points[differs], place.objects, place.differs)
    starts = best_starts(different, place.objects, _starts(place, different), BEST_STARTS)
    found = [_refined(place, start, noise) for start in starts]
    hinged = [_refined(place, start, noise) for start in _hinged(different, place.flatness)]
    found += [(merit + HINGE_BONUS, transform) for merit, transform in hinged]
    return max(found, key=lambda one: one[0])[1]


def _starts(place: Place, different: Pair[Float64[np.ndarray, "_ 3"]]) -> Float64[np.ndarray, "s 4 4"]:
    """No motion, the translation of what differs, and rotations about the axes of the walls and floors."""
    middles = different.map(lambda points: (points.min(axis=0) + points.max(axis=0)) / 2)
    means = different.map(lambda points: points.mean(axis=0))
    starts = [rigid_transform(), rigid_transform(translation=means.after - means.before)]
    starts.append(rigid_transform(translation=middles.after - middles.before))
    for axis in place.axes:
        for angle in (*-ANGLES, *ANGLES):
            starts.append(rotation_about(Rotation.from_rotvec(angle * axis).as_matrix(), *middles))
    return np.stack(starts)


def _panel(points: Float64[np.ndarray, "n 3"], flatness: float) -> Float64[np.ndarray, "m 3"] | None:
    """The points of the largest plane among those that differ; None where most of them are of other surfaces."""
    few = plane_surface(points[evenly_chosen(len(points), PANEL_SAMPLE)], PLANES)
    planes = planes_of(few, flatness, settings=dataclasses.replace(PLANES, max_planes=1))
    own = few.points[planes[0].distance(few.points) <= flatness] if planes else few.points[:0]
    return own if len(own) >= max(PANEL * len(few), 3) else None


def _hinged(different: Pair[Float64[np.ndarray, "_ 3"]], flatness: float) -> list[Float64[np.ndarray, "4 4"]]:
    """The rotations about the line in which the planes of two panels meet; none where what differs is no panel."""
    before, after = different.map(lambda points: _panel(points, flatness))
    if before is None or after is None:
        return []
    means = before.mean(axis=0), after.mean(axis=0)
    normals = [np.linalg.eigh(np.cov(points.T))[1][:, 0] for points in (before, after)]
    line = np.cross(normals[0], normals[1])
    sine = float(np.linalg.norm(line))
    if sine < np.sin(ANGLES[0] / 2):
        return []
    line /= sine
    # The point on both planes that is next to what differs.
    offsets = [normals[0] @ means[0], normals[1] @ means[1], line @ (means[0] + means[1]) / 2]
    on_line = np.linalg.solve(np.stack([*normals, line]), offsets)
    angle = float(np.arctan2(sine, normals[0] @ normals[1]))
    turns = [Rotation.from_rotvec(turn * line).as_matrix() for turn in (angle, angle - np.pi)]
    return [rotation_about(turn, on_line, on_line) for turn in turns]


def _refined(place: Place, start: Float64[np.ndarray, "4 4"], noise: float) -> tuple[float, Float64[np.ndarray, "4 4"]]:
    """A start after point-to-plane ICP of what differs, then of all that the motion explains; with its merit first."""
    moving = place.differs.before
    transform = refined(place.objects, start, noise, FIRST_REACH, moving=np.flatnonzero(moving))
    moving = moving | _explained(place, transform, noise).before
    transform = refined(place.objects, transform, noise, moving=np.flatnonzero(moving))
    shares = each(lambda own, differs: float(own[differs].mean()), _explained(place, transform, noise), place.differs)
    return min(shares) + sum(shares) / 2 - rotation_cost(transform), transform


def _explained(place: Place, transform: Float64[np.ndarray, "4 4"], noise: float) -> Pair[Bool[np.ndarray, " _"]]:
    """Mask of the points of either object that lie on the other one after the motion."""
    ways = Pair(transform, np.linalg.inv(transform))
    points = each(lambda own, way: transformed(own.points, way), place.objects, ways)
    means = each(lambda own, way: transformed(own.all_means, way), place.objects, ways)
    lies = functools.partial(on_surface, noise=noise, spacing=place.spacing)
    return each(lies, points, means, place.objects.swapped)


def _moved_points(
    place: Place, explained: Pair[Bool[np.ndarray, " _"]], transform: Float64[np.ndarray, "4 4"]
) -> Pair[Bool[np.ndarray, " _"]] | None:
    """The points of the object: what differs or fits the motion within the hull of what is explained of both clouds.

    None where there are too few.
    """
    ways = Pair(transform, np.linalg.inv(transform))
    sure = each(lambda own, fits, differs: own.points[fits & differs], place.objects, explained, place.differs)
    hulls = each(lambda here, there: np.concatenate([here, there]), sure, each(transformed, sure, ways).swapped)
    try:
        inside = each(functools.partial(_within_hull, margin=MARGIN_OF_HULL * place.spacing), place.objects, hulls)
    except QhullError:
        return None
    chosen = each(lambda near, fits, differs: near & (fits | differs), inside, explained, place.differs)
    return chosen if min(own.sum() for own in chosen) >= FEWEST else None


def _within_hull(own: LocalSurface, others: Float64[np.ndarray, "h 3"], margin: float) -> Bool[np.ndarray, " n"]:
    """Mask of the points in the convex hull of others, or outside of it by no more than the margin."""
    hull = ConvexHull(others, qhull_options="QJ").equations
    return np.asarray((own.points @ hull[:, :3].T + hull[:, 3]).max(axis=1) < margin)
