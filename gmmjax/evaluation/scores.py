"""Precision, recall and F1 of labelled changes against truth, for segments and for points."""

import dataclasses

import numpy as np
from jaxtyping import Int


@dataclasses.dataclass(frozen=True)
class Scores:
    """Counts over one or many scenes; add them before dividing (micro average).

    In each cloud a detected segment is a true positive when more than half of its points come from changed sources; a
    true change is found when at least half of its points lie in true positive segments.

    Attributes:
        true_segments: detected segments that are true positives.
        segments: detected segments.
        found: true changes that were found.
        changes: true changes.
        true_points: points that are changed and labelled so.
        labelled_points: points labelled as changed.
        changed_points: points that are changed.
    """

    true_segments: int = 0
    segments: int = 0
    found: int = 0
    changes: int = 0
    true_points: int = 0
    labelled_points: int = 0
    changed_points: int = 0

    def __add__(self, other: "Scores") -> "Scores":
        mine, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return Scores(*(a + b for a, b in zip(mine, theirs, strict=True)))

    @property
    def precision(self) -> float:
        """True positive segments by segments; 1 where nothing was detected."""
        return self.true_segments / self.segments if self.segments else 1.0

    @property
    def recall(self) -> float:
        """Found changes by changes; 1 where there was none to find."""
        return self.found / self.changes if self.changes else 1.0

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall of the segments."""
        return 2 * self.precision * self.recall / max(self.precision + self.recall, 1e-300)

    @property
    def false_segments(self) -> int:
        """Detected segments that are no change."""
        return self.segments - self.true_segments

    @property
    def point_f1(self) -> float:
        """F1 over points; 1 where there was no changed point and none was labelled."""
        total = self.labelled_points + self.changed_points
        return 2 * self.true_points / total if total else 1.0


def score_pair(
    labels_before: Int[np.ndarray, " n0"],
    labels_after: Int[np.ndarray, " n1"],
    truth_before: Int[np.ndarray, " n0"],
    truth_after: Int[np.ndarray, " n1"],
) -> Scores:
    """The scores of one pair: both clouds' added.

    Args:
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.
        truth_before: per point -1 or the id of a true change.
        truth_after: the same for the after cloud.
    """
    return _score_cloud(labels_before, truth_before) + _score_cloud(labels_after, truth_after)


def _score_cloud(labels: Int[np.ndarray, " n"], truth: Int[np.ndarray, " n"]) -> Scores:
    changed = truth >= 0
    segments = np.unique(labels[labels >= 0])
    true_segments = [segment for segment in segments if changed[labels == segment].mean() > 0.5]
    in_true_segment = np.isin(labels, true_segments)
    changes = np.unique(truth[changed])
    return Scores(
        true_segments=len(true_segments),
        segments=len(segments),
        found=sum(bool(in_true_segment[truth == change].mean() >= 0.5) for change in changes),
        changes=len(changes),
        true_points=int((changed & (labels >= 0)).sum()),
        labelled_points=int((labels >= 0).sum()),
        changed_points=int(changed.sum()),
    )
