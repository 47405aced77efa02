"""Accuracy with true negatives, for which things are counted that did not change (thesis 4.6, figures 4.9 to 4.12)."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Int

from gmmjax.errors import InputError
from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair
from gmmjax.evaluation.scores import FALSE, score_labelled_pair, segment_truth

# Of the points, from where on a report and a change overlap.
OVERLAP = 0.1


@dataclasses.dataclass(frozen=True)
class Confusion:
    """Counts over one or many pairs; add them before dividing (micro average).

    Segments and changes are as in `Scores`. A true negative is a thing that did not change, in one of the two clouds,
    and that holds the largest part of no false segment. Things are Gaussians, objects, walls.

    Attributes:
        true_positives: detected segments that are a change.
        false_positives: detected segments that are none.
        found: true changes that were found.
        missed: true changes that were not.
        true_negatives: unchanged things that no false segment lies in.
    """

    true_positives: int = 0
    false_positives: int = 0
    found: int = 0
    missed: int = 0
    true_negatives: int = 0

    def __add__(self, other: "Confusion") -> "Confusion":
        mine, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return Confusion(*(a + b for a, b in zip(mine, theirs, strict=True)))

    @property
    def accuracy(self) -> float:
        """(TP + TN) / (TP + TN + FP + FN); 1 where there was nothing to count."""
        right = self.true_positives + self.true_negatives
        return _share(right, right + self.false_positives + self.missed)

    @property
    def precision(self) -> float:
        """True positives by detected segments; 1 where nothing was detected."""
        return _share(self.true_positives, self.true_positives + self.false_positives)

    @property
    def recall(self) -> float:
        """Found changes by changes; 1 where there was none to find."""
        return _share(self.found, self.found + self.missed)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.precision * self.recall / max(self.precision + self.recall, 1e-300)


def confusion(
    pair: LabelledPair, labels_before: Int[np.ndarray, " n0"], labels_after: Int[np.ndarray, " n1"]
) -> Confusion:
    """What of a pair was rightly and wrongly reported as changed, in both clouds together.

    Args:
        pair: with the things that its points belong to.
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.

    Raises:
        InputError: the pair has no things.
    """
    scores = score_labelled_pair(pair, labels_before, labels_after)
    sides = ((pair.before, labels_before), (pair.after, labels_after))
    return Confusion(
        true_positives=scores.true_segments,
        false_positives=scores.false_segments,
        found=scores.found,
        missed=scores.changes - scores.found,
        true_negatives=sum(_true_negatives(pair.name, cloud, labels) for cloud, labels in sides),
    )


def opposite_confusion(
    pair: LabelledPair,
    labels_before: Int[np.ndarray, " n0"],
    labels_after: Int[np.ndarray, " n1"],
    kind: Literal["appeared", "disappeared"],
) -> Confusion:
    """The reports of one type alone, in a pair in which only changes of the other type happened (thesis 4.7).

    Every report counts as a false positive; the accuracy is TN / (TN + FP).

    Args:
        pair: with the things that its points belong to; without changes of this type.
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.
        kind: the type that did not happen.

    Raises:
        InputError: the pair has no things, or changes of this type.
    """
    appeared = kind == "appeared"
    cloud, labels = (pair.after, labels_after) if appeared else (pair.before, labels_before)
    if (cloud.truth >= 0).any():
        raise InputError(f"{pair.name}: something {kind} in it; the accuracy of the opposite type needs a pair without")
    return Confusion(
        false_positives=len(np.unique(labels[labels >= 0])), true_negatives=_true_negatives(pair.name, cloud, labels)
    )


def overlap_confusion(
    pair: LabelledPair, labels_before: Int[np.ndarray, " n0"], labels_after: Int[np.ndarray, " n1"]
) -> Confusion:
    """As the thesis counts (4.6): a report that overlaps a change is a true positive.

    It overlaps it when a tenth of its points changed; a change is found when a tenth of its points lie in true
    positives.

    Args:
        pair: with the things that its points belong to.
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.

    Raises:
        InputError: the pair has no things.
    """
    return _overlaps(pair.name, pair.before, labels_before) + _overlaps(pair.name, pair.after, labels_after)


def _overlaps(name: str, cloud: LabelledCloud, labels: Int[np.ndarray, " n"]) -> Confusion:
    changed, counted = cloud.truth >= 0, ~np.isin(cloud.truth, list(cloud.not_counted))
    segments = {int(number): labels == number for number in np.unique(labels[labels >= 0])}
    right = [number for number, own in segments.items() if changed[own].mean() >= OVERLAP]
    false = [number for number in segments if number not in right]
    # Those that are only of changes that nobody is asked to find are neither.
    true = [number for number in right if (changed & counted)[segments[number]].any()]
    in_true = np.isin(labels, true)
    changes = [in_true[cloud.truth == number].mean() for number in np.unique(cloud.truth[changed & counted])]
    found = sum(bool(share >= OVERLAP) for share in changes)
    return Confusion(
        true_positives=len(true),
        false_positives=len(false),
        found=found,
        missed=len(changes) - found,
        true_negatives=_true_negatives(name, cloud, np.where(np.isin(labels, false), labels, -1)),
    )


def _true_negatives(name: str, cloud: LabelledCloud, labels: Int[np.ndarray, " n"]) -> int:
    if cloud.things is None:
        raise InputError(f"{name}: has no things; accuracy needs to know the thing that each point belongs to")
    false = [segment for segment, truth in segment_truth(labels, cloud).items() if truth == FALSE]
    return len(
        _unchanged_things(cloud.things, cloud.truth)
        - {_largest_part(cloud.things[labels == segment]) for segment in false}
    )


def _unchanged_things(things: Int[np.ndarray, " n"], truth: Int[np.ndarray, " n"]) -> set[int]:
    """The things most of whose points did not change."""
    points = np.bincount(things[things >= 0])
    unchanged = np.bincount(things[(things >= 0) & (truth < 0)], minlength=len(points))
    return set(np.flatnonzero(2 * unchanged > points).tolist())


def _largest_part(things: Int[np.ndarray, " n"]) -> int:
    """The thing that most of a segment's points belong to."""
    numbers, counts = np.unique(things, return_counts=True)
    return int(numbers[counts.argmax()])


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 1.0
