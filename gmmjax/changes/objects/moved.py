"""Moved objects: changes of both clouds that a rigid transform makes one object, elsewhere or within its old place.

The numbers come from development on the scenes of docs/results.md.
"""

import dataclasses
from collections.abc import Container, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change
from gmmjax.changes.objects.cloud_changes import change_of, most_probable_first, reordered
from gmmjax.changes.objects.in_place import InPlaceMotion, adjacent_groups, motion_in_place
from gmmjax.changes.objects.match import Compared, best_match
from gmmjax.changes.objects.place import points_of
from gmmjax.changes.objects.same_object import (
    MatchFacts,
    Situation,
    observability,
    pairing_probabilities,
    principal_extents,
    shipped_model,
)
from gmmjax.changes.objects.support_plane import support_planes
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.geometry import LocalSurface, evenly_chosen
from gmmjax.pair import Pair, each

# Probability from which on two changes are reported as one object. At a lower one more pairs are wrong, and within a
# place give points that did not change to an object; at a higher one more objects are two changes, both true.
MOVED_THRESHOLD = 0.7
# Points of a change that are compared with another one, at most, and pairs that are: bounds on the time. The longest
# extents and the numbers of points of two changes that are compared differ by no greater factor.
SAMPLE, MAX_PAIRS, MAX_EXTENT_RATIO, MAX_COUNT_RATIO = 2500, 24, 1.5, 5.0
# A cluster of few points, a thin strip (second principal extent in spacings, and by the first one) and a flat patch
# (second of `observability`) fit everywhere: what is compared has at least these.
FEWEST, MIN_WIDTH, MIN_ASPECT, MIN_BEND = 40, 5.0, 0.1, 0.2


class PairHypothesis(NamedTuple):
    """A disappeared and an appeared change that may be one object.

    Attributes:
        compared: both objects.
        transform: rigid transform [4, 4] from the one to the other.
        facts: of the match.
        situation: what was known of the motion beforehand.
    """

    compared: Compared
    transform: Float64[np.ndarray, "4 4"]
    facts: MatchFacts
    situation: Situation


class PlaceHypothesis(NamedTuple):
    """Changes that may be one object that moved within its place.

    Attributes:
        group: indices of the changes.
        motion: that explains them.
        facts: of the match.
    """

    group: list[int]
    motion: InPlaceMotion
    facts: MatchFacts


class _Labelled(NamedTuple):
    """Changes of both clouds, and of each working point the index of its change or -1."""

    items: tuple[Change, ...]
    labels: Pair[Int[np.ndarray, " _"]]


def match_moved_objects(
    items: tuple[Change, ...], labels: Pair[Int[np.ndarray, " _"]], pair: AlignedPair, noise: float
) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """Make pairs that "moved", each with all its points, of the changes that are one object.

    An object that was turned or shifted within its place is one pair in place of its slivers, and its labels grow to
    the points that look unchanged; only in clouds of one resolution. A disappeared and an appeared change that fit each
    other become a pair as they are.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the clouds, or -1.
        pair: both clouds, registered.
        noise: standard deviation of the offset between local means of one surface: the registration error of
            `DetectionLimits`.

    Returns:
        The changes, most probable first, and the labels that refer to them.
    """
    if not items:
        return items, labels
    clouds = pair.working.clouds
    found = _Labelled(items, each(lambda own, cloud: cloud.of_working_points(own), labels, clouds))
    # Motions within a place were learned from clouds of one resolution: in voxels of local size what an object hides
    # passes for a part of it.
    if not any(cloud.sizes is not None for cloud in clouds):
        found = _with_united(found, pair, noise)
    hypotheses = pair_hypotheses(*found, pair.surfaces, noise)
    items = found.items
    for (i, j), probability in _partners(hypotheses).items():
        items = _joined(items, i, j, hypotheses[i, j].transform, probability)
    items, working = most_probable_first(items, found.labels)
    return items, each(lambda own, cloud: own[cloud.member], working, clouds)


def place_hypotheses(
    items: Sequence[Change], labels: Pair[Int[np.ndarray, " _"]], surfaces: Pair[LocalSurface], noise: float
) -> list[PlaceHypothesis]:
    """Find the groups of adjacent changes that one motion within a place may explain.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the surfaces, or -1.
        surfaces: of both clouds, registered.
        noise: of `match_moved_objects`.
    """
    spacing = max(surface.nearest_distance for surface in surfaces)
    points = [np.concatenate([*points_of(surfaces, _members([index], labels))]) for index in range(len(items))]
    found = []
    for group in adjacent_groups(points, spacing):
        motion = motion_in_place(_members(group, labels), surfaces, noise)
        if motion is not None:
            facts = MatchFacts.of(motion.match, motion.parts, motion.explained)
            found.append(PlaceHypothesis(group, motion, facts))
    return found


def pair_hypotheses(
    items: Sequence[Change], labels: Pair[Int[np.ndarray, " _"]], surfaces: Pair[LocalSurface], noise: float
) -> dict[tuple[int, int], PairHypothesis]:
    """Match each disappeared with each appeared change, as far as they are compared.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the surfaces, or -1.
        surfaces: of both clouds, registered.
        noise: of `match_moved_objects`.
    """
    gone = [index for index, change in enumerate(items) if change.kind == "disappeared"]
    new = [index for index, change in enumerate(items) if change.kind == "appeared"]
    if not gone or not new:
        return {}
    parts = {index: _part(surfaces.before, labels.before == index) for index in gone}
    parts |= {index: _part(surfaces.after, labels.after == index) for index in new}
    spacing = max(surface.nearest_distance for surface in surfaces)
    parts = {index: part for index, part in parts.items() if _is_distinctive(part, spacing)}
    if not parts:
        return {}
    background = np.concatenate([*points_of(surfaces, labels.map(lambda own: np.flatnonzero(own < 0)))])
    planes = dict(zip(parts, support_planes([*parts.values()], background, noise), strict=True))
    hypotheses = {}
    for i, j in _similar_pairs(items, [i for i in gone if i in parts], [j for j in new if j in parts]):
        compared = Compared(Pair(parts[i], parts[j]), surfaces, noise, Pair(planes[i], planes[j]))
        match = best_match(compared)
        if match is not None:
            situation: Situation = "standing" if match.upright else "free"
            facts = MatchFacts.of(match, compared.parts)
            hypotheses[i, j] = PairHypothesis(compared, match.transform, facts, situation)
    return hypotheses


def _members(group: Sequence[int], labels: Pair[Int[np.ndarray, " _"]]) -> Pair[Int[np.ndarray, " _"]]:
    """The indices of the points of some changes, in either cloud."""
    return labels.map(lambda own: np.flatnonzero(np.isin(own, group)))


def _part(scene: LocalSurface, own: Bool[np.ndarray, " n"]) -> LocalSurface:
    points = scene.points[own]
    return LocalSurface.of(points[evenly_chosen(len(points), SAMPLE)])


def _is_distinctive(part: LocalSurface, spacing: float) -> bool:
    """True where there are enough points, and they are neither a strip nor a flat patch."""
    longest, width, _ = principal_extents(part.points)
    wide = width >= max(MIN_WIDTH * spacing, MIN_ASPECT * longest)
    return bool(wide and len(part) >= FEWEST and observability(part)[1] >= MIN_BEND)


def _similar_pairs(items: Sequence[Change], gone: Sequence[int], new: Sequence[int]) -> list[tuple[int, int]]:
    """The pairs of similar extent and number of points, the most similar first, as many as are registered."""
    unlike: dict[tuple[int, int], float] = {}
    tiny = np.finfo(np.float64).tiny
    for i, j in ((i, j) for i in gone for j in new):
        extents = np.abs(np.subtract(*(np.log(np.maximum(items[k].box.extent, tiny)) for k in (i, j))))
        counts = abs(np.log(items[i].point_count / items[j].point_count))
        if extents[0] <= np.log(MAX_EXTENT_RATIO) and counts <= np.log(MAX_COUNT_RATIO):
            unlike[i, j] = float(extents[0] + extents[1] + counts)
    return sorted(unlike, key=lambda pair: unlike[pair])[:MAX_PAIRS]


def _partners(hypotheses: dict[tuple[int, int], PairHypothesis]) -> dict[tuple[int, int], float]:
    """The pairs that are one object, and their probabilities: above one half each change is in one pair at most."""
    gone, new = (sorted({pair[side] for pair in hypotheses}) for side in (0, 1))
    table = np.full((len(gone), len(new)), -np.inf)
    for (i, j), found in hypotheses.items():
        table[gone.index(i), new.index(j)] = shipped_model()[found.situation].log_odds(found.facts)
    probabilities = pairing_probabilities(table)
    partners = np.argwhere(probabilities >= MOVED_THRESHOLD)
    return {(gone[row], new[column]): float(probabilities[row, column]) for row, column in partners}


def _joined(
    items: tuple[Change, ...], i: int, j: int, transform: Float64[np.ndarray, "4 4"], probability: float
) -> tuple[Change, ...]:
    """The changes, of which two are each other's partner."""
    joined = list(items)
    for index, partner in ((i, j), (j, i)):
        joined[index] = dataclasses.replace(
            items[index], kind="moved", partner=partner, transform=transform, moved_probability=probability
        )
    return tuple(joined)


def _with_united(changes: _Labelled, pair: AlignedPair, noise: float) -> _Labelled:
    """The changes, where every group that one motion within its place explains has become a moved object."""
    absorbed: set[int] = set()
    hypotheses = place_hypotheses(*changes, pair.surfaces, noise)
    odds = [shipped_model()["in place"].log_odds(found.facts) for found in hypotheses]
    for index in sorted(range(len(hypotheses)), key=lambda index: -odds[index]):
        probability, found = float(1 / (1 + np.exp(-odds[index]))), hypotheses[index]
        if probability >= MOVED_THRESHOLD and absorbed.isdisjoint(found.group):
            group = [*found.group, *_within(found, changes, absorbed)]
            changes = _united(changes, pair, found._replace(group=group), probability)
            absorbed.update(group)
    kept = [index for index in range(len(changes.items)) if index not in absorbed]
    return _Labelled(*reordered(*changes, kept))


def _within(found: PlaceHypothesis, changes: _Labelled, absorbed: Container[int]) -> list[int]:
    """The other changes most of whose points are the object's: slivers that are not adjacent to the group."""
    items, labels = changes
    own = np.concatenate([*each(lambda label, members: label[members], labels, found.motion.members)])
    counts = np.bincount(own[own >= 0], minlength=len(items))
    totals = np.bincount(np.concatenate([own[own >= 0] for own in labels]), minlength=len(items))
    others = (index for index, item in enumerate(items) if index not in found.group and item.kind != "moved")
    return [index for index in others if index not in absorbed and 2 * counts[index] > totals[index]]


def _united(changes: _Labelled, pair: AlignedPair, found: PlaceHypothesis, probability: float) -> _Labelled:
    """The changes with one more moved object, whose labels replace those of a group and grow to all its points."""
    items, labels = changes
    grouped = labels.map(lambda label: np.isin(label, found.group))
    own = each(_grown, grouped, labels, found.motion.members)
    # Where nothing but the motion says that there is a change, it is as probable as the motion.
    shares = grouped.map(lambda label: 1.0 if label.any() else probability)
    group = [items[index] for index in found.group]
    both = each(lambda *of_cloud: _whole(group, *of_cloud), pair.points, pair.working.clouds, own, shares)
    first, transform = len(items), found.motion.match.transform
    numbered = each(
        lambda label, mine, number: np.asarray(np.where(mine, number, label)), labels, own, Pair(first, first + 1)
    )
    return _Labelled(_joined((*items, *both), first, first + 1, transform, probability), numbered)


def _grown(
    grouped: Bool[np.ndarray, " n"], labels: Int[np.ndarray, " n"], members: Int[np.ndarray, " m"]
) -> Bool[np.ndarray, " n"]:
    """The points of a group of changes, and those of the object that are of no change."""
    own = grouped.copy()
    own[members] |= labels[members] < 0
    return own


def _whole(
    group: Sequence[Change],
    points: Float64[np.ndarray, "n 3"],
    cloud: WorkingCloud,
    own: Bool[np.ndarray, " w"],
    share: float,
) -> Change:
    """The change of one cloud that replaces a group: its explanation is that of the largest one."""
    probability = share * max(item.probability for item in group)
    whole = change_of(points[own[cloud.member]], "moved", probability, max(item.significance for item in group))
    largest = max(group, key=lambda item: item.point_count)
    return dataclasses.replace(whole, explanation=largest.explanation)
