"""Surfaces that were displaced: one change, which both clouds show.

Eroded ground is gone from where it was, and is where it had not been. Each cloud is examined by itself, and shows it
beside other things: one with the shadows of its own sensors. A sensor that sees a surface farther off looks through the
place where the other survey has it: the two are one event, and have one probability. Not so what lies behind a
displaced surface, which is hidden: the floor below a board is still there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits
from gmmjax.changes.evidence.displacements import Displacements, DisplacementSettings
from gmmjax.changes.evidence.examination import Examined
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.explanation import Explanation
from gmmjax.changes.signed_distance import CorePoints
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


def pair_displaced_surfaces(
    found: Pair[Examined],
    candidates: Pair[Candidates],
    surveys: Pair[ScanVisibility],
    limits: DetectionLimits,
    smallest: int = 10,
    settings: DisplacementSettings = DisplacementSettings(),
) -> Pair[Examined]:
    """The changes, with the place in the other cloud of every surface that was displaced.

    A change is a displaced surface where most of its points are surely off a surface of the other cloud that lies
    opposite them. What lies opposite these, is as surely off them, and is in front of them, as their sensor sees it, is
    its other place, whatever the verdict on the candidate of the other cloud that it is a part of: it may be that
    candidate's smaller part. Points of other changes stay theirs.

    Args:
        found: the candidates of both clouds that are changes.
        candidates: the candidates.
        surveys: the same clouds.
        limits: of distances and offsets.
        smallest: number of points of such a place, at least. 1: the crumbs between other changes are changes, too.
        settings: what lies opposite a point, and when it is off.
    """
    surfaces = surveys.map(lambda survey: survey.surface)

    def displaced(own: Candidates, other: LocalSurface) -> Bool[np.ndarray, " n"]:
        result, rows = np.zeros(len(own.labels), bool), np.flatnonzero(own.labels >= 0)
        displacements = Displacements.of(own.points[rows], other, limits, settings)
        result[rows] = displacements.sure(limits.offset_errors(own.difference)[rows], settings)
        return result

    off = each(displaced, candidates, surfaces.swapped)
    moved = each(_displaced_surfaces, found, off)
    places = each(_places_of, found, off, surfaces, moved.swapped, surveys.swapped)
    return each(_with, found, places.map(lambda own: own.of_at_least(smallest)), found.swapped)


class _Places(NamedTuple):
    """Points of one cloud that are the places of displaced surfaces of the other one.

    Attributes:
        rows: of the points.
        change: of the other cloud that each is the place of.
    """

    rows: Int[np.ndarray, " m"]
    change: Int[np.ndarray, " m"]

    def of_at_least(self, smallest: int) -> "_Places":
        """Those of as many points."""
        large = np.bincount(self.change, minlength=1)[self.change] >= smallest
        return _Places(self.rows[large], self.change[large])


def _displaced_surfaces(found: Examined, displaced: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """For each displaced point of a change that is a displaced surface its number, -1 for all others."""
    of_changes = found.labels >= 0
    counts = np.bincount(found.labels[of_changes], minlength=len(found.probability))
    off = np.bincount(found.labels[of_changes & displaced], minlength=len(found.probability))
    surfaces = np.append(2 * off > counts, False)
    return np.where(displaced & surfaces[found.labels], found.labels, -1)


def _places_of(
    found: Examined,
    displaced: Bool[np.ndarray, " n"],
    surface: LocalSurface,
    surfaces_of_other: Int[np.ndarray, " m"],
    other: ScanVisibility,
) -> _Places:
    """The displaced points of no change that lie in front of displaced surfaces of the other cloud."""
    rows = np.flatnonzero(displaced & (found.labels < 0))
    if not len(rows):
        return _Places(rows, rows)
    there = other.surface.nearest(surface.points[rows])
    behind = CorePoints.of(other.surface, other.towards, there)
    in_front = ((surface.points[rows] - behind.points) * behind.normals).sum(axis=1) > 0
    change = np.where(in_front, surfaces_of_other[there], -1)
    return _Places(rows[change >= 0], change[change >= 0])


def _with(found: Examined, places: _Places, other: Examined) -> Examined:
    """The changes of one cloud with the places of surfaces of the other one, each of which is a change of its own."""
    if not len(places.rows):
        return found
    labels, changes = found.labels.copy(), np.unique(places.change)
    labels[places.rows] = len(found.probability) + np.searchsorted(changes, places.change)
    rejected = list[tuple[Int[np.ndarray, " _"], Explanation]]()
    for rows, why in found.rejected:
        left = rows[labels[rows] < 0]
        if len(left):
            rejected.append((left, why))
    probability: Float[np.ndarray, " c"] = np.concatenate([found.probability, other.probability[changes]])
    explanations = (*found.explanations, *(other.explanations[change] for change in changes))
    unobserved = found.unobserved & (labels < 0)
    return Examined(labels, probability, found.looks_changed, unobserved, explanations, tuple(rejected))
