"""Inputs of what is learned: the candidates of two scans, and their changes before moved objects are looked for."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change
from gmmjax.changes.detectors import AlignedScans, JointDetector, Scan
from gmmjax.changes.detectors.joint import posterior_of_points
from gmmjax.changes.evidence.candidate import Candidate
from gmmjax.changes.evidence.examination import measured_candidates
from gmmjax.changes.evidence.local_examination import candidates_by_resolution
from gmmjax.changes.fit.joint_fit import JointFits
from gmmjax.changes.progress import Clock, silent
from gmmjax.pair import Pair, each


class CutCandidates(NamedTuple):
    """The candidates of two scans, cut into pieces, that are examined at one resolution.

    Attributes:
        pieces: of both scans.
        members: of each point of either scan the row in the cloud that they are pieces of, -1 for what was left out.
    """

    pieces: Pair[list[Candidate]]
    members: Pair[Int[np.ndarray, " _"]]


class UnpairedChanges(NamedTuple):
    """The changes of two scans before moved objects are looked for.

    Attributes:
        items: the changes of both clouds.
        labels: of each working point the index of its change, or -1.
        members: of each point of either scan the row of its working point, -1 for what was left out.
        pair: both clouds, registered.
        registration_error: standard deviation of the offset between local means of one surface.
    """

    items: tuple[Change, ...]
    labels: Pair[Int[np.ndarray, " _"]]
    members: Pair[Int[np.ndarray, " _"]]
    pair: AlignedPair
    registration_error: float


def cut_candidates(detector: JointDetector, scans: Pair[Scan], *, poses: Sequence[bool]) -> list[list[CutCandidates]]:
    """Collect the candidates of two scans with all that facts are measured from: the classifier is learned from them.

    Args:
        detector: by which they are found; its classifier is not read, and may lack facts.
        scans: with views.
        poses: for each set of candidates whether the views are used.

    Returns:
        For each of `poses` the candidates of both scans, those of one resolution after the other; an empty list where
        the clouds fill volumes.
    """
    prepared = detector.aligned_scans(scans, Clock(silent))
    if prepared.volumetric:
        return []
    fits = detector.joint_fits(prepared)
    return [_cut_candidates(detector, prepared if given else prepared.without_views(), fits) for given in poses]


def _cut_candidates(detector: JointDetector, prepared: AlignedScans, fits: JointFits) -> list[CutCandidates]:
    found = detector.candidates_in(prepared, fits)
    if prepared.coarse is None:
        pieces = measured_candidates(found, prepared.surveys, prepared.differences.limits, detector.evidence)
        return [CutCandidates(pieces, prepared.members)]
    scene = prepared.scene(functools.partial(posterior_of_points, fits))
    levels = candidates_by_resolution(found, scene, detector.evidence, detector.examination)
    return [CutCandidates(level.pieces, each(_through, prepared.members, level.members)) for level in levels]


def _through(member: Int[np.ndarray, " n"], further: Int[np.ndarray, " m"]) -> Int[np.ndarray, " n"]:
    """The rows that the rows of `member` have in `further`, -1 where there is none in either."""
    return np.where(member >= 0, further[member], -1)


def unpaired_changes(detector: JointDetector, scans: Pair[Scan]) -> UnpairedChanges | None:
    """Find the changes of two scans before moved objects are looked for: `same_object.json` is learned from them.

    Args:
        detector: by which they are found.
        scans: both clouds, with their views, where they are known.

    Returns:
        The changes; None where the clouds fill volumes.
    """
    prepared = detector.prepared(scans, Clock(silent))
    if prepared.volumetric:
        return None
    pair, found = prepared.pair, detector.found_on_surfaces(prepared, detector.joint_fits(prepared))
    items, labels = found.with_confidence(pair.registration.confidence).merged()
    working = each(lambda own, cloud: cloud.of_working_points(own), labels, pair.working.clouds)
    return UnpairedChanges(items, working, prepared.members, pair, found.registration_error)
