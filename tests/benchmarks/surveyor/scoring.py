"""The scores of detections in scenes of which some points cannot be judged."""

import numpy as np

from gmmjax.evaluation import LabelledCloud, Scores, score_pair
from gmmjax.evaluation.scores import segment_truth
from gmmjax.pair import Pair, each
from tests.benchmarks.surveyor.solids import UNJUDGED
from tests.benchmarks.surveyor.surveys import SurveyedPair


def scores(pair: SurveyedPair, labels: Pair[np.ndarray]) -> Scores:
    """Segment and point counts, as `gmmjax.evaluation.Scores` has them, over the points that can be judged.

    Args:
        pair: with the truth.
        labels: per point -1 or the number of a detected change.
    """
    judged = pair.truth.map(lambda truth: truth != UNJUDGED)
    own = each(lambda label, rows: label[rows], labels, judged)
    truth = each(lambda label, rows: label[rows], pair.truth, judged)
    return score_pair(*own, *truth)


def of_unjudged_changes(pair: SurveyedPair, labels: Pair[np.ndarray]) -> int:
    """How many of the false segments are mostly of changes that are too small or too thin to be judged.

    Few of the points of such a segment are judged, those of its rim: by these it is false.

    Args:
        pair: with the truth.
        labels: per point -1 or the number of a detected change.
    """
    number = 0
    for truth, source, label in zip(pair.truth, pair.source, labels, strict=True):
        judged = truth != UNJUDGED
        segments = segment_truth(label[judged], LabelledCloud(np.zeros((judged.sum(), 3)), truth[judged]))
        false = [segment for segment, change in segments.items() if change < 0]
        number += sum(bool((source[label == segment] >= 0).mean() > 0.5) for segment in false)
    return number


def mistakes(pair: SurveyedPair, labels: Pair[np.ndarray]) -> list[str]:
    """Each change that was not found and each segment that is none, with its points and its place: for reading."""
    lines = []
    for side, points, truth, label in zip(("before", "after"), pair.points, pair.truth, labels, strict=True):
        judged = truth != UNJUDGED
        points, truth, label = points[judged], truth[judged], label[judged]
        segments = segment_truth(label, LabelledCloud(points, truth))
        true = np.isin(label, [segment for segment, number in segments.items() if number >= 0])
        for number in np.unique(truth[truth >= 0]):
            own = truth == number
            if true[own].mean() < 0.5:
                lines.append(
                    f"{side}: change {number} missed, {_place(points[own])}, {true[own].mean():.0%} of it found"
                )
        for segment in (segment for segment, number in segments.items() if number < 0):
            own = label == segment
            lines.append(
                f"{side}: segment {segment} is none, {_place(points[own])}, {(truth[own] >= 0).mean():.0%} changed"
            )
    return lines


def _place(points: np.ndarray) -> str:
    middle, extent = np.median(points, axis=0), np.ptp(points, axis=0)
    where = ", ".join(f"{value:.1f}" for value in middle)
    return f"{len(points)} points about ({where}), {extent[0]:.1f} x {extent[1]:.1f} x {extent[2]:.1f} m"
