"""Segments of any detector, without those that the classifier of "joint" rejects."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Int

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.detectors import AlignedScans, JointDetector, Scan
from gmmjax.changes.evidence.examination import Examined
from gmmjax.changes.fit.joint_fit import JointFits
from gmmjax.changes.progress import Clock, silent
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True, eq=False)
class EvidenceFilter:
    """The evidence of two scans for and against the segments of other detectors, by the same facts as our own.

    Attributes:
        detector: whose classifier decides.
        prepared: both scans.
        fits: of its mixture; None where the clouds fill volumes.
    """

    detector: JointDetector
    prepared: AlignedScans
    fits: JointFits | None

    @classmethod
    def of(cls, detector: JointDetector, scans: Pair[Scan]) -> "EvidenceFilter":
        """Compute once what the scans alone say.

        Args:
            detector: whose classifier decides.
            scans: both clouds.
        """
        prepared = detector.prepared(scans, Clock(silent))
        return cls(detector, prepared, None if prepared.volumetric else detector.joint_fits(prepared))

    @functools.cached_property
    def _candidates(self) -> Pair[Candidates]:
        assert self.fits is not None
        return self.detector.candidates_in(self.prepared, self.fits)

    def supported(self, labels: Pair[Int[np.ndarray, " _"]]) -> Pair[Int[np.ndarray, " _"]]:
        """The labels, -1 where the evidence speaks against a change; as they are for clouds that fill volumes.

        Args:
            labels: per point -1 or the number of a segment.
        """
        if self.fits is None:
            return labels
        segments = each(_with_labels, self._candidates, self.prepared.members, labels)
        judged = self.detector.examined(self.prepared, self.fits, segments)
        return each(_kept, judged, self.prepared.members, labels)


def _with_labels(own: Candidates, member: Int[np.ndarray, " n"], labels: Int[np.ndarray, " n"]) -> Candidates:
    """The segments as candidates: a working point is of one where any of its points is."""
    of_working = np.full(len(own.labels), -1)
    used = member >= 0
    np.maximum.at(of_working, member[used], labels[used])
    return own._replace(labels=of_working)


def _kept(judged: Examined, member: Int[np.ndarray, " n"], labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    return np.where((member >= 0) & (judged.labels[member] >= 0), labels, -1)
