"""Confusion counts with true negatives, the unchanged things of a scene (thesis 4.6, figures 4.9 to 4.12)."""

import functools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from gmmjax.errors import ComputationError, InputError
from gmmjax.evaluation import (
    Detection,
    Detector,
    Failure,
    LabelledCloud,
    LabelledPair,
    PairSource,
    Scores,
    evaluate,
    false_segments,
    score_labelled_pair,
)

# Least fraction of a segment's points that changed for it to overlap a change, and of a change's points in true
# positives for it to be found.
OVERLAP = 0.1
COUNTS = ("true_positives", "false_positives", "found", "missed", "true_negatives")
Progress = Callable[[str, float], None]


class Group(NamedTuple):
    """Pairs of one kind and the detectors that are run on them, by name."""

    name: str
    detectors: Mapping[str, Detector]
    sources: Sequence[PairSource]


def count_groups(
    groups: Sequence[Group], progress: Progress
) -> tuple[dict[tuple[str, str], Counter[str]], tuple[Failure, ...]]:
    """Run detectors on pairs with things.

    Args:
        groups: of pairs; those of one name are added up.
        progress: called with a description of the current step and the fraction of them that is done.

    Returns:
        The sums of `confusion` by the names of group and detector, and what failed, which is not in them.

    Raises:
        ComputationError: everything failed.
    """
    counts: dict[tuple[str, str], Counter[str]] = {}
    failures: tuple[Failure, ...] = ()
    for number, group in enumerate(groups):
        report = functools.partial(partly, progress, number, len(groups))
        record = functools.partial(_add, counts, group.name)
        failures += evaluate(group.detectors, group.sources, progress=report, record=record).failures
    if failures and not counts:
        raise ComputationError(f"nothing could be run: {failures[0]}")
    return counts, failures


def confusion(pair: LabelledPair, found: Detection) -> Counter[str]:
    """The counts of a pair, both clouds together; add them over pairs before dividing (micro average).

    Things are Gaussians, objects and walls. A true negative is a thing of one of the two clouds that did not change,
    and that no false segment has most of its points on. "overlap ..." are the counts of segments by `OVERLAP`, as in
    the thesis; "opposite ..." those of clouds in which nothing changed, where every segment is false (4.7).

    Raises:
        InputError: the pair has no things.
    """
    counts = Counter(pairs=1)
    counts += _of_scores("", score_labelled_pair(pair, found.labels_before, found.labels_after))
    for cloud, labels in ((pair.before, found.labels_before), (pair.after, found.labels_after)):
        counts += _of_scores("overlap ", overlap_scores(cloud, labels))
        right = true_negatives(pair.name, cloud, labels)
        counts["true_negatives"] += right
        if not (cloud.truth >= 0).any():
            counts["opposite true_negatives"] += right
            counts["opposite false_positives"] += len(np.unique(labels[labels >= 0]))
    return counts


def measures(counts: Counter[str], kind: str = "") -> dict[str, float]:
    """Accuracy, precision, recall and F1; 1 where there is nothing to count.

    Args:
        counts: of `confusion`.
        kind: "", "overlap " or "opposite ".
    """
    positive, false, found, missed, negative = (counts[kind + name] for name in COUNTS)
    scores = Scores(positive, positive + false, found, found + missed)
    all_counted = positive + negative + false + missed
    accuracy = (positive + negative) / all_counted if all_counted else 1.0
    return {"accuracy": accuracy, "precision": scores.precision, "recall": scores.recall, "f1": scores.f1}


def true_negatives(name: str, cloud: LabelledCloud, labels: Int[np.ndarray, " n"]) -> int:
    """The things of whose points more than half did not change, and that hold the largest part of no false segment."""
    if cloud.things is None:
        raise InputError(f"{name}: has no things; accuracy needs to know the thing that each point belongs to")
    points = np.bincount(cloud.things[cloud.things >= 0])
    unchanged = np.bincount(cloud.things[(cloud.things >= 0) & (cloud.truth < 0)], minlength=len(points))
    false = [np.unique(cloud.things[labels == own], return_counts=True) for own in false_segments(labels, cloud)]
    reported = {int(things[counts.argmax()]) for things, counts in false}
    return len(set(np.flatnonzero(2 * unchanged > points).tolist()) - reported)


def overlap_scores(cloud: LabelledCloud, labels: Int[np.ndarray, " n"]) -> Scores:
    """The scores of a cloud as the thesis counts (4.6): a tenth of the points is enough, in place of half."""
    changed, counted = cloud.truth >= 0, ~np.isin(cloud.truth, list(cloud.not_counted))
    segments = [labels == number for number in np.unique(labels[labels >= 0])]
    overlapping = [own for own in segments if changed[own].mean() >= OVERLAP]
    # Segments that overlap only changes that are not counted are neither true nor false.
    true = [own for own in overlapping if (changed & counted)[own].any()]
    in_true = np.any([np.zeros(len(labels), bool), *true], axis=0)
    shares = [in_true[cloud.truth == number].mean() for number in np.unique(cloud.truth[changed & counted])]
    found = sum(bool(share >= OVERLAP) for share in shares)
    return Scores(len(true), len(segments) - len(overlapping) + len(true), found, len(shares))


def _of_scores(kind: str, scores: Scores) -> Counter[str]:
    numbers = scores.true_segments, scores.false_segments, scores.found, scores.changes - scores.found
    return Counter({kind + name: number for name, number in zip(COUNTS[:4], numbers, strict=True)})


def _add(
    counts: dict[tuple[str, str], Counter[str]], group: str, detector: str, pair: LabelledPair, found: Detection
) -> None:
    counts[group, detector] = counts.get((group, detector), Counter()) + confusion(pair, found)


def partly(progress: Progress, number: int, of: int, stage: str, share: float) -> None:
    """Report the progress of one part as that of the whole."""
    progress(stage, (number + share) / of)
