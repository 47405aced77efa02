"""The evidence stage: a candidate is a change only where the other survey observed its place to be different."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits
from gmmjax.changes.evidence.continuation import ContinuationSettings, unobserved_points
from gmmjax.changes.evidence.coverage_edge import ReferenceSurfaces
from gmmjax.changes.evidence.free_space import FreeSpaceSettings, Observed, Survey, observation
from gmmjax.changes.evidence.support_planes import SupportSettings, supports
from gmmjax.changes.evidence.view_checks import ViewCheckSettings
from gmmjax.changes.explanation import Explanation
from gmmjax.geometry import density_clusters
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class EvidenceSettings:
    """When a candidate is a change.

    Attributes:
        thin_offset: fraction of the limit of the offset above which an offset is evidence where the other survey
            observed a surface: of objects too thin for free space. Smaller: the noise is evidence; larger: the lower
            part of a thin object is none.
        least_free: with views: number of a candidate's points in free space of the other survey, at least. 0: a single
            point may decide.
        least_free_share: and their fraction of the candidate's points that it observed. 0: what is off by noise and
            registration error is a change; 1: no candidate may touch an unchanged surface.
        least_free_of_all: and their fraction of all of the candidate's points. 0: the rim of an occluded surface makes
            it a change.
        least_thin_of_all: the same for a thin change, which is empty only by its offset: the rims of half observed
            objects are off the surface, too.
        most_continued: without views: a candidate with more than this fraction of its points on continuations of
            unchanged surfaces is rejected. 1: none is.
        same_surface: largest offset of an unchanged surface in the two clouds, as a fraction of the limit of the
            offset. Larger: the top of a thin object covers the plane of the floor.
        smallest_piece: number of points of a part of a candidate that is judged by itself, at least; an object and its
            shadow may be one candidate. Smaller: parts are judged by their noise.
        share_of_piece: and its fraction of the candidate. 1: candidates are judged as a whole.
        cluster_radius: of such parts, in spacings (the radius of DBSCAN). Smaller: the gaps between points split them.
        cluster_neighbours: the minimum of DBSCAN, the point itself counted. 1: outliers connect parts.
        continuation: without views, which points continue unchanged surfaces.
        support: without views, which candidates are only the support planes of others.
        free_space: with views, what the points of a survey occlude.
        view_checks: from when on views contradict their cloud.
    """

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
    continuation: ContinuationSettings = ContinuationSettings()
    support: SupportSettings = SupportSettings()
    free_space: FreeSpaceSettings = FreeSpaceSettings()
    view_checks: ViewCheckSettings = ViewCheckSettings()


class Rejected(NamedTuple):
    """A candidate of one cloud that there is no evidence for.

    Attributes:
        points: whether each point of the cloud is one of its points.
        explanation: the verdict on it.
    """

    points: Bool[np.ndarray, " n"]
    explanation: Explanation


class Examined(NamedTuple):
    """The candidates of one cloud that there is evidence for, and those that there is none for.

    Attributes:
        labels: -1, or the number of the candidate.
        probability: for each restart, that the point is changed; 0 where it is unobserved.
        unobserved: whether the other survey did not observe the point's place.
        explanations: the verdict on each candidate; empty where there was none.
        rejected: the others, with the verdict on each.
    """

    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, "r n"]
    unobserved: Bool[np.ndarray, " n"]
    explanations: tuple[Explanation, ...] = ()
    rejected: tuple[Rejected, ...] = ()

    def without(self, unobserved: Bool[np.ndarray, " n"]) -> "Examined":
        """Without these points, which the other survey did not observe."""
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
    points, labels = candidates.map(lambda own: own.points), found.map(lambda own: own.labels)
    support_planes = supports(points, labels, limits.spacing, settings.support)
    # With the views of the other survey it is known what was occluded.
    return each(
        lambda own, other, support: own.without(support) if other.views is None else own,
        found,
        surveys.swapped,
        support_planes,
    )


def unexamined(candidates: Pair[Candidates]) -> Pair[Examined]:
    """All candidates, where no evidence is asked for; nothing is known of what was observed.

    Args:
        candidates: of both clouds.
    """
    return candidates.map(
        lambda own: Examined(renumbered(own.labels), own.probability, np.zeros(len(own.labels), bool))
    )


def _examined_cloud(own: Candidates, other: Survey, limits: DetectionLimits, settings: EvidenceSettings) -> Examined:
    rejected, unobserved = without_evidence(own, other, limits, settings)
    labels = np.where(rejected, -1, own.labels)
    probability = np.where((labels < 0) & unobserved, 0.0, own.probability)
    return Examined(renumbered(labels), probability, unobserved & (labels < 0))


def without_evidence(
    own: Candidates, other: Survey, limits: DetectionLimits, settings: EvidenceSettings = EvidenceSettings()
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """The points of candidates without evidence, and all points whose place the other survey did not observe.

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
    occluded = continuing(own.points, hidden, other.points, limits, settings)
    return rejected | occluded, (observed == Observed.unobserved) | rejected


def not_seen_empty(
    own: Candidates,
    observed: Int8[np.ndarray, " n"],
    other: Float[np.ndarray, "m 3"],
    limits: DetectionLimits,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Bool[np.ndarray, " n"]:
    """The points of the candidates that are not in free space of the other survey.

    A thin object is too near to the surface behind it for free space: there the other survey must have observed a
    surface at an offset from this one, and the candidate must not continue the adjacent surfaces.

    Args:
        own: the candidates of one cloud.
        observed: what the other survey observed at the place of each point, values of `Observed`.
        other: points of the other cloud.
        limits: of offsets.
        settings: when a candidate is a change.
    """
    labels = own.labels
    offset = own.difference.offset > settings.thin_offset * limits.local_offset(own.difference)
    free = observed == Observed.free
    free_or_offset = free | ((observed == Observed.surface) & offset)
    seen = observed != Observed.unobserved
    in_free_space = _mostly(free, seen, labels, settings.least_free_of_all, settings)
    others = np.where(np.isin(labels, in_free_space), -1, labels)
    offset_ones = _mostly(free_or_offset, seen, others, settings.least_thin_of_all, settings)
    thin_labels = np.where(np.isin(labels, offset_ones), labels, -1)
    thin = (thin_labels >= 0) & ~continuing(own.points, thin_labels, other, limits, settings)
    return (labels >= 0) & ~np.isin(labels, in_free_space) & ~thin


def _mostly(
    empty: np.ndarray, seen: np.ndarray, labels: np.ndarray, least_of_all: float, settings: EvidenceSettings
) -> list[int]:
    """The candidates with enough empty places: of those that were observed, and of all."""

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
    """The parts of the segments that the other survey did not observe, as segments of their own.

    The occluded side of an object belongs to it; the background that the object occluded does not.

    Args:
        points: of one cloud.
        labels: -1, or the number of the segment.
        observed: what the other survey observed at each point, values of `Observed`.
        limits: the spacing of the points.
        settings: of the clusters.

    Returns:
        For each point -1, or the number of the part.
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
    """The points of the segments that only continue the adjacent unchanged surfaces.

    An object and the background that it occluded may be one segment: what continues a surface and what does not are
    judged separately where each is large enough.

    Args:
        points: of one cloud.
        labels: -1, or the number of the segment; points of no segment are unchanged.
        other: points of the other cloud.
        limits: the spacing of the points and the limit of the offset.
        settings: when a segment continues a surface.
    """
    # What is farther off than this is another surface: the top of a thin object does not cover the floor's plane.
    tolerance = settings.same_surface * limits.offset
    reference = ReferenceSurfaces.of(points[labels < 0], other, tolerance, limits.spacing)
    unseen = unobserved_points(points, labels, reference, settings.continuation)
    whole = _shares(unseen, labels, int(labels.max(initial=-1)) + 1) > settings.most_continued
    pieces, of_segment = _pieces(points, labels, unseen, limits.spacing, settings)
    dropped = (labels >= 0) & whole[labels]
    if not len(of_segment):
        return dropped
    of_piece = _continuing_pieces(points, pieces, of_segment, reference, settings)
    return np.where(pieces >= 0, np.append(of_piece, False)[pieces], dropped)


def _pieces(
    points: np.ndarray, labels: np.ndarray, unseen: np.ndarray, spacing: float, settings: EvidenceSettings
) -> tuple[np.ndarray, np.ndarray]:
    """The large clusters of the points of each segment that are unobserved, and of those that are not.

    Returns:
        For each point -1 or the number of its cluster; the segment of each cluster.
    """
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


def _continuing_pieces(
    points: np.ndarray,
    pieces: np.ndarray,
    of_segment: np.ndarray,
    reference: ReferenceSurfaces,
    settings: EvidenceSettings,
) -> np.ndarray:
    """Which pieces only continue the adjacent unchanged surfaces."""

    def continued(*, edges: bool) -> np.ndarray:
        unseen = unobserved_points(points, pieces, reference, settings.continuation, edges=edges)
        return np.asarray(_shares(unseen, pieces, len(of_segment))[:-1] > settings.most_continued)

    of_piece = continued(edges=True)
    # The top of an object, by itself, can look like a wall at the edge of the coverage.
    with_others = of_piece & np.isin(of_segment, of_segment[~of_piece])
    if with_others.any():
        of_piece &= ~with_others | continued(edges=False)
    return of_piece


def _shares(flags: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """The fraction of each label's points that are flagged; one more entry, 0, for the label -1."""
    inside = labels >= 0
    points = np.bincount(labels[inside], minlength=count)
    return np.append(np.bincount(labels[inside], flags[inside], count) / np.maximum(points, 1), 0.0)


def renumbered(labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The labels without gaps in their numbers."""
    result = labels.copy()
    result[labels >= 0] = np.unique(labels[labels >= 0], return_inverse=True)[1]
    return result
