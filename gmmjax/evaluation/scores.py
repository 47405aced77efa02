"""Precision, recall and F1 of labelled changes against truth, for segments and for points."""

import dataclasses
from collections.abc import Collection, Mapping

import numpy as np
from jaxtyping import Bool, Int

from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair

# The truth of a segment that is no change, and of one that is mostly made of changes that are not counted.
FALSE, NEITHER = -1, -2


@dataclasses.dataclass(frozen=True)
class Scores:
    """Counts over one or many pairs; add them before dividing (micro average).

    In each cloud a detected segment is a true positive when more than half of its points come from changed sources; a
    true change is found when at least half of its points lie in true positive segments. An object that moved is a
    change of either cloud.

    Changes that are not counted neither help nor hurt: they are not in `changes`, their points in none of the counts of
    points, and a segment that is true thanks to them is no segment. Points whose place the other survey could not see
    count as any other: to tell them from a change is the detector's work, and the hidden part of an object that
    appeared belongs to it.

    Attributes:
        true_segments: detected segments that are true positives.
        segments: detected segments.
        found: true changes that were found.
        changes: true changes.
        true_points: points that are changed and labelled so.
        labelled_points: points labelled as changed.
        changed_points: points that are changed.
        shadow_points: labelled points that are unchanged, in places that the other survey could not see.
        unchanged_pairs: pairs in which nothing changed.
        false_in_unchanged: segments detected in those.
        moved: objects that moved, counted in both clouds.
        moved_found: those of them that were reported as moved from the one place to the other.
        moved_false: pairs of segments reported as one object that moved, and are not.
    """

    true_segments: int = 0
    segments: int = 0
    found: int = 0
    changes: int = 0
    true_points: int = 0
    labelled_points: int = 0
    changed_points: int = 0
    shadow_points: int = 0
    unchanged_pairs: int = 0
    false_in_unchanged: int = 0
    moved: int = 0
    moved_found: int = 0
    moved_false: int = 0

    def __add__(self, other: "Scores") -> "Scores":
        mine, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return Scores(*(a + b for a, b in zip(mine, theirs, strict=True)))

    @property
    def precision(self) -> float:
        """True positive segments by segments; 1 where nothing was detected."""
        return _share(self.true_segments, self.segments)

    @property
    def recall(self) -> float:
        """Found changes by changes; 1 where there was none to find."""
        return _share(self.found, self.changes)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall of the segments."""
        return 2 * self.precision * self.recall / max(self.precision + self.recall, 1e-300)

    @property
    def false_segments(self) -> int:
        """Detected segments that are no change."""
        return self.segments - self.true_segments

    @property
    def point_precision(self) -> float:
        """Changed points among those labelled so; 1 where none was."""
        return _share(self.true_points, self.labelled_points)

    @property
    def point_recall(self) -> float:
        """Labelled points among the changed ones; 1 where there are none."""
        return _share(self.true_points, self.changed_points)

    @property
    def point_f1(self) -> float:
        """F1 over points; 1 where there was no changed point and none was labelled."""
        return _share(2 * self.true_points, self.labelled_points + self.changed_points)


def score_pair(
    labels_before: Int[np.ndarray, " n0"],
    labels_after: Int[np.ndarray, " n1"],
    truth_before: Int[np.ndarray, " n0"],
    truth_after: Int[np.ndarray, " n1"],
) -> Scores:
    """The scores of one pair of which nothing but the changes is known: both clouds' added.

    Args:
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.
        truth_before: per point -1 or the id of a true change.
        truth_after: the same for the after cloud.
    """
    before, after = (LabelledCloud(np.zeros((len(truth), 3)), truth) for truth in (truth_before, truth_after))
    return score_labelled_pair(LabelledPair("pair", before, after), labels_before, labels_after)


def score_labelled_pair(
    pair: LabelledPair,
    labels_before: Int[np.ndarray, " n0"],
    labels_after: Int[np.ndarray, " n1"],
    moved: Collection[tuple[int, int]] = (),
) -> Scores:
    """The scores of one pair with all that is known of it: both clouds' added.

    Args:
        pair: with the truth.
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.
        moved: detected changes of the before and of the after cloud that are reported as one object.
    """
    truths = segment_truth(labels_before, pair.before), segment_truth(labels_after, pair.after)
    scores = _score_cloud(labels_before, pair.before) + _score_cloud(labels_after, pair.after)
    scores += _score_moved(*truths, pair, moved)
    if not pair.unchanged:
        return scores
    return dataclasses.replace(scores, unchanged_pairs=1, false_in_unchanged=scores.segments)


def segment_truth(labels: Int[np.ndarray, " n"], cloud: LabelledCloud) -> dict[int, int]:
    """Find the true change of each detected segment of a cloud.

    Args:
        labels: per point -1 or the id of a detected change.
        cloud: with the truth.

    Returns:
        By segment the id of the change that most of its changed points are of; `FALSE` where no more than half of its
        points are changed, `NEITHER` where most of those that are belong to changes that are not counted.
    """
    truths = {}
    for segment in np.unique(labels[labels >= 0]):
        own = cloud.truth[labels == segment]
        changed = own[own >= 0]
        not_counted = np.isin(changed, list(cloud.not_counted))
        if 2 * len(changed) <= len(own):
            truths[int(segment)] = FALSE
        elif 2 * not_counted.sum() > len(changed):
            truths[int(segment)] = NEITHER
        else:
            ids, counts = np.unique(changed[~not_counted], return_counts=True)
            truths[int(segment)] = int(ids[counts.argmax()])
    return truths


def false_segments(labels: Int[np.ndarray, " n"], cloud: LabelledCloud) -> list[int]:
    """The detected segments of a cloud that are false positives: at least half of their points are unchanged.

    Args:
        labels: per point -1 or the id of a detected change.
        cloud: with the truth.
    """
    return [segment for segment, truth in segment_truth(labels, cloud).items() if truth == FALSE]


def counted_points(cloud: LabelledCloud) -> Bool[np.ndarray, " n"]:
    """The points that help or hurt: all but those of changes that are not counted."""
    return ~np.isin(cloud.truth, list(cloud.not_counted))


def _score_cloud(labels: Int[np.ndarray, " n"], cloud: LabelledCloud) -> Scores:
    truths = segment_truth(labels, cloud)
    true_segments = [segment for segment, truth in truths.items() if truth >= 0]
    in_true_segment, counted = np.isin(labels, true_segments), counted_points(cloud)
    changes = _counted_changes(cloud)
    neither = [segment for segment, truth in truths.items() if truth == NEITHER]
    labelled = counted & (labels >= 0) & ~np.isin(labels, neither)
    changed = counted & (cloud.truth >= 0)
    return Scores(
        true_segments=len(true_segments),
        segments=sum(truth != NEITHER for truth in truths.values()),
        found=sum(bool(in_true_segment[cloud.truth == change].mean() >= 0.5) for change in changes),
        changes=len(changes),
        true_points=int((changed & labelled).sum()),
        labelled_points=int(labelled.sum()),
        changed_points=int(changed.sum()),
        shadow_points=0 if cloud.unseen is None else int((labelled & ~changed & cloud.unseen).sum()),
    )


def _counted_changes(cloud: LabelledCloud) -> set[int]:
    return {int(change) for change in np.unique(cloud.truth[cloud.truth >= 0])} - cloud.not_counted


def _score_moved(
    before: Mapping[int, int], after: Mapping[int, int], pair: LabelledPair, reported: Collection[tuple[int, int]]
) -> Scores:
    """The counts of moved objects, by the truths of the segments of both clouds."""
    pairs = [(before.get(gone, FALSE), after.get(new, FALSE)) for gone, new in reported]
    moved = _counted_changes(pair.before) & _counted_changes(pair.after)
    return Scores(
        moved=len(moved),
        moved_found=len({gone for gone, new in pairs if gone == new and gone in moved}),
        moved_false=sum(gone != new or gone == FALSE for gone, new in pairs if NEITHER not in (gone, new)),
    )


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 1.0
