"""The candidates of scenes whose changes are known: their facts, and what each is."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes import Candidate, DetectionConfig, JointDetector, Scan, measured, names_of
from gmmjax.evaluation import LabelledCloud, LabelledPair
from gmmjax.pair import Pair, each

# What a candidate is; the columns of `Verdict.probabilities`.
CHANGED, UNOBSERVED, UNCHANGED = 0, 1, 2


class CandidateRows(NamedTuple):
    """Candidates, a row each.

    Attributes:
        values: the facts as they were measured, in the order of `names_of`.
        kind: what each is: `CHANGED`, `UNOBSERVED` or `UNCHANGED`.
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


@dataclasses.dataclass(frozen=True)
class _Truth:
    """Of each working point: how many of its points are judged, changed, and could not be seen."""

    judged: np.ndarray
    changed: np.ndarray
    unseen: np.ndarray


def rows_of(pair: LabelledPair, config: DetectionConfig = DetectionConfig()) -> Pair[CandidateRows]:
    """The candidates of a pair: first with the poses unknown, then with the poses given.

    Args:
        pair: with views and what could not be seen.
        config: of the detection.
    """
    clouds = Pair(pair.before, pair.after)
    scans = clouds.map(lambda cloud: Scan(cloud.points, cloud.views))
    poses = [False, clouds.before.views is not None and clouds.after.views is not None]
    members, of_poses = JointDetector(config).cut_candidates(scans, poses=poses)
    if not of_poses:
        return Pair(CandidateRows.none(poses=False), CandidateRows.none(poses=True))
    truths = each(_truth_of, clouds, members)
    unknown, given = of_poses
    return Pair(_rows_of_both(unknown, truths, poses=False), _rows_of_both(given, truths, poses=True))


def _rows_of_both(candidates: Pair[list[Candidate]], truths: Pair[_Truth], *, poses: bool) -> CandidateRows:
    """The rows of the candidates of both clouds."""
    parts = each(lambda own, truth: _rows(own, truth, poses=poses), candidates, truths)
    return CandidateRows.joined([*parts], poses=poses)


def _truth_of(cloud: LabelledCloud, member: np.ndarray) -> _Truth:
    used = member >= 0
    count = int(member.max()) + 1
    judged = used & (cloud.truth >= -1) & ~np.isin(cloud.truth, list(cloud.not_counted))
    unseen = np.zeros(len(member), bool) if cloud.unseen is None else cloud.unseen

    def counted(which: np.ndarray) -> np.ndarray:
        return np.bincount(member[which], minlength=count)

    return _Truth(counted(judged), counted(judged & (cloud.truth >= 0)), counted(judged & unseen))


def _rows(candidates: list[Candidate], truth: _Truth, *, poses: bool) -> CandidateRows:
    """The rows of the candidates of one cloud, most of whose points are judged."""
    values, kinds, points, changed = [], [], [], []
    for candidate in candidates:
        own = candidate.rows
        judged, changes = int(truth.judged[own].sum()), int(truth.changed[own].sum())
        if (truth.judged[own] == 0).mean() > 0.5 or (candidate.observed is None) == poses:
            continue
        unseen = truth.unseen[own].sum() > judged / 2
        kinds.append(CHANGED if changes > judged / 2 else UNOBSERVED if unseen else UNCHANGED)
        values.append(list(measured(candidate).values()))
        points.append(judged)
        changed.append(changes)
    if not values:
        return CandidateRows.none(poses=poses)
    return CandidateRows(np.array(values), np.array(kinds), np.array(points), np.array(changed))
