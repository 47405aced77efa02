"""Moved objects: what disappeared here and appeared there is one object when the one can be laid onto the other."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from gmmjax.changes.agreement import Agreement, agreement, evenly_chosen
from gmmjax.changes.change import Change
from gmmjax.changes.free_space import Survey
from gmmjax.changes.rigid_match import rigid_matches, settled_match
from gmmjax.changes.settling import moved_points

# Points of a change that are held against another change.
MOST_POINTS = 4000
# Motions that are judged, and how many of them with the views.
MOTIONS, WITH_VIEWS = 6, 2
# By so many points at first, and in the end.
FEW_TESTED, TESTED = 200, 800
# Where the best motion leaves more of the points contradicted, nothing more is tried.
HOPELESS = 0.3
# A contradiction weighs so many points that are covered.
CONTRADICTION = 2.0
# And half a turn so many.
HALF_TURN = 0.05
# One object: at least so much of what says anything, and so much of all, of either lies on the other one. Without
# views more is taken for seen than was, and contradicts.
LEAST_SHARE = 0.965
LEAST_SHARE_WITHOUT_VIEWS = 0.93
LEAST_COVERED = 0.45
# Objects whose longest extents or point counts differ by more than this factor are not tried.
MOST_EXTENT_RATIO = 1.4
MOST_COUNT_RATIO = 4.0


class Match(NamedTuple):
    """How well one object can be laid onto another.

    Attributes:
        transform: rigid motion [4, 4] from the first to the second.
        there: how the first one fits the second.
        back: how the second one fits the first.
    """

    transform: Float[np.ndarray, "4 4"]
    there: Agreement
    back: Agreement

    @property
    def share(self) -> float:
        """The lesser of both shares; 0 where too little is covered to tell."""
        enough = min(self.there.covered, self.back.covered) >= LEAST_COVERED
        return min(self.there.share, self.back.share) if enough else 0.0

    @property
    def merit(self) -> float:
        """By which motions are compared: of those that fit a symmetric object, the least turn is meant."""
        turn = Rotation.from_matrix(self.transform[:3, :3]).magnitude() / np.pi
        fits = sum(side.covered - CONTRADICTION * side.contradicted for side in (self.there, self.back))
        return float(fits - HALF_TURN * turn)


def with_moved(
    items: tuple[Change, ...],
    before: Survey,
    after: Survey,
    labels_before: Int[np.ndarray, " n0"],
    labels_after: Int[np.ndarray, " n1"],
    noise: float,
) -> tuple[Change, ...]:
    """The changes, where every pair of a disappeared and an appeared one that are one object has become "moved".

    Args:
        items: the changes of both clouds.
        before: the before cloud.
        after: the after cloud, aligned to it.
        labels_before: the change of each point of the before cloud, or -1.
        labels_after: the same for the after cloud.
        noise: standard deviation of the offset between local means of one surface, as in `DifferenceScale`.
    """
    gone = [index for index, change in enumerate(items) if change.kind == "disappeared"]
    new = [index for index, change in enumerate(items) if change.kind == "appeared"]
    if not gone or not new:
        return items
    matches = {
        (i, j): best_match(before.points[labels_before == i], after.points[labels_after == j], before, after, noise)
        for i in gone
        for j in new
        if _alike(items[i], items[j])
    }
    least = LEAST_SHARE_WITHOUT_VIEWS if before.views is None or after.views is None else LEAST_SHARE
    moved = list(items)
    for i, j in _partners({pair: match.share for pair, match in matches.items() if match.share >= least}):
        transform = matches[i, j].transform
        moved[i] = dataclasses.replace(items[i], kind="moved", partner=j, transform=transform)
        moved[j] = dataclasses.replace(items[j], kind="moved", partner=i, transform=transform)
    return tuple(moved)


def _partners(shares: dict[tuple[int, int], float]) -> list[tuple[int, int]]:
    """Of the pairs that may be one object those that fit best together, each change in one pair at the most."""
    gone, new = (sorted({pair[side] for pair in shares}) for side in (0, 1))
    table = np.array([[shares.get((i, j), 0.0) for j in new] for i in gone]).reshape(len(gone), len(new))
    assigned = [(gone[row], new[column]) for row, column in zip(*linear_sum_assignment(-table), strict=True)]
    return [pair for pair in assigned if pair in shares]


def _alike(gone: Change, new: Change) -> bool:
    extents = np.array([gone.box.extent[0], new.box.extent[0]])
    counts = np.array([gone.points, new.points])
    return bool(extents.max() <= MOST_EXTENT_RATIO * extents.min() and counts.max() <= MOST_COUNT_RATIO * counts.min())


def best_match(
    gone: Float[np.ndarray, "n 3"], new: Float[np.ndarray, "m 3"], before: Survey, after: Survey, noise: float
) -> Match:
    """The motion that lays what is gone best onto what is new.

    Args:
        gone: points of the before cloud.
        new: points of the after cloud.
        before: the before cloud.
        after: the after cloud, aligned to it.
        noise: of `with_moved`.
    """
    gone, new = evenly_chosen(gone, MOST_POINTS), evenly_chosen(new, MOST_POINTS)
    motions = rigid_matches(gone, new, noise, MOTIONS)
    surveys = before, after
    without_views = dataclasses.replace(before, views=None), dataclasses.replace(after, views=None)
    matches = [_match(gone, new, motion, without_views, noise, FEW_TESTED) for motion in motions]
    matches.sort(key=lambda match: match.merit, reverse=True)
    if min(matches[0].there.contradicted, matches[0].back.contradicted) > HOPELESS:
        return matches[0]
    settled = [settled_match(gone, new, match.transform, noise) for match in matches[:WITH_VIEWS]]
    judged = [_match(gone, new, motion, surveys, noise, TESTED) for motion in settled]
    return max(judged, key=lambda match: match.merit)


def _match(
    gone: np.ndarray, new: np.ndarray, motion: np.ndarray, surveys: tuple[Survey, Survey], noise: float, tested: int
) -> Match:
    there = agreement(moved_points(gone, motion), new, surveys[1], noise, tested)
    back = agreement(moved_points(new, np.linalg.inv(motion)), gone, surveys[0], noise, tested)
    return Match(motion, there, back)
