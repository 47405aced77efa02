"""The candidates of scenes whose changes are known: their facts, and what each is."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes import (
    FACTS,
    Candidate,
    CutCandidates,
    DetectionConfig,
    JointDetector,
    ResolutionSettings,
    Scan,
    cut_candidates,
    measured,
    names_of,
)
from gmmjax.evaluation import LabelledCloud, LabelledPair
from gmmjax.pair import Pair

# What a candidate is; the columns of `Verdict.probabilities`, and last what is one of the two before, not known which.
CHANGED, UNOBSERVED, UNCHANGED, NOT_CHANGED = range(4)


class CandidateRows(NamedTuple):
    """Candidates, a row each.

    Attributes:
        values: the facts as they were measured, in the order of `names_of`.
        kind: what each is: `CHANGED`, `UNOBSERVED`, `UNCHANGED`, or `NOT_CHANGED`: one of these two.
        points: number of its judged points.
        changed_points: number of those that changed.
    """

    values: Float[np.ndarray, "n f"]
    kind: Int[np.ndarray, " n"]
    points: Int[np.ndarray, " n"]
    changed_points: Int[np.ndarray, " n"]

    @classmethod
    def none(cls, *, poses: bool) -> "CandidateRows":
        """No rows."""
        nothing = np.zeros(0, int)
        return cls(np.zeros((0, len(names_of(poses=poses)))), nothing, nothing, nothing)

    @classmethod
    def joined(cls, parts: "list[CandidateRows]", *, poses: bool) -> "CandidateRows":
        """The rows of all parts, one after the other."""
        return cls(*(np.concatenate(own) for own in zip(cls.none(poses=poses), *parts, strict=True)))

    def scaled(self, names: Sequence[str]) -> Float[np.ndarray, "n f"]:
        """The facts as the verdict sees them.

        Args:
            names: of the facts, in the order of the columns.
        """
        by_name = zip(names, self.values.T, strict=True)
        columns = [[FACTS[name].scaled(value) for value in column] for name, column in by_name]
        return np.array(columns).T.reshape(len(self.kind), len(names))


class PointTruth(NamedTuple):
    """The truth of each point of a cloud.

    Attributes:
        judged: whether its truth counts.
        changed: whether it changed.
        unseen: whether the other survey could not see its place; None: not known.
    """

    judged: Bool[np.ndarray, " n"]
    changed: Bool[np.ndarray, " n"]
    unseen: Bool[np.ndarray, " n"] | None = None


@dataclasses.dataclass(frozen=True)
class _Counts:
    """The numbers of points of each working point that are judged, changed, and not seen (None: not known)."""

    judged: np.ndarray
    changed: np.ndarray
    unseen: np.ndarray | None


def rows_of(
    pair: LabelledPair,
    config: DetectionConfig = DetectionConfig(),
    resolution: ResolutionSettings = ResolutionSettings(),
) -> Pair[CandidateRows]:
    """The candidates of a pair: first with the poses unknown, then with the poses given.

    Args:
        pair: with views and what could not be seen.
        config: of the detection.
        resolution: of the registration; clouds of more points are examined at their own resolution at each place.
    """
    clouds = Pair(pair.before, pair.after)
    scans = clouds.map(lambda cloud: Scan(cloud.points, cloud.views))
    poses = [False, clouds.before.views is not None and clouds.after.views is not None]
    of_poses = cut_candidates(JointDetector(config, common_resolution=resolution), scans, poses=poses)
    if not of_poses:
        return _no_rows()
    unknown, given = of_poses
    truths = clouds.map(_truth_of)
    return Pair(_rows_of_both(unknown, truths, poses=False), _rows_of_both(given, truths, poses=True))


def rows_of_scans(
    scans: Pair[Scan], truths: Pair[PointTruth], config: DetectionConfig = DetectionConfig()
) -> Pair[CandidateRows]:
    """The candidates that detection judges: those whose other survey has no views, and those whose other survey has.

    Args:
        scans: with their views, where they are known.
        truths: of their points.
        config: of the detection.
    """
    of_poses = cut_candidates(JointDetector(config), scans, poses=[True])
    if not of_poses:
        return _no_rows()
    (found,) = of_poses
    return Pair(_rows_of_both(found, truths, poses=False), _rows_of_both(found, truths, poses=True))


def _no_rows() -> Pair[CandidateRows]:
    return Pair(CandidateRows.none(poses=False), CandidateRows.none(poses=True))


def _rows_of_both(found: list[CutCandidates], truths: Pair[PointTruth], *, poses: bool) -> CandidateRows:
    """The rows of the candidates of both clouds."""
    parts = [
        _rows(pieces, _counts(truth, member), poses=poses)
        for cut in found
        for pieces, truth, member in zip(cut.pieces, truths, cut.members, strict=True)
    ]
    return CandidateRows.joined(parts, poses=poses)


def _truth_of(cloud: LabelledCloud) -> PointTruth:
    judged = (cloud.truth >= -1) & ~np.isin(cloud.truth, list(cloud.not_counted))
    return PointTruth(judged, cloud.truth >= 0, cloud.unseen)


def _counts(truth: PointTruth, member: np.ndarray) -> _Counts:
    judged, count = (member >= 0) & truth.judged, int(member.max()) + 1
    chosen = [judged, judged & truth.changed, *([] if truth.unseen is None else [judged & truth.unseen])]
    counts = [np.bincount(member[own], minlength=count) for own in chosen]
    return _Counts(counts[0], counts[1], counts[2] if len(counts) > 2 else None)


def _rows(candidates: list[Candidate], counts: _Counts, *, poses: bool) -> CandidateRows:
    """The rows of the candidates of one cloud, most of whose points are judged."""
    values, kinds, points, changed = [], [], [], []
    for candidate in candidates:
        own = candidate.rows
        judged, changes = int(counts.judged[own].sum()), int(counts.changed[own].sum())
        if (counts.judged[own] == 0).mean() > 0.5 or (candidate.observed is None) == poses:
            continue
        kinds.append(CHANGED if changes > judged / 2 else _unchanged_kind(counts, own, judged))
        values.append(list(measured(candidate).values()))
        points.append(judged)
        changed.append(changes)
    if not values:
        return CandidateRows.none(poses=poses)
    return CandidateRows(np.array(values), np.array(kinds), np.array(points), np.array(changed))


def _unchanged_kind(counts: _Counts, rows: np.ndarray, judged: int) -> int:
    if counts.unseen is None:
        return NOT_CHANGED
    return UNOBSERVED if counts.unseen[rows].sum() > judged / 2 else UNCHANGED
