"""Reliability of the reported probabilities: what is reported at 0.9 should be true nine times in ten."""

import dataclasses
import json
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.evaluation.detectors import Detection
from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair
from gmmjax.evaluation.scores import NEITHER, counted_points, segment_truth

BINS = 10


@dataclasses.dataclass(frozen=True, eq=False)
class Reliability:
    """A reliability curve: probabilities in ten equal bins, beside how often what they say is true.

    Attributes:
        count: probabilities in each bin.
        predicted: their sum.
        true: how many of them say what is true.
        squared_error: sum over all of (probability - truth)^2.
    """

    count: Int[np.ndarray, " bins"]
    predicted: Float[np.ndarray, " bins"]
    true: Int[np.ndarray, " bins"]
    squared_error: float

    @classmethod
    def of(cls, probability: Float[np.ndarray, " n"], truth: Bool[np.ndarray, " n"]) -> "Reliability":
        """The curve of some probabilities.

        Args:
            probability: that something is so, 0 to 1.
            truth: whether it is.
        """
        number = np.minimum((probability * BINS).astype(int), BINS - 1)
        return cls(
            count=np.bincount(number, minlength=BINS),
            # The bincount of an empty array is of integers, whatever the weights.
            predicted=np.bincount(number, probability, minlength=BINS).astype(float),
            true=np.bincount(number[truth], minlength=BINS),
            squared_error=float(((probability - truth) ** 2).sum()),
        )

    def __add__(self, other: "Reliability") -> "Reliability":
        return Reliability(
            self.count + other.count,
            self.predicted + other.predicted,
            self.true + other.true,
            self.squared_error + other.squared_error,
        )

    @property
    def brier(self) -> float | None:
        """Mean squared difference of probability and truth (Brier 1950); None where there is nothing."""
        return self.squared_error / int(self.count.sum()) if self.count.any() else None

    @property
    def calibration_error(self) -> float | None:
        """Expected calibration error (Naeini et al. 2015): mean over the probabilities of |predicted - true| by bin."""
        return float(np.abs(self.predicted - self.true).sum() / self.count.sum()) if self.count.any() else None

    def to_dict(self) -> dict[str, Any]:
        """The curve as plain values; bins without a probability are left out."""
        filled = np.flatnonzero(self.count)
        return {
            "count": int(self.count.sum()),
            "brier": self.brier,
            "expected_calibration_error": self.calibration_error,
            "bins": [
                {
                    "from": round(number / BINS, 6),
                    "to": round((number + 1) / BINS, 6),
                    "count": int(self.count[number]),
                    "mean_probability": float(self.predicted[number] / self.count[number]),
                    "share_true": float(self.true[number] / self.count[number]),
                }
                for number in map(int, filled)
            ],
        }


NOTHING = Reliability.of(np.zeros(0), np.zeros(0, bool))


class ReliabilityRecord:
    """Gathers the probabilities that our detectors report; its `add` is what `evaluate` takes as `record`.

    Attributes:
        changes: by detector, the probabilities of the reported changes: whether each is one.
        points: by detector, the probabilities of all points: whether each has changed.
    """

    def __init__(self) -> None:
        self.changes: dict[str, Reliability] = {}
        self.points: dict[str, Reliability] = {}

    def add(self, name: str, pair: LabelledPair, detection: Detection) -> None:
        """Takes the probabilities of one detection; peers report none."""
        found = detection.changes
        if found is None:
            return
        sides = (
            (pair.before, found.labels_before, found.probability_before),
            (pair.after, found.labels_after, found.probability_after),
        )
        probabilities = np.array([change.probability for change in found.items])
        for cloud, labels, probability in sides:
            counted = counted_points(cloud)
            of_points = Reliability.of(probability[counted], cloud.truth[counted] >= 0)
            self.points[name] = self.points.get(name, NOTHING) + of_points
            self.changes[name] = self.changes.get(name, NOTHING) + _of_changes(probabilities, labels, cloud)

    def to_dict(self) -> dict[str, Any]:
        """The curves as plain values, by detector."""
        return {
            name: {"changes": self.changes[name].to_dict(), "points": self.points[name].to_dict()}
            for name in self.points
        }

    def to_json(self) -> str:
        """The curves as JSON."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)


def _of_changes(probabilities: np.ndarray, labels: np.ndarray, cloud: LabelledCloud) -> Reliability:
    truths = {segment: truth for segment, truth in segment_truth(labels, cloud).items() if truth != NEITHER}
    return Reliability.of(probabilities[list(truths)] if truths else np.zeros(0), np.array([*truths.values()]) >= 0)
