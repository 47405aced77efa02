"""Moved objects: changes of both clouds that a rigid transform makes one object, elsewhere or within its old place."""

import dataclasses
from collections.abc import Container, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change
from gmmjax.changes.objects.bare_support import Footing
from gmmjax.changes.objects.cloud_changes import change_of, most_probable_first, reordered
from gmmjax.changes.objects.in_place import InPlaceMotion, InPlaceSettings, adjacent_groups, motion_in_place
from gmmjax.changes.objects.match import MatchSettings, best_match
from gmmjax.changes.objects.match_facts import MatchFacts, match_facts, observability, principal_extents
from gmmjax.changes.objects.outline import OutlineSettings, aligned_outlines
from gmmjax.changes.objects.pairing import PairingSettings, pairing_probabilities
from gmmjax.changes.objects.same_object import Situation, shipped_model
from gmmjax.changes.objects.support_plane import support_planes
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.geometry import LocalSurface, evenly_chosen
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class MovedSettings:
    """Which disappeared and appeared changes are compared, and when they are one object.

    Attributes:
        threshold: probability from which on two changes are reported as one object. Higher: more of them are reported
            as two changes, both true; lower: more pairs are wrong, and within a place give points that did not change
            to an object. Below 0.5 a change may have two partners, of which the more probable one is reported.
        sample: number of points of a change, at most, that are compared with another change. Empirical. Larger: slower.
        most_extent_ratio: changes whose longest extents differ by a greater factor are not compared: saves time.
            Empirical. Infinite: all are.
        most_count_ratio: the same, of their point counts. Empirical. Infinite: all are.
        least_width: second principal extent, in spacings, of what is compared; a thinner strip fits everywhere.
            Empirical. 0: strips are compared.
        least_aspect: second by first principal extent of what is compared, for the same reason. Empirical. 0: rails are
            compared.
        least_bend: second of the `observability` of what is compared, at least: a flat patch, too, fits everywhere.
            Empirical. 0: patches are compared.
        fewest: points, at least, of what is compared. Empirical. 0: clusters of a few points, which fit anything, are.
        most_pairs: number of pairs that are registered, at most, the most similar in extent and count first: a bound on
            the time. 0: none.
        match: how two changes are laid onto each other.
        in_place: motions within a place.
        outline: how an object is slid along its planes to where the outlines agree.
        pairing: how the probability is shared among several partners that fit.
    """

    threshold: float = 0.7
    sample: int = 2500
    most_extent_ratio: float = 1.5
    most_count_ratio: float = 5.0
    least_width: float = 5.0
    least_aspect: float = 0.1
    least_bend: float = 0.2
    fewest: int = 40
    most_pairs: int = 24
    match: MatchSettings = MatchSettings()
    in_place: InPlaceSettings = InPlaceSettings()
    outline: OutlineSettings = OutlineSettings()
    pairing: PairingSettings = PairingSettings()


class PairHypothesis(NamedTuple):
    """A disappeared and an appeared change that may be one object.

    Attributes:
        parts: the points of both.
        footings: where either stands, if its support plane is known.
        transform: rigid transform [4, 4] from the one to the other.
        facts: of the match.
        situation: what was known of the motion beforehand.
    """

    parts: Pair[LocalSurface]
    footings: Pair[Footing | None]
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


def with_moved(
    items: tuple[Change, ...],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    noise: float,
    settings: MovedSettings = MovedSettings(),
) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """The changes, where those that are one object have become a pair that "moved", each with all its points.

    An object that was turned or shifted within its place is one pair in place of its slivers, and its labels grow to
    the points that look unchanged; only in clouds of one resolution. A disappeared and an appeared change that fit each
    other become a pair as they are.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the clouds, or -1.
        pair: both clouds, registered.
        noise: standard deviation of the offset between local means of one surface: the registration error of
            `DetectionLimits`.
        settings: which changes are one object.

    Returns:
        The changes, most probable first, and the labels that refer to them.
    """
    if not items:
        return items, labels
    clouds = pair.working.clouds
    working = each(lambda own, cloud: cloud.of_working_points(own), labels, clouds)
    # Motions within a place were learned from clouds of one resolution: in voxels of local size what an object hides
    # passes for a part of it.
    if not any(cloud.sizes is not None for cloud in clouds):
        items, working = _with_united(items, working, pair, noise, settings)
    hypotheses = pair_hypotheses(items, working, pair.surfaces, noise, settings)
    for (i, j), probability in _partners(hypotheses, settings).items():
        found = hypotheses[i, j]
        transform = aligned_outlines(found.parts, found.transform, settings.outline)
        items = _joined(items, i, j, transform, probability)
    items, working = most_probable_first(items, working)
    return items, each(lambda own, cloud: own[cloud.member], working, clouds)


def place_hypotheses(
    items: Sequence[Change],
    labels: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    noise: float,
    settings: MovedSettings = MovedSettings(),
) -> list[PlaceHypothesis]:
    """The groups of adjacent changes that one motion within a place may explain.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the surfaces, or -1.
        surfaces: of both clouds, registered.
        noise: of `with_moved`.
        settings: how the motions are found.
    """
    spacing = max(surface.nearest_distance for surface in surfaces)
    points = [np.concatenate([*_points_of([index], surfaces, labels)]) for index in range(len(items))]
    found = []
    for group in adjacent_groups(points, spacing, settings.in_place):
        motion = motion_in_place(_members(group, labels), surfaces, noise, settings.match, settings.in_place)
        if motion is not None:
            facts = match_facts(motion.match, motion.parts, noise, motion.explained)
            found.append(PlaceHypothesis(group, motion, facts))
    return found


def pair_hypotheses(
    items: Sequence[Change],
    labels: Pair[Int[np.ndarray, " _"]],
    surfaces: Pair[LocalSurface],
    noise: float,
    settings: MovedSettings = MovedSettings(),
) -> dict[tuple[int, int], PairHypothesis]:
    """The best match of each disappeared with each appeared change, as far as they are compared.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the surfaces, or -1.
        surfaces: of both clouds, registered.
        noise: of `with_moved`.
        settings: which changes are compared, and how.
    """
    gone = [index for index, change in enumerate(items) if change.kind == "disappeared"]
    new = [index for index, change in enumerate(items) if change.kind == "appeared"]
    if not gone or not new:
        return {}
    parts = {index: _part(surfaces.before, labels.before == index, settings) for index in gone}
    parts |= {index: _part(surfaces.after, labels.after == index, settings) for index in new}
    parts = {index: part for index, part in parts.items() if _distinctive(part, surfaces, settings)}
    if not parts:
        return {}
    background = np.concatenate([*each(lambda surface, own: surface.points[own < 0], surfaces, labels)])
    footings = _footings(parts, gone, surfaces, background, noise, settings.match)
    hypotheses = {}
    for i, j in _similar_pairs(items, [i for i in gone if i in parts], [j for j in new if j in parts], settings):
        both, stand = Pair(parts[i], parts[j]), Pair(footings[i], footings[j])
        match = best_match(both, surfaces, noise, stand, settings.match)
        if match is not None:
            situation: Situation = "standing" if match.upright else "free"
            hypotheses[i, j] = PairHypothesis(both, stand, match.transform, match_facts(match, both, noise), situation)
    return hypotheses


def sigmoid(log_odds: float) -> float:
    """The probability of these log odds."""
    return float(1 / (1 + np.exp(-log_odds)))


def _members(group: Sequence[int], labels: Pair[Int[np.ndarray, " _"]]) -> Pair[Int[np.ndarray, " _"]]:
    """The indices of the points of some changes, in either cloud."""
    return labels.map(lambda own: np.flatnonzero(np.isin(own, group)))


def _points_of(
    group: Sequence[int], surfaces: Pair[LocalSurface], labels: Pair[Int[np.ndarray, " _"]]
) -> Pair[Float64[np.ndarray, "_ 3"]]:
    return each(lambda surface, own: surface.points[own], surfaces, _members(group, labels))


def _part(scene: LocalSurface, own: Bool[np.ndarray, " n"], settings: MovedSettings) -> LocalSurface:
    points = scene.points[own]
    return LocalSurface.of(points[evenly_chosen(len(points), settings.sample)])


def _footings(
    parts: Mapping[int, LocalSurface],
    gone: Container[int],
    surfaces: Pair[LocalSurface],
    background: Float64[np.ndarray, "n 3"],
    noise: float,
    settings: MatchSettings,
) -> dict[int, Footing | None]:
    """Where each object stands; None where its support plane was not observed."""
    planes = support_planes(list(parts.values()), background, noise, settings.upright.support)
    found: dict[int, Footing | None] = {}
    for (index, part), plane in zip(parts.items(), planes, strict=True):
        scene = surfaces.before if index in gone else surfaces.after
        found[index] = None if plane is None else Footing.of(part, scene, plane, noise, settings.bare)
    return found


def _distinctive(part: LocalSurface, surfaces: Pair[LocalSurface], settings: MovedSettings) -> bool:
    """Whether there are enough points, and they are neither a strip nor a flat patch."""
    spacing = max(surface.nearest_distance for surface in surfaces)
    longest, width, _ = principal_extents(part.points)
    wide = width >= max(settings.least_width * spacing, settings.least_aspect * longest)
    return bool(wide and len(part) >= settings.fewest and observability(part)[1] >= settings.least_bend)


def _similar_pairs(
    items: Sequence[Change], gone: Sequence[int], new: Sequence[int], settings: MovedSettings
) -> list[tuple[int, int]]:
    """The pairs of similar extent and number of points, the most similar first, as many as are registered."""
    unlike: dict[tuple[int, int], float] = {}
    tiny = np.finfo(np.float64).tiny
    for i, j in ((i, j) for i in gone for j in new):
        extents = np.abs(np.subtract(*(np.log(np.maximum(items[k].box.extent, tiny)) for k in (i, j))))
        counts = abs(np.log(items[i].point_count / items[j].point_count))
        if extents[0] <= np.log(settings.most_extent_ratio) and counts <= np.log(settings.most_count_ratio):
            unlike[i, j] = float(extents[0] + extents[1] + counts)
    return sorted(unlike, key=lambda pair: unlike[pair])[: settings.most_pairs]


def _partners(
    hypotheses: dict[tuple[int, int], PairHypothesis], settings: MovedSettings
) -> dict[tuple[int, int], float]:
    """The pairs that are one object, and their probabilities; each change is in one pair at most."""
    gone, new = (sorted({pair[side] for pair in hypotheses}) for side in (0, 1))
    table = np.full((len(gone), len(new)), -np.inf)
    for (i, j), found in hypotheses.items():
        table[gone.index(i), new.index(j)] = shipped_model().log_odds(found.facts, found.situation)
    probabilities = pairing_probabilities(table, settings.pairing)
    best = (probabilities >= probabilities.max(axis=0, initial=0.0)) & (
        probabilities >= probabilities.max(axis=1, initial=0.0)[:, None]
    )
    rows, columns = np.nonzero(best & (probabilities >= settings.threshold))
    return {
        (gone[row], new[column]): float(probabilities[row, column]) for row, column in zip(rows, columns, strict=True)
    }


def _joined(
    items: tuple[Change, ...], i: int, j: int, transform: Float64[np.ndarray, "4 4"], probability: float
) -> tuple[Change, ...]:
    """The changes, of which two are each other's partner."""
    partner = {i: j, j: i}
    return tuple(
        dataclasses.replace(
            item, kind="moved", partner=partner[index], transform=transform, moved_probability=probability
        )
        if index in partner
        else item
        for index, item in enumerate(items)
    )


def _with_united(
    items: tuple[Change, ...],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    noise: float,
    settings: MovedSettings,
) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """The changes, where every group that one motion within its place explains has become a moved object."""
    absorbed: set[int] = set()
    hypotheses = place_hypotheses(items, labels, pair.surfaces, noise, settings)
    odds = [shipped_model().log_odds(found.facts, "in place") for found in hypotheses]
    for index in sorted(range(len(hypotheses)), key=lambda index: -odds[index]):
        probability, found = sigmoid(odds[index]), hypotheses[index]
        if probability < settings.threshold or not absorbed.isdisjoint(found.group):
            continue
        group = [*found.group, *_within(found, items, labels, absorbed)]
        transform = found.motion.match.transform
        if not found.motion.hinged:
            transform = aligned_outlines(found.motion.parts, transform, settings.outline)
        items, labels = _united(items, labels, pair, found._replace(group=group), probability, transform)
        absorbed.update(group)
    return reordered(items, labels, [index for index in range(len(items)) if index not in absorbed])


def _within(
    found: PlaceHypothesis, items: Sequence[Change], labels: Pair[Int[np.ndarray, " _"]], absorbed: Container[int]
) -> list[int]:
    """The other changes most of whose points are the object's: slivers that are no neighbours of the group's."""
    own = np.concatenate([*each(lambda label, members: label[members], labels, found.motion.members)])
    counts = np.bincount(own[own >= 0], minlength=len(items))
    totals = np.bincount(np.concatenate([own[own >= 0] for own in labels]), minlength=len(items))
    taken = {*found.group, *(index for index, item in enumerate(items) if item.kind == "moved")}
    return [
        index
        for index in range(len(items))
        if index not in taken and index not in absorbed and 2 * counts[index] > totals[index]
    ]


def _united(
    items: tuple[Change, ...],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    found: PlaceHypothesis,
    probability: float,
    transform: Float64[np.ndarray, "4 4"],
) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """The changes with one more moved object, whose labels replace those of a group and grow to all its points."""
    group = [items[index] for index in found.group]
    largest = max(group, key=lambda item: item.point_count)
    most_probable, significance = (
        max(getattr(item, name) for item in group) for name in ("probability", "significance")
    )

    def own_points(label: np.ndarray, members: np.ndarray) -> np.ndarray:
        own = np.isin(label, found.group)
        own[members] |= label[members] < 0
        return own

    def change(points: np.ndarray, cloud: WorkingCloud, own: np.ndarray, label: np.ndarray) -> Change:
        # Where nothing but the motion says that there is a change, it is as probable as the motion.
        share = 1.0 if np.isin(label, found.group).any() else probability
        whole = change_of(points[own[cloud.member]], "moved", share * most_probable, significance)
        return dataclasses.replace(whole, explanation=largest.explanation)

    own = each(own_points, labels, found.motion.members)
    changes = each(change, pair.points, pair.working.clouds, own, labels)
    first = len(items)
    numbered: Pair[np.ndarray] = each(
        lambda label, mine, number: np.asarray(np.where(mine, number, label)), labels, own, Pair(first, first + 1)
    )
    united = (*items, changes.before, changes.after)
    return _joined(united, first, first + 1, transform, probability), numbered
