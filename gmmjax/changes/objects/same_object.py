"""The probability that two matched objects are one: a logistic model of the facts of their match, learned beforehand.

Its parameters are in `same_object.json`, which `python -m gmmjax.learning.same_object` makes from simulated scenes.
"""

import dataclasses
import functools
import json
from collections.abc import Mapping
from importlib import resources
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float64

from gmmjax.changes.objects.match_facts import MatchFacts
from gmmjax.errors import InputError

# What is known beforehand of the motion: that it keeps the object on its support plane; nothing; that the object was
# moved within its old place.
Situation = Literal["standing", "free", "in place"]
SCHEMA_VERSION = 1
PARAMETER_FILE = "same_object.json"


@dataclasses.dataclass(frozen=True, eq=False)
class LogisticWeights:
    """One logistic model.

    Attributes:
        means: of the facts, over the examples that it was learned from.
        scales: standard deviations of the facts there.
        weights: what a standard deviation of each fact adds to the log odds.
        intercept: log odds at the means.
    """

    means: Float64[np.ndarray, " f"]
    scales: Float64[np.ndarray, " f"]
    weights: Float64[np.ndarray, " f"]
    intercept: float

    def log_odds(self, facts: MatchFacts, farthest: float) -> float:
        """Log odds that the objects are one; a fact counts at most `farthest` standard deviations from its mean."""
        standardised = np.clip((facts.vector() - self.means) / self.scales, -farthest, farthest)
        return float(self.intercept + self.weights @ standardised)


@dataclasses.dataclass(frozen=True, eq=False)
class SameObjectModel:
    """The probability that two matched objects are one.

    Attributes:
        situations: a logistic model for each.
        farthest: standard deviations from the mean, at most, that a fact counts: beyond, nothing was learned.
    """

    situations: Mapping[Situation, LogisticWeights]
    farthest: float = 4.0

    def log_odds(self, facts: MatchFacts, situation: Situation) -> float:
        """Log odds that two matched objects are one, before other partners are considered."""
        return self.situations[situation].log_odds(facts, self.farthest)

    def to_dict(self) -> dict[str, Any]:
        """The parameters as plain values."""
        return {
            "schema_version": SCHEMA_VERSION,
            "farthest": self.farthest,
            "facts": list(MatchFacts._fields),
            "situations": {
                name: {
                    "means": own.means.tolist(),
                    "scales": own.scales.tolist(),
                    "weights": own.weights.tolist(),
                    "intercept": own.intercept,
                }
                for name, own in self.situations.items()
            },
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], source: str) -> "SameObjectModel":
        """The model that `to_dict` made plain.

        Args:
            content: plain values.
            source: where they are from, for the message.

        Raises:
            InputError: another version, other facts, or numbers that are missing or not finite.
        """
        if content.get("schema_version") != SCHEMA_VERSION or content.get("facts") != list(MatchFacts._fields):
            raise InputError(
                f"{source}: is not of version {SCHEMA_VERSION}, or of other facts; make it with "
                "python -m gmmjax.learning.same_object"
            )
        try:
            situations = {name: _weights(content["situations"][name]) for name in get_args(Situation)}
            return cls(situations, float(content["farthest"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{source}: is not a complete model ({type(error).__name__}: {error}); make it with "
                "python -m gmmjax.learning.same_object"
            ) from error


@functools.cache
def shipped_model() -> SameObjectModel:
    """The model of the package."""
    file = resources.files(__package__) / PARAMETER_FILE
    return SameObjectModel.from_dict(json.loads(file.read_text()), PARAMETER_FILE)


def _weights(content: Mapping[str, Any]) -> LogisticWeights:
    count = len(MatchFacts._fields)
    means, scales, weights = (np.array(content[name], np.float64) for name in ("means", "scales", "weights"))
    arrays = means, scales, weights
    intercept = float(content["intercept"])
    if any(array.shape != (count,) or not np.isfinite(array).all() for array in arrays) or not np.isfinite(intercept):
        raise ValueError(f"means, scales, weights and intercept must be finite, {count} of each and one")
    if not (scales > 0).all():
        raise ValueError("scales must be positive")
    return LogisticWeights(means, scales, weights, intercept)
