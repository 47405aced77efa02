"""What the scores leave out: how far probabilities can be believed, and how well the motions of objects are known."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from gmmjax.evaluation import Detection, LabelledPair, ReliabilityRecord
from gmmjax.evaluation.scores import segment_truth
from tests.benchmarks.held_out.surveys import HeldOutPair


@dataclasses.dataclass(frozen=True)
class MotionError:
    """How far off the reported motion of an object is.

    Attributes:
        spacings: distance between where it takes the object's centre and where that truly went, in spacings.
        degrees: angle between both rotations.
    """

    spacings: float
    degrees: float


class Records:
    """Takes detections as `evaluate` hands them on.

    Attributes:
        reliability: of the probabilities.
        motions: by detector, of the objects that were found to have moved and did; those that look the same after a
            turn about an axis of theirs included.
    """

    def __init__(self) -> None:
        self.reliability = ReliabilityRecord()
        self.motions: dict[str, list[MotionError]] = {}

    def add(self, name: str, pair: LabelledPair, detection: Detection) -> None:
        """Takes one detection."""
        self.reliability.add(name, pair, detection)
        self.motions.setdefault(name, []).extend(motion_errors(pair, detection))


def motion_errors(pair: LabelledPair, detection: Detection) -> list[MotionError]:
    """Of each object that is reported as moved from where it was to where it went."""
    found = detection.changes
    if found is None or not isinstance(pair, HeldOutPair):
        return []
    truths = [
        segment_truth(labels, cloud)
        for labels, cloud in ((detection.labels_before, pair.before), (detection.labels_after, pair.after))
    ]
    errors = []
    for gone, new in detection.moved:
        change, transform = truths[0].get(gone, -1), found.items[gone].transform
        if change == truths[1].get(new, -1) and change in pair.motions and transform is not None:
            centre = np.append(pair.before.points[pair.before.truth == change].mean(axis=0), 1.0)
            errors.append(_error(transform, pair.motions[change], centre, found.diagnostics["spacing"]))
    return errors


def _error(found: np.ndarray, true: np.ndarray, centre: np.ndarray, spacing: float) -> MotionError:
    turn = found[:3, :3] @ true[:3, :3].T
    cosine = np.clip((np.trace(turn) - 1) / 2, -1, 1)
    return MotionError(float(np.linalg.norm((found - true) @ centre)) / spacing, float(np.degrees(np.arccos(cosine))))


def pooled(records: Sequence[tuple[str, ReliabilityRecord]]) -> ReliabilityRecord:
    """The curves of all records of one label added.

    Args:
        records: with a label for each, which follows the detector's name.
    """
    result = ReliabilityRecord()
    for label, record in records:
        for own, sums in ((record.changes, result.changes), (record.points, result.points)):
            for name, curve in own.items():
                key = f"{name}, {label}"
                sums[key] = sums[key] + curve if key in sums else curve
    return result
