"""The stage that puts the candidates to the evidence: what the other survey knows of the places where they are."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits
from gmmjax.changes.evidence.continuation import unobserved_points
from gmmjax.changes.evidence.free_space import Observed, Survey, observation
from gmmjax.changes.evidence.support_planes import supports
from gmmjax.geometry.density_clusters import density_clusters
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class EvidenceSettings:
    """When a candidate is a change.

    Attributes:
        needed: whether there must be evidence. False: all candidates are changes.
        thin_offset: an offset of this fraction of its limit is evidence of a change where the other survey saw the
            surface.
        least_free: with views: number of a candidate's points, at least, whose places the other survey saw to be empty.
        least_free_share: and this fraction of what it observed of the candidate,
        least_free_of_all: and this fraction of all of it.
        least_thin_of_all: the same for a thin change, which is empty only by its offset: the rims of half seen objects
            are off the surface, too.
        most_continued: without views: a candidate that continues unchanged surfaces with more than this fraction of its
            points is none.
        same_surface: an unchanged surface is at most this fraction of the limit of the offset apart in the two clouds.
        smallest_piece: number of points of a part of a candidate that is judged by itself, at least,
        share_of_piece: and its fraction of the candidate.
        cluster_radius: of such parts, in spacings (the radius of DBSCAN).
        cluster_neighbours: the minimum of DBSCAN.
    """

    needed: bool = True
    thin_offset: float = 0.8
    least_free: int = 10
    least_free_share: float = 0.5
    least_free_of_all: float = 0.1
    least_thin_of_all: float = 0.35
    most_continued: float = 0.6
    same_surface: float = 0.5
    smallest_piece: int = 100
    share_of_piece: float = 0.15
    cluster_radius: float = 5.0
    cluster_neighbours: int = 8


class Examined(NamedTuple):
    """The candidates of one cloud that the evidence left.

    Attributes:
        labels: -1, or the number of the candidate.
        probability: for each restart, that the point is changed; 0 where nothing is known.
        unobserved: whether the other survey did not see the point's place.
    """

    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, "r n"]
    unobserved: Bool[np.ndarray, " n"]

    def without(self, unobserved: Bool[np.ndarray, " n"]) -> "Examined":
        """Without candidates that were found to be unobserved."""
        labels = renumbered(np.where(unobserved, -1, self.labels))
        return Examined(labels, np.where(unobserved, 0.0, self.probability), self.unobserved | unobserved)


def examined(
    candidates: Pair[Candidates],
    surveys: Pair[Survey],
    limits: DetectionLimits,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Pair[Examined]:
    """The candidates of both clouds that are changes, and what was not observed.

    Args:
        candidates: of both clouds.
        surveys: the same clouds, with their views where they are known.
        limits: of distances and offsets.
        settings: when a candidate is a change.
    """
    found = each(lambda own, other: _examined_cloud(own, other, limits, settings), candidates, surveys.swapped)
    if not settings.needed:
        return found
    points, labels = candidates.map(lambda own: own.points), found.map(lambda own: own.labels)
    under = supports(points, labels, limits.spacing)
    # With the views of the other survey it is known what was covered.
    return each(
        lambda own, other, support: own.without(support) if other.views is None else own, found, surveys.swapped, under
    )


def _examined_cloud(own: Candidates, other: Survey, limits: DetectionLimits, settings: EvidenceSettings) -> Examined:
    labels, unobserved = own.labels, np.zeros(len(own.labels), bool)
    if settings.needed:
        rejected, unobserved = without_evidence(own, other, limits, settings)
        labels = np.where(rejected, -1, labels)
    probability = np.where((labels < 0) & unobserved, 0.0, own.probability)
    return Examined(renumbered(labels), probability, unobserved & (labels < 0))


def without_evidence(
    own: Candidates, other: Survey, limits: DetectionLimits, settings: EvidenceSettings = EvidenceSettings()
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """The points of the candidates that do not lie where the other survey looked, and all points that it did not see.

    Args:
        own: the candidates of one cloud.
        other: the other cloud, with its views where they are known.
        limits: of distances and offsets.
        settings: when a candidate is a change.
    """
    if other.views is None:
        unobserved = continuing(own.points, own.labels, other.points, limits, settings)
        return unobserved, unobserved
    observed = observation(own.points, other, limits.distance)
    rejected = not_seen_empty(own, observed, other.points, limits, settings)
    hidden = hidden_parts(own.points, np.where(rejected, -1, own.labels), observed, limits, settings)
    shadows = continuing(own.points, hidden, other.points, limits, settings)
    return rejected | shadows, (observed == Observed.unobserved) | rejected


def not_seen_empty(
    own: Candidates,
    observed: Int8[np.ndarray, " n"],
    other: Float[np.ndarray, "m 3"],
    limits: DetectionLimits,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Bool[np.ndarray, " n"]:
    """The points of the segments whose place the other survey did not see to be empty.

    A place is empty where the survey looked through it. A thin object is too near to the surface behind it for that:
    there the survey saw a surface that is off this one, and the segment must not continue the surfaces beside it.
    """
    labels = own.labels
    offset = own.difference.offset > settings.thin_offset * limits.local_offset(own.difference)
    free = observed == Observed.free
    thin = free | ((observed == Observed.surface) & offset)
    seen = observed != Observed.unobserved
    through = _mostly(free, seen, labels, settings.least_free_of_all, settings)
    off = _mostly(thin, seen, np.where(np.isin(labels, through), -1, labels), settings.least_thin_of_all, settings)
    thin_labels = np.where(np.isin(labels, off), labels, -1)
    thin_ones = (thin_labels >= 0) & ~continuing(own.points, thin_labels, other, limits, settings)
    return (labels >= 0) & ~np.isin(labels, through) & ~thin_ones


def _mostly(
    empty: np.ndarray, seen: np.ndarray, labels: np.ndarray, least_of_all: float, settings: EvidenceSettings
) -> list[int]:
    """The candidates of which enough is empty: of what was observed of each, and of all of it."""

    def enough(own: np.ndarray) -> bool:
        least = max(settings.least_free, settings.least_free_share * seen[own].sum(), least_of_all * own.sum())
        return bool(empty[own].sum() >= least)

    return [int(label) for label in np.unique(labels[labels >= 0]) if enough(labels == label)]


def hidden_parts(
    points: Float[np.ndarray, "n 3"],
    labels: Int[np.ndarray, " n"],
    observed: Int8[np.ndarray, " n"],
    limits: DetectionLimits,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Int[np.ndarray, " n"]:
    """The parts of the segments that the other survey did not see, as segments of their own.

    The hidden side of an object belongs to it; a shadow on the wall behind it does not.
    """
    parts = np.full(len(labels), -1)
    hidden = np.flatnonzero((labels >= 0) & (observed == Observed.unobserved))
    parts[hidden] = density_clusters(
        points[hidden], settings.cluster_radius * limits.spacing, settings.cluster_neighbours
    )
    return parts


def continuing(
    points: Float[np.ndarray, "n 3"],
    labels: Int[np.ndarray, " n"],
    other: Float[np.ndarray, "m 3"],
    limits: DetectionLimits,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Bool[np.ndarray, " n"]:
    """The points of the segments that only continue the unchanged surfaces beside them.

    An object and its shadow on the wall behind may be one segment: what continues and what does not are judged apart
    where either is a good part of it.
    """
    # What is further off than this is another surface: the top of a thin object does not cover the floor's plane.
    arguments = (labels < 0, other, settings.same_surface * limits.offset, limits.spacing)
    unseen = unobserved_points(points, labels, *arguments)
    whole = _shares(unseen, labels, int(labels.max(initial=-1)) + 1) > settings.most_continued
    pieces, of_segment = _pieces(points, labels, unseen, limits.spacing, settings)
    dropped = (labels >= 0) & whole[labels]
    if not len(of_segment):
        return dropped

    def continued(*, edges: bool) -> Bool[np.ndarray, " p"]:
        unseen = unobserved_points(points, pieces, *arguments, edges=edges)
        return np.asarray(_shares(unseen, pieces, len(of_segment))[:-1] > settings.most_continued)

    of_piece = continued(edges=True)
    # The top of an object, by itself, can look like a wall at the edge of what the other survey saw.
    with_others = of_piece & np.isin(of_segment, of_segment[~of_piece])
    if with_others.any():
        of_piece &= ~with_others | continued(edges=False)
    return np.where(pieces >= 0, np.append(of_piece, False)[pieces], dropped)


def _pieces(
    points: np.ndarray, labels: np.ndarray, unseen: np.ndarray, spacing: float, settings: EvidenceSettings
) -> tuple[np.ndarray, np.ndarray]:
    """The good-sized clusters of the points of each segment that are unseen, and of those that are not."""
    pieces = np.full(len(labels), -1)
    of_segment: list[int] = []
    for label in np.unique(labels[labels >= 0]):
        own = labels == label
        least = max(settings.smallest_piece, settings.share_of_piece * own.sum())
        for part in (np.flatnonzero(own & unseen), np.flatnonzero(own & ~unseen)):
            clusters = density_clusters(points[part], settings.cluster_radius * spacing, settings.cluster_neighbours)
            for number in np.flatnonzero(np.bincount(clusters[clusters >= 0]) >= least):
                pieces[part[clusters == number]] = len(of_segment)
                of_segment.append(int(label))
    return pieces, np.array(of_segment)


def _shares(flags: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """The share of each label's points that are flagged; one more entry, 0, for the label -1."""
    inside = labels >= 0
    points = np.bincount(labels[inside], minlength=count)
    return np.append(np.bincount(labels[inside], flags[inside], count) / np.maximum(points, 1), 0.0)


def renumbered(labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The labels without gaps in their numbers."""
    result = labels.copy()
    result[labels >= 0] = np.unique(labels[labels >= 0], return_inverse=True)[1]
    return result
