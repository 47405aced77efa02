"""Confusion counts with true negatives, the unchanged things of a scene (thesis 4.6, figures 4.9 to 4.12)."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Int

from gmmjax.errors import InputError
from gmmjax.evaluation import LabelledCloud, LabelledPair, false_segments, score_labelled_pair

# Least fraction of a segment's points that changed for it to overlap a change, and of a change's points in true
# positives for it to be found.
OVERLAP = 0.1


@dataclasses.dataclass(frozen=True)
class Confusion:
    """Counts over one or many pairs; add them before dividing (micro average).

    Segments and changes are as in `Scores`. Things are Gaussians, objects and walls. A true negative is a thing of one
    of the two clouds that did not change, and that no false segment has most of its points on.

    Attributes:
        true_positives: detected segments that are a change.
        false_positives: detected segments that are none.
        found: true changes that were found.
        missed: true changes that were not found.
        true_negatives: unchanged things without a false segment.
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
        correct = self.true_positives + self.true_negatives
        return _fraction(correct, correct + self.false_positives + self.missed)

    @property
    def precision(self) -> float:
        """True positives by detected segments; 1 where nothing was detected."""
        return _fraction(self.true_positives, self.true_positives + self.false_positives)

    @property
    def recall(self) -> float:
        """Found changes by changes; 1 where there was none to find."""
        return _fraction(self.found, self.found + self.missed)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.precision * self.recall / max(self.precision + self.recall, 1e-300)


def confusion(
    pair: LabelledPair, labels_before: Int[np.ndarray, " n0"], labels_after: Int[np.ndarray, " n1"]
) -> Confusion:
    """The confusion counts of a pair, of both clouds together.

    Args:
        pair: with the thing of each point.
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
    """The confusion counts of one type of change, in a pair with changes of the other type only (thesis 4.7).

    Every detected segment is a false positive; the accuracy is TN / (TN + FP).

    Args:
        pair: with the thing of each point; without changes of this type.
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.
        kind: the type that did not occur.

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
    """The confusion counts as in the thesis (4.6): a segment that overlaps a change is a true positive.

    A segment overlaps a change when a tenth of its points changed; a change is found when a tenth of its points lie in
    true positives.

    Args:
        pair: with the thing of each point.
        labels_before: per point -1 or the id of a detected change.
        labels_after: the same for the after cloud.

    Raises:
        InputError: the pair has no things.
    """
    return _overlaps(pair.name, pair.before, labels_before) + _overlaps(pair.name, pair.after, labels_after)


def _overlaps(name: str, cloud: LabelledCloud, labels: Int[np.ndarray, " n"]) -> Confusion:
    changed, counted = cloud.truth >= 0, ~np.isin(cloud.truth, list(cloud.not_counted))
    segments = {int(number): labels == number for number in np.unique(labels[labels >= 0])}
    overlapping = [number for number, own in segments.items() if changed[own].mean() >= OVERLAP]
    false = [number for number in segments if number not in overlapping]
    # Segments that overlap only changes that are not counted are neither true nor false.
    true = [number for number in overlapping if (changed & counted)[segments[number]].any()]
    in_true = np.isin(labels, true)
    fractions = [in_true[cloud.truth == number].mean() for number in np.unique(cloud.truth[changed & counted])]
    found = sum(bool(fraction >= OVERLAP) for fraction in fractions)
    return Confusion(
        true_positives=len(true),
        false_positives=len(false),
        found=found,
        missed=len(fractions) - found,
        true_negatives=_true_negatives(name, cloud, np.where(np.isin(labels, false), labels, -1)),
    )


def _true_negatives(name: str, cloud: LabelledCloud, labels: Int[np.ndarray, " n"]) -> int:
    if cloud.things is None:
        raise InputError(f"{name}: has no things; accuracy needs to know the thing that each point belongs to")
    reported = {_most_frequent(cloud.things[labels == segment]) for segment in false_segments(labels, cloud)}
    return len(_unchanged_things(cloud.things, cloud.truth) - reported)


def _unchanged_things(things: Int[np.ndarray, " n"], truth: Int[np.ndarray, " n"]) -> set[int]:
    """The things of whose points more than half did not change."""
    points = np.bincount(things[things >= 0])
    unchanged = np.bincount(things[(things >= 0) & (truth < 0)], minlength=len(points))
    return set(np.flatnonzero(2 * unchanged > points).tolist())


def _most_frequent(things: Int[np.ndarray, " n"]) -> int:
    numbers, counts = np.unique(things, return_counts=True)
    return int(numbers[counts.argmax()])


def _fraction(part: int, whole: int) -> float:
    """1 where there is nothing to count."""
    return part / whole if whole else 1.0
