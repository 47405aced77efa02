"""The evidence stage: of each candidate the facts, and from them the verdict whether it is a change."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits, Differences, LocalDifference
from gmmjax.changes.evidence.candidate import Candidate, candidates_in
from gmmjax.changes.evidence.continuation import Continuation, ContinuationSettings
from gmmjax.changes.evidence.coverage_edge import ReferenceSurfaces
from gmmjax.changes.evidence.facing import Facing
from gmmjax.changes.evidence.facts import measured
from gmmjax.changes.evidence.free_space import Observed, Sightlines, observation, sightlines
from gmmjax.changes.evidence.pieces import PieceSettings, cut
from gmmjax.changes.evidence.scan_visibility import FreeSpaceSettings, ScanVisibility
from gmmjax.changes.evidence.support_planes import SupportSettings, supports
from gmmjax.changes.evidence.surroundings import Areas, Surroundings, SurroundingsSettings
from gmmjax.changes.evidence.verdict import Judgement, judged
from gmmjax.changes.evidence.verdict_file import Verdicts
from gmmjax.changes.evidence.view_checks import ViewCheckSettings
from gmmjax.changes.explanation import Explanation
from gmmjax.errors import warn
from gmmjax.geometry import density_clusters
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class EvidenceSettings:
    """How candidates are cut and their facts measured. What decides are the verdict's parameters.

    Attributes:
        same_surface: largest offset of an unchanged surface in the two clouds, as a fraction of the limit of the
            offset. Larger: the top of a thin object covers the plane of the floor.
        unlike: how far a fact of a candidate may lie beyond what the verdict was learned from, in widths of the learned
            range, without a warning. Infinite: there is never one.
        pieces: how candidates are cut into pieces that are one thing each.
        continuation: which points continue unchanged surfaces.
        support: which candidates are only the support planes of others.
        surroundings: what of both clouds surrounds a candidate.
        free_space: with views, what the points of a survey occlude.
        view_checks: from when on views contradict their cloud.
    """

    same_surface: float = 0.5
    unlike: float = 1.0
    pieces: PieceSettings = PieceSettings()
    continuation: ContinuationSettings = ContinuationSettings()
    support: SupportSettings = SupportSettings()
    surroundings: SurroundingsSettings = SurroundingsSettings()
    free_space: FreeSpaceSettings = FreeSpaceSettings()
    view_checks: ViewCheckSettings = ViewCheckSettings()


class Examined(NamedTuple):
    """The candidates of one cloud that are changes.

    Attributes:
        labels: -1, or the number of the change.
        probability: of each change, that it is one.
        looks_changed: for each point, the mean over the restarts of the probability that it looks changed.
        unobserved: whether the other survey did not observe the point's place.
        explanations: of each change; None where no evidence was asked for.
        rejected: the candidates that are none: their points and the reason.
    """

    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, " c"]
    looks_changed: Float[np.ndarray, " n"]
    unobserved: Bool[np.ndarray, " n"]
    explanations: tuple[Explanation | None, ...]
    rejected: tuple[tuple[Int[np.ndarray, " _"], Explanation], ...] = ()


def observed_places(
    points: Pair[Float[np.ndarray, "_ 3"]], surveys: Pair[ScanVisibility], differences: Differences
) -> Pair[np.ndarray | None]:
    """What the other survey observed at the place of each point, values of `Observed`; None without its views.

    Args:
        points: of both clouds.
        surveys: the same clouds, with their views where they are known.
        differences: of the clouds from each other.
    """

    def of_cloud(points: np.ndarray, other: ScanVisibility, local: LocalDifference) -> np.ndarray | None:
        margin, offset = differences.limits.local_distance(local), differences.limits.local_offset(local)
        return None if other.views is None else observation(points, other, margin, offset)

    return each(of_cloud, points, surveys.swapped, differences.local)


def measured_candidates(
    candidates: Pair[Candidates],
    surveys: Pair[ScanVisibility],
    limits: DetectionLimits,
    settings: EvidenceSettings = EvidenceSettings(),
    areas: Pair[Areas] | None = None,
) -> Pair[list[Candidate]]:
    """The candidates of both clouds, cut into pieces, with all that facts are measured from.

    Args:
        candidates: of both clouds.
        surveys: the same clouds, with their views where they are known.
        limits: of distances and offsets.
        settings: how they are cut.
        areas: of the whole clouds; None: they are whole.
    """
    if areas is None:
        areas = candidates.map(lambda own: Areas.of(own.labels, limits.spacing))
    # What is farther off than this is another surface: the top of a thin object does not cover the floor's plane.
    tolerance = settings.same_surface * limits.offset
    everything = surveys.map(lambda survey: survey.surface.tree)

    def pieces(own: Candidates, everything: cKDTree, other: cKDTree) -> _Cut:
        reference = ReferenceSurfaces(cKDTree(own.points[own.labels < 0]), other, tolerance, limits.spacing)
        labels, continuations = cut(own.points, own.labels, reference, own.free, settings.pieces, settings.continuation)
        return _Cut(own._replace(labels=labels), own.labels, continuations, reference, everything)

    cuts = each(pieces, candidates, everything, everything.swapped)
    points, labels = candidates.map(lambda own: own.points), cuts.map(lambda own: own.pieces.labels)
    support_planes = supports(points, labels, limits.spacing, settings.support)
    opposite = each(lambda own, label: cKDTree(own[label >= 0]), points, labels).swapped

    def surroundings(
        own: _Cut, support: np.ndarray, opposite: cKDTree, survey: ScanVisibility, other: ScanVisibility, areas: Areas
    ) -> list[Candidate]:
        sight = None if other.views is None else _sightlines(own.pieces, survey, other, limits)
        around = Surroundings(*own, support, opposite, other.surface, limits, areas, sight, settings.surroundings)
        return candidates_in(around)

    return each(surroundings, cuts, support_planes, opposite, surveys, surveys.swapped, areas)


class _Cut(NamedTuple):
    """The candidates of one cloud, cut into pieces: the first fields of `Surroundings`."""

    pieces: Candidates
    clusters: Int[np.ndarray, " n"]
    continuations: Mapping[int, Continuation]
    reference: ReferenceSurfaces
    everything: cKDTree


def _sightlines(own: Candidates, survey: ScanVisibility, other: ScanVisibility, limits: DetectionLimits) -> Sightlines:
    """How surely the other survey observed the places of all points to be empty; 0 for those of no candidate."""
    rows = np.flatnonzero(own.labels >= 0)
    margin, offset = limits.local_distance(own.difference), limits.local_offset(own.difference)
    found = sightlines(own.points[rows], other, margin[rows], offset[rows], Facing.of(survey, rows))
    whole = Sightlines(*(np.zeros(len(own.labels), values.dtype) for values in found))
    for values, of_rows in zip(whole, found, strict=True):
        values[rows] = of_rows
    return whole


def examined(
    candidates: Pair[Candidates],
    surveys: Pair[ScanVisibility],
    limits: DetectionLimits,
    verdicts: Verdicts,
    threshold: float = 0.5,
    settings: EvidenceSettings = EvidenceSettings(),
) -> Pair[Examined]:
    """The candidates of both clouds that are changes, and what was not observed.

    Args:
        candidates: of both clouds.
        surveys: the same clouds, with their views where they are known.
        limits: of distances and offsets.
        verdicts: with and without the views of the other survey.
        threshold: probability from which on a candidate is a change.
        settings: how facts are measured.

    Warns:
        InputWarning: a candidate is unlike all that the verdict was learned from.
    """
    pieces = measured_candidates(candidates, surveys, limits, settings)
    judgements = each(lambda own, cut: judgement_of(own, cut, verdicts), candidates, pieces)
    warn_of_unlike([unlike for own in judgements for unlike in own.unlike], settings)

    def of_cloud(own: Candidates, cut: list[Candidate], judgement: Judgement) -> Examined:
        of_pieces = [JudgedPiece(piece.rows, piece.number) for piece in cut]
        return examined_cloud(own, of_pieces, judgement.explanations, limits.spacing, threshold, settings)

    return each(of_cloud, candidates, pieces, judgements)


def unexamined(candidates: Pair[Candidates]) -> Pair[Examined]:
    """All candidates, where no evidence is asked for; nothing is known of what was observed.

    Args:
        candidates: of both clouds.
    """

    def of_cloud(own: Candidates) -> Examined:
        labels, looks_changed = renumbered(own.labels), own.looks_changed
        count = labels.max(initial=-1) + 1
        probability = np.array([looks_changed[labels == label].mean() for label in range(count)])
        nowhere = np.zeros(len(labels), bool)
        return Examined(labels, probability, looks_changed, nowhere, (None,) * count)

    return candidates.map(of_cloud)


class JudgedPiece(NamedTuple):
    """A piece of a candidate that the verdict was asked about.

    Attributes:
        rows: of its points in the cloud.
        number: of the piece.
    """

    rows: Int[np.ndarray, " m"]
    number: int


def judgement_of(own: Candidates, pieces: list[Candidate], verdicts: Verdicts) -> Judgement:
    """The verdict on the pieces of the candidates of one cloud.

    Args:
        own: the candidates.
        pieces: of them.
        verdicts: with and without the views of the other survey.
    """
    verdict = verdicts.poses_unknown if own.observed is None else verdicts.poses_given
    return judged(verdict, [measured(piece) for piece in pieces])


def examined_cloud(
    own: Candidates,
    pieces: Sequence[JudgedPiece],
    explanations: tuple[Explanation, ...],
    spacing: float | Float[np.ndarray, " n"],
    threshold: float,
    settings: EvidenceSettings,
) -> Examined:
    """The pieces of one cloud that are changes; those that touch are one change.

    Args:
        own: the candidates.
        pieces: of them.
        explanations: of the pieces.
        spacing: of neighbouring points, at each point or everywhere.
        threshold: probability from which on a piece is a change.
        settings: when pieces touch.
    """
    labels = np.full(len(own.labels), -1)
    unobserved = np.zeros(len(labels), bool) if own.observed is None else own.observed == Observed.unobserved
    rejected = []
    for piece, explanation in zip(pieces, explanations, strict=True):
        if explanation.changed >= threshold:
            labels[piece.rows] = piece.number
        else:
            rejected.append((piece.rows, explanation))
            unobserved[piece.rows] |= explanation.unobserved > explanation.unchanged
    joined = _joined(own, labels, spacing, settings.pieces)
    unobserved &= joined < 0
    of_changes = [labels[joined == change] for change in range(joined.max(initial=-1) + 1)]
    return Examined(
        joined,
        np.array([_mean_probability(own_pieces, explanations) for own_pieces in of_changes]),
        own.looks_changed,
        unobserved,
        tuple(_largest(own_pieces, explanations) for own_pieces in of_changes),
        tuple(rejected),
    )


def _joined(
    own: Candidates,
    labels: Int[np.ndarray, " n"],
    spacing: float | Float[np.ndarray, " n"],
    settings: PieceSettings,
) -> Int[np.ndarray, " n"]:
    """The labels with one number for all pieces that touch: one change may have been cut into several."""
    kept = np.flatnonzero(labels >= 0)
    if not len(kept) or (labels[kept] == labels[kept[0]]).all():
        return renumbered(labels)
    radius = settings.radius * np.broadcast_to(spacing, len(labels))[kept]
    clusters = density_clusters(own.points[kept], radius, settings.neighbours)
    count = labels.max(initial=-1) + 1
    inside = clusters >= 0
    # A graph of pieces and clusters: what is connected in it is one change.
    links = coo_array(
        (np.ones(inside.sum()), (labels[kept[inside]], count + clusters[inside])),
        shape=(count + clusters.max(initial=-1) + 1,) * 2,
    )
    groups = connected_components(links, directed=False)[1] if count else np.zeros(1, int)
    return renumbered(np.where(labels >= 0, groups[labels], -1))


def _mean_probability(pieces: Int[np.ndarray, " m"], explanations: tuple[Explanation, ...]) -> float:
    """The mean over the points of a change."""
    return float(np.mean([explanations[piece].changed for piece in pieces]))


def _largest(pieces: Int[np.ndarray, " m"], explanations: tuple[Explanation, ...]) -> Explanation:
    """The explanation of the piece that most points of a change are of."""
    return explanations[int(np.bincount(pieces).argmax())]


def warn_of_unlike(unlike: Sequence[tuple[str, float]], settings: EvidenceSettings) -> None:
    """Warns where the verdict extrapolates.

    Args:
        unlike: of each judgement the fact that is farthest beyond what was learned, and how far.
        settings: how far it may be.
    """
    name, widths = max(unlike, key=lambda own: own[1], default=("", 0.0))
    if widths > settings.unlike:
        warn(
            f"a difference between the scans is unlike all that the verdict was learned from ({name} is {widths:.1f} "
            "times its learned range beyond it), so that its probability is drawn towards 50 %; look at it, or tune on "
            "scans like these"
        )


def renumbered(labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The labels without gaps in their numbers."""
    result = labels.copy()
    result[labels >= 0] = np.unique(labels[labels >= 0], return_inverse=True)[1]
    return result
