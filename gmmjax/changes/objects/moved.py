"""Moved objects: what disappeared here and appeared there is one object when the one can be laid onto the other."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from gmmjax.changes.change import Change
from gmmjax.changes.objects.overlap import Agreement, agreement
from gmmjax.changes.objects.rigid_match import matches_about, rigid_matches, settled_match
from gmmjax.changes.objects.upright import Ground, grounds, standing_motions, stays_standing, top_of
from gmmjax.geometry.local_surface import LocalSurface, evenly_chosen
from gmmjax.pair import Pair, each

# Points of a change that are held against another change.
MOST_POINTS = 4000
# Motions that are judged by few points, and how many of them are settled and judged by more.
MOTIONS, FEW_TESTED = 10, 200
# Of those that keep an object standing more, since partly seen sides fit each other in many turns.
STANDING_MOTIONS = 24
BEST, TESTED = 2, 800
# Where the best motion leaves more of the points contradicted, nothing more is tried.
HOPELESS = 0.3
# Of two motions a contradiction outweighs so many points that are covered, and half a turn so many of them.
CONTRADICTION, HALF_TURN = 4.0, 0.05
# Of two objects a point that is not covered counts this share of one that contradicts.
UNCOVERED = 0.02
# One object: both misfits together are at most this, and at least so much of either lies on the other one.
MOST_MISFIT = 0.07
LEAST_COVERED = 0.45
# Less need be covered where it is known what both stand on; and more may speak against them where their tops have the
# same outline, too, which two objects hardly ever have.
LEAST_COVERED_STANDING = 0.3
MOST_MISFIT_SAME_TOP, LEAST_COVERED_SAME_TOP = 0.3, 0.2
# Grounds agree up to so many of the noises; objects whose tops differ in height by more are not tried.
SAME_HEIGHT, OTHER_HEIGHT = 3.0, 8.0
# Objects whose longest extents or point counts differ by more than this factor are not tried.
MOST_EXTENT_RATIO = 1.4
MOST_COUNT_RATIO = 4.0


class Match(NamedTuple):
    """How well one object can be laid onto another.

    Attributes:
        transform: rigid motion [4, 4] from the first to the second.
        there: how the first one fits the second.
        back: how the second one fits the first.
        standing: whether it brings what the first one stood on onto what the second one stands on.
        same_top: whether both have a top of the same outline and height.
    """

    transform: Float[np.ndarray, "4 4"]
    there: Agreement
    back: Agreement
    standing: bool = False
    same_top: bool = False

    @property
    def limits(self) -> tuple[float, float]:
        """Of one object: the largest misfit, and the least share that lies on the other one."""
        if self.same_top:
            return MOST_MISFIT_SAME_TOP, LEAST_COVERED_SAME_TOP
        if self.standing:
            return MOST_MISFIT, LEAST_COVERED_STANDING
        return MOST_MISFIT, LEAST_COVERED

    @property
    def misfit(self) -> float:
        """What speaks against one object, of both; infinite where too little is covered to tell."""
        if min(self.there.covered, self.back.covered) < self.limits[1]:
            return float("inf")
        return sum(side.contradicted + UNCOVERED * (1 - side.covered) for side in (self.there, self.back))

    @property
    def one_object(self) -> bool:
        """Whether the two are one object."""
        return self.misfit <= self.limits[0]

    @property
    def merit(self) -> float:
        """By which motions are compared: of those that fit a symmetric object, the least turn is meant."""
        turn = Rotation.from_matrix(self.transform[:3, :3]).magnitude() / np.pi
        fits = sum(side.covered - CONTRADICTION * side.contradicted for side in (self.there, self.back))
        return float(fits - HALF_TURN * turn)


def with_moved(
    items: tuple[Change, ...],
    surfaces: Pair[LocalSurface],
    labels: Pair[Int[np.ndarray, " _"]],
    noise: float,
) -> tuple[Change, ...]:
    """The changes, where every pair of a disappeared and an appeared one that are one object has become "moved".

    Args:
        items: the changes of both clouds.
        surfaces: of both clouds, registered.
        labels: the change of each point, or -1.
        noise: standard deviation of the offset between local means of one surface: the registration error of
            `DetectionLimits`.
    """
    gone = [index for index, change in enumerate(items) if change.kind == "disappeared"]
    new = [index for index, change in enumerate(items) if change.kind == "appeared"]
    if not gone or not new:
        return items
    of_gone = {i: _part(surfaces.before, labels.before == i) for i in gone}
    of_new = {j: _part(surfaces.after, labels.after == j) for j in new}
    background = np.concatenate([*each(lambda surface, labels: surface.points[labels < 0], surfaces, labels)])
    ground = dict(zip([*gone, *new], grounds([*of_gone.values(), *of_new.values()], background, noise), strict=True))
    matches: dict[tuple[int, int], Match] = {}
    for i, j in ((i, j) for i in gone for j in new if _alike(items[i], items[j])):
        match = best_match(Pair(of_gone[i], of_new[j]), surfaces, noise, Pair(ground[i], ground[j]))
        if match is not None and match.one_object:
            matches[i, j] = match
    moved = list(items)
    for i, j in _partners({pair: match.misfit for pair, match in matches.items()}):
        transform = matches[i, j].transform
        moved[i] = dataclasses.replace(items[i], kind="moved", partner=j, transform=transform)
        moved[j] = dataclasses.replace(items[j], kind="moved", partner=i, transform=transform)
    return tuple(moved)


def _part(scene: LocalSurface, own: Bool[np.ndarray, " n"]) -> LocalSurface:
    points = scene.points[own]
    return LocalSurface.of(points[evenly_chosen(len(points), MOST_POINTS)])


def _partners(misfits: dict[tuple[int, int], float]) -> list[tuple[int, int]]:
    """Of the pairs that may be one object as many as can be, and of those the best; each change is in one at most."""
    gone, new = (sorted({pair[side] for pair in misfits}) for side in (0, 1))
    table = np.array([[misfits.get((i, j), 1.0) for j in new] for i in gone]).reshape(len(gone), len(new))
    assigned = [(gone[row], new[column]) for row, column in zip(*linear_sum_assignment(table), strict=True)]
    return [pair for pair in assigned if pair in misfits]


def _alike(gone: Change, new: Change) -> bool:
    extents = np.array([gone.box.extent[0], new.box.extent[0]])
    counts = np.array([gone.point_count, new.point_count])
    return bool(extents.max() <= MOST_EXTENT_RATIO * extents.min() and counts.max() <= MOST_COUNT_RATIO * counts.min())


def best_match(
    parts: Pair[LocalSurface],
    surfaces: Pair[LocalSurface],
    noise: float,
    stood_on: Pair[Ground | None] = Pair(None, None),
) -> Match | None:
    """The motion that lays what is gone best onto what is new.

    Where it is known what both stand on, only motions that keep the object standing are tried: things are put down on
    the side that they stood on, and two different boxes can often be laid onto each other when one may be tilted or
    sunk into the floor.

    Args:
        parts: what is gone of the before cloud, and what is new of the after cloud.
        surfaces: of both clouds, registered.
        noise: of `with_moved`.
        stood_on: what either stands on, where that is known.

    Returns:
        The match; None where no motion keeps the object standing.
    """
    motions, standing, same_top = _motions(parts, noise, stood_on)
    if not motions:
        return None
    matches = [_match(parts, motion, surfaces, noise, FEW_TESTED) for motion in motions]
    matches.sort(key=lambda match: match.merit, reverse=True)
    if min(matches[0].there.contradicted, matches[0].back.contradicted) > HOPELESS:
        return matches[0]
    settled = [settled_match(*parts, match.transform, noise) for match in matches[:BEST]]
    judged = [_match(parts, motion, surfaces, noise, TESTED) for motion in settled]
    best = max(judged, key=lambda match: match.merit)
    return best._replace(standing=standing, same_top=same_top)


def _motions(
    parts: Pair[LocalSurface], noise: float, stood_on: Pair[Ground | None]
) -> tuple[list[Float[np.ndarray, "4 4"]], bool, bool]:
    """The motions that are tried, whether they keep the object standing, and whether both have the same top."""
    first, second = stood_on
    if first is None or second is None:
        return rigid_matches(*parts, noise, MOTIONS), False, False
    tops = top_of(parts.before, first, noise), top_of(parts.after, second, noise)
    same_top = False
    if tops[0] is not None and tops[1] is not None:
        if abs(tops[0].height - tops[1].height) > OTHER_HEIGHT * noise:
            return [], True, False
        same_top = tops[0].like(tops[1], noise)
    middle, reach = parts.after.points.mean(axis=0), SAME_HEIGHT * noise
    found = matches_about(*parts, standing_motions(*parts, first, second), noise, STANDING_MOTIONS)
    return [motion for motion in found if stays_standing(motion, first, second, middle, reach)], True, same_top


def _match(
    parts: Pair[LocalSurface], motion: np.ndarray, surfaces: Pair[LocalSurface], noise: float, tested: int
) -> Match:
    there = agreement(parts.before.moved(motion), parts.after, surfaces.after, noise, tested)
    back = agreement(parts.after.moved(np.linalg.inv(motion)), parts.before, surfaces.before, noise, tested)
    return Match(motion, there, back)
