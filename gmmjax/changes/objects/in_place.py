"""Objects that were turned or shifted within their old place: what stands there before, registered to what does after.

Where an object and its moved self overlap, the clouds differ in slivers only: those of its old sides disappeared, those
of its new ones appeared. One motion that explains both kinds of slivers makes one object of them, with all the points
between them that look unchanged.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.match import Match, MatchSettings, match_of
from gmmjax.changes.objects.overlap import on_surface
from gmmjax.changes.objects.place import Place, PlaceSettings, connected_things, place_around
from gmmjax.changes.objects.rigid_match import RigidMatchSettings, best_starts
from gmmjax.geometry import (
    LocalSurface,
    evenly_chosen,
    plane_surface,
    planes_of,
    point_to_plane_icp,
    rigid_transform,
    rotation_about,
    transformed,
)
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class InPlaceSettings:
    """Where motions within a place are looked for, and how. All values are empirical.

    Attributes:
        most_groups: groups of adjacent changes that are examined, at most, the largest first: a bound on the time. 0:
            none, so that every sliver remains a change of its own.
        touching: changes nearer to each other than this, in spacings, are one group. 0: every change is by itself.
        place: what stands in the place of a group.
        rounds: times that the place is examined, at most: around few slivers only a part of the object is seen at
            first. 1: a part remains.
        growth: of the diagonal of the object's box beyond that of the changes, from which on its place is examined
            again. Infinite: never.
        angles: of the rotations, in degrees and either sense, that the search starts from.
        panel: fraction of the points that differ, at least, that are in one plane for it to be a panel on a hinge; what
            came into sight behind a door is among the others. Above 1: no motion about a hinge is tried.
        sample_of_panel: number of points that differ, at most, that this plane is found from.
        hinge_bonus: fraction of the points that differ by which a motion about a hinge may explain less than another.
            0: a panel is often slid along itself.
        candidates: starts, the best, that are refined.
        refinements: rounds of point-to-plane ICP on what the motion explains.
        least_explained: `InPlaceMotion.explained`, at least; the rest of the decision is the model's of the facts. 0:
            left to the model alone.
        margin_of_hull: points of the object lie within the hull of what differs, or this many spacings outside of it.
        least_fitting: of what looks unchanged and is connected outside of the hull, the fraction, at least, that fits
            the motion for it to be of the object. Above 1: nothing there is.
    """

    most_groups: int = 6
    touching: float = 8.0
    place: PlaceSettings = PlaceSettings()
    rounds: int = 3
    growth: float = 1.4
    angles: tuple[float, ...] = (8.0, 20.0, 35.0, 50.0)
    panel: float = 0.4
    sample_of_panel: int = 600
    hinge_bonus: float = 0.1
    candidates: int = 5
    refinements: int = 2
    least_explained: float = 0.5
    margin_of_hull: float = 3.0
    least_fitting: float = 0.85


class InPlaceMotion(NamedTuple):
    """An object that moved within its place.

    Attributes:
        match: of what stood there to what stands there.
        members: of either cloud, the indices of its points.
        parts: the surfaces of those points.
        explained: fraction of the points of the changes that the motion explains, in the cloud where it is smaller;
            where a cloud has no changes, of the points that differ.
        hinged: whether the motion is a rotation about a hinge.
    """

    match: Match
    members: Pair[Int[np.ndarray, " _"]]
    parts: Pair[LocalSurface]
    explained: float
    hinged: bool


def adjacent_groups(
    parts: Sequence[Float[np.ndarray, "_ 3"]], spacing: float, settings: InPlaceSettings = InPlaceSettings()
) -> list[list[int]]:
    """The groups of changes that are near each other, those with the most points first.

    Args:
        parts: the points of each change.
        spacing: of neighbouring points, of the sparser cloud.
        settings: which changes are near each other, and how many groups there are at most.
    """
    group = list(range(len(parts)))
    trees = [cKDTree(points) for points in parts]
    reach = settings.touching * spacing
    lower, upper = (np.array([end(points, axis=0) for points in parts]).reshape(-1, 3) for end in (np.min, np.max))
    for i in range(len(parts)):
        for j in range(i):
            apart = np.maximum(lower[i] - upper[j], lower[j] - upper[i]).max()
            if group[i] == group[j] or apart > reach:
                continue
            few, many = sorted((i, j), key=lambda index: len(parts[index]))
            if np.isfinite(trees[many].query(parts[few], distance_upper_bound=reach)[0]).any():
                group = [group[j] if own == group[i] else own for own in group]
    groups = [[index for index, own in enumerate(group) if own == number] for number in sorted(set(group))]
    groups.sort(key=lambda own: -sum(len(parts[index]) for index in own))
    return groups[: settings.most_groups]


def motion_in_place(
    seeds: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    noise: float,
    match: MatchSettings = MatchSettings(),
    settings: InPlaceSettings = InPlaceSettings(),
) -> InPlaceMotion | None:
    """The motion that explains adjacent changes as one object that was turned or shifted.

    Args:
        seeds: indices of the points of the changes in either cloud.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        match: how two objects are compared.
        settings: how the motion is found.

    Returns:
        The motion; None where there is none that explains enough.
    """
    found = None
    for _ in range(settings.rounds):
        motion = _motion_around(seeds, surfaces, noise, match, settings)
        if motion is None:
            break
        known, seeds, found = _diagonal(seeds, surfaces), motion.members, motion
        if _diagonal(seeds, surfaces) < settings.growth * known:
            break
    return found


def _diagonal(members: Pair[Int[np.ndarray, " _"]], surfaces: Pair[LocalSurface]) -> float:
    """Of the box along the axes around points of both clouds."""
    points = np.concatenate([*each(lambda surface, own: surface.points[own], surfaces, members)])
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _motion_around(
    seeds: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    noise: float,
    match: MatchSettings,
    settings: InPlaceSettings,
) -> InPlaceMotion | None:
    """The motion in the place around these points; None where there is none that explains enough."""
    place = place_around(seeds, surfaces, noise, match.overlap, settings.place)
    if place is None:
        return None
    transform, hinged = _best_transform(place, noise, match, settings)
    explained = _explained(place, transform, noise, match)
    share = min(each(lambda own, asked: float(own[asked].mean()), explained, _to_explain(place, seeds, settings)))
    if share < settings.least_explained:
        return None
    chosen = _moved_points(place, explained, transform, settings)
    if chosen is None:
        return None
    parts = each(lambda thing, own: LocalSurface.of(thing.points[own]), place.things, chosen)
    members = each(lambda own, kept: own[kept], place.members, chosen)
    return InPlaceMotion(match_of(parts, transform, surfaces, noise, match), members, parts, share, hinged)


def _to_explain(
    place: Place, seeds: Pair[Int[np.ndarray, " _"]], settings: InPlaceSettings
) -> Pair[Bool[np.ndarray, " _"]]:
    """In either cloud the points of the changes; where there are hardly any, all that differ.

    Of what differs, but is no change, much came into sight: the room behind a door that was opened.
    """

    def own(members: np.ndarray, seed: np.ndarray, differs: np.ndarray) -> np.ndarray:
        changed = differs & np.isin(members, seed)
        return changed if changed.sum() >= settings.place.fewest else differs

    return each(own, place.members, seeds, place.differs)


def _best_transform(
    place: Place, noise: float, match: MatchSettings, settings: InPlaceSettings
) -> tuple[Float64[np.ndarray, "4 4"], bool]:
    """The motion that explains most of what differs, and whether it is one about a hinge.

    Of equal ones the smallest rotation is taken, and a hinge before any other: a panel's planes do not tell how far it
    slid along itself.
    """
    different = each(lambda thing, differs: thing.points[differs], place.things, place.differs)
    starts = best_starts(different, place.things, _starts(place, different, settings), settings.candidates, match.rigid)
    hinged = _hinged(different, place.flatness, settings)
    found = [(*_refined(place, start, noise, match, settings), False) for start in starts]
    found += [(*_refined(place, start, noise, match, settings), True) for start in hinged]
    best = max(found, key=lambda one: one[0] + settings.hinge_bonus * one[2])
    return best[1], best[2]


def _starts(
    place: Place, different: Pair[Float64[np.ndarray, "_ 3"]], settings: InPlaceSettings
) -> Float64[np.ndarray, "s 4 4"]:
    """No motion, the translation of what differs, and rotations about the walls' axes and the object's own."""
    middles = different.map(lambda points: (points.min(axis=0) + points.max(axis=0)) / 2)
    means = different.map(lambda points: points.mean(axis=0))
    starts = [rigid_transform(), rigid_transform(translation=means.after - means.before)]
    starts.append(rigid_transform(translation=middles.after - middles.before))
    for axis in _distinct([*place.axes, *_own_axes(place.things.before)]):
        for angle in np.radians(settings.angles):
            for sense in (-1, 1):
                rotation = Rotation.from_rotvec(sense * angle * axis).as_matrix()
                starts.append(rotation_about(rotation, middles.before, middles.after))
    return np.stack(starts)


def _own_axes(thing: LocalSurface) -> Float64[np.ndarray, "6 3"]:
    """The directions of most normals, one across the other, and the principal axes."""
    normals = thing.normals[evenly_chosen(len(thing), 300)]
    parallel = np.abs(normals @ normals.T)
    first = normals[int((parallel > 0.95).sum(axis=1).argmax())]
    across = normals - np.outer(normals @ first, first)
    lengths = np.linalg.norm(across, axis=1)
    far = lengths > 0.7
    across = across[far] / lengths[far, None] if far.any() else np.linalg.svd(first[None])[2][1:2]
    second = across[int((np.abs(across @ across.T) > 0.95).sum(axis=1).argmax())]
    own = np.linalg.svd(thing.points - thing.points.mean(axis=0), full_matrices=False)[2]
    return np.stack([first, second, np.cross(first, second), *own])


def _distinct(axes: Sequence[Float64[np.ndarray, " 3"]]) -> list[Float64[np.ndarray, " 3"]]:
    """The axes without those that nearly repeat one before them."""
    kept: list[np.ndarray] = []
    for axis in axes:
        if all(abs(axis @ other) < 0.95 for other in kept):
            kept.append(axis)
    return kept


def _panel(
    points: Float64[np.ndarray, "n 3"], flatness: float, settings: InPlaceSettings
) -> Float64[np.ndarray, "m 3"] | None:
    """The points of the largest plane among those that differ; None where most of them are of other surfaces."""
    few = plane_surface(points[evenly_chosen(len(points), settings.sample_of_panel)], settings.place.planes)
    planes = planes_of(few, flatness, settings=dataclasses.replace(settings.place.planes, most_planes=1))
    if not planes:
        return None
    own = few.points[planes[0].distance(few.points) <= flatness]
    return own if len(own) >= settings.panel * len(few) else None


def _hinged(
    different: Pair[Float64[np.ndarray, "_ 3"]], flatness: float, settings: InPlaceSettings
) -> list[Float64[np.ndarray, "4 4"]]:
    """The rotations about the line in which the planes of two panels meet; none where what differs is no panel."""
    before, after = different.map(lambda points: _panel(points, flatness, settings))
    if before is None or after is None:
        return []
    means = Pair(before, after).map(lambda points: points.mean(axis=0))
    spectra = each(lambda points, mean: np.linalg.eigh(np.cov((points - mean).T)), Pair(before, after), means)
    normals = spectra.map(lambda spectrum: spectrum[1][:, 0])
    line = np.cross(normals.before, normals.after)
    sine = float(np.linalg.norm(line))
    if sine < np.sin(np.radians(min(settings.angles)) / 2):
        return []
    line /= sine
    # The point on both planes that is next to what differs.
    rows = np.stack([normals.before, normals.after, line])
    on_line = np.linalg.solve(
        rows, [normals.before @ means.before, normals.after @ means.after, line @ (means.before + means.after) / 2]
    )
    angle = float(np.arctan2(sine, normals.before @ normals.after))
    turns = [Rotation.from_rotvec(turn * line).as_matrix() for turn in (angle, angle - np.pi)]
    return [rotation_about(turn, on_line, on_line) for turn in turns]


def _refined(
    place: Place, start: Float64[np.ndarray, "4 4"], noise: float, match: MatchSettings, settings: InPlaceSettings
) -> tuple[float, Float64[np.ndarray, "4 4"]]:
    """A start after point-to-plane ICP of what the motion explains, and its merit."""
    rigid: RigidMatchSettings = match.rigid
    transform, first = start, rigid.first_reach
    all_before = Pair(np.arange(len(place.things.before)), np.arange(0))
    for number in range(settings.refinements):
        own = place.differs.before
        if number:
            own = own | _explained(place, transform, noise, match, all_before).before
        moving = np.flatnonzero(own)
        moving = moving[evenly_chosen(len(moving), rigid.sample)]
        means = place.things.before.means(moving)
        reaches = first * noise, rigid.last_reach * noise
        transform = point_to_plane_icp(means, place.things.after, transform, *reaches, rigid.icp)
        first = rigid.refined_first_reach
    explained = _explained(place, transform, noise, match, place.differs.map(np.flatnonzero))
    shares = [float(own.mean()) for own in explained]
    half_turns = Rotation.from_matrix(transform[:3, :3]).magnitude() / np.pi
    return min(shares) + sum(shares) / 2 - match.rotation_penalty * half_turns, transform


def _explained(
    place: Place,
    transform: Float64[np.ndarray, "4 4"],
    noise: float,
    match: MatchSettings,
    asked: Pair[Int[np.ndarray, " _"]] | None = None,
) -> Pair[Bool[np.ndarray, " _"]]:
    """Which of some points of either thing, or of all, lie on the other one after the motion."""
    spacing = max(thing.nearest_distance for thing in place.things)
    asked = place.things.map(lambda thing: np.arange(len(thing))) if asked is None else asked

    def lies(own: LocalSurface, rows: np.ndarray, way: np.ndarray, other: LocalSurface) -> np.ndarray:
        means = transformed(own.all_means[rows], way)
        return on_surface(transformed(own.points[rows], way), means, other, noise, spacing, match.overlap)

    return each(lies, place.things, asked, Pair(transform, np.linalg.inv(transform)), place.things.swapped)


def _moved_points(
    place: Place,
    explained: Pair[Bool[np.ndarray, " _"]],
    transform: Float64[np.ndarray, "4 4"],
    settings: InPlaceSettings,
) -> Pair[Bool[np.ndarray, " _"]] | None:
    """The points of the object: what differs, and what fits the motion within the hull of what it explains.

    What looks unchanged outside of that hull belongs to the object where all that is connected with it fits the motion,
    as the top of a box does that was shifted. Of a thing that stays some sides do not.
    """
    spacing = max(thing.nearest_distance for thing in place.things)
    ways = Pair(transform, np.linalg.inv(transform))
    sure = each(lambda thing, fits, differs: thing.points[fits & differs], place.things, explained, place.differs)
    moved_sure = each(transformed, sure, ways)

    def own(
        thing: LocalSurface, fits: np.ndarray, differs: np.ndarray, here: np.ndarray, there: np.ndarray
    ) -> np.ndarray:
        hull = ConvexHull(np.concatenate([here, there]), qhull_options="QJ").equations
        inside = (thing.points @ hull[:, :3].T + hull[:, 3]).max(axis=1) < settings.margin_of_hull * spacing
        chosen = (differs | fits) & inside
        beyond = np.flatnonzero(~inside & ~differs)
        components = connected_things(thing.points[beyond], settings.place.connected * spacing)
        for component in range(components.max(initial=-1) + 1):
            whole = beyond[components == component]
            chosen[whole] = fits[whole] & (fits[whole].mean() >= settings.least_fitting)
        return np.asarray(chosen)

    try:
        chosen = each(own, place.things, explained, place.differs, sure, moved_sure.swapped)
    except QhullError:
        return None
    return chosen if min(own.sum() for own in chosen) >= settings.place.fewest else None
