"""The probability that two matched objects are one: a logistic model of the facts of their match, learned beforehand.

Its parameters are in `same_object.json`, which `python -m gmmjax.learning.same_object` makes from simulated scenes.
"""

import dataclasses
import functools
import json
from collections.abc import Mapping
from importlib import resources
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.changes.objects.match import Match
from gmmjax.geometry import LocalSurface, transformed
from gmmjax.pair import Pair

# What is known beforehand of the motion: that it keeps the object on its support plane; nothing; that the object was
# moved within its old place.
Situation = Literal["standing", "free", "in place"]
PARAMETER_FILE = "same_object.json"
# Standard deviations from the mean, at most, that a fact counts: beyond, nothing was learned.
FARTHEST = 4.0
# Log odds of one pair by itself, at most: among look-alikes that all fit well, a slightly better fit tells little.
MAX_LOG_ODDS = 3.0


class MatchFacts(NamedTuple):
    """The facts of a match, without a unit; each is finite, and of moderate size.

    Attributes:
        covered: fraction of the points that lie on the other object, of the object where it is larger.
        explained: of the changes, the fraction that lies on the other object, as `InPlaceMotion.explained`; of an
            object that was put elsewhere that of its points, of the object where it is smaller.
        contradicted: square root of the fraction of the points that the other survey must have observed, but did not,
            both fractions added up.
        observability: how well the normals determine a translation, of the object where it is less: 0 where it can
            slide along itself, as a plane or a pipe can.
        thickness: logarithm of the third principal extent of the smaller object, in spacings, at most that of 10.
        distance: that the object's middle moves beyond its radius, in radii, at most 1: what moved within its place
            overlaps the place where it was.
    """

    covered: float
    explained: float
    contradicted: float
    observability: float
    thickness: float
    distance: float

    @classmethod
    def of(cls, match: Match, parts: Pair[LocalSurface], explained: float | None = None) -> "MatchFacts":
        """Measure the facts of a match.

        Args:
            match: of the two objects.
            parts: what disappeared from the before cloud, and what appeared in the after cloud.
            explained: of the changes, the fraction that lies on the other object; None: all of both objects is a
                change.
        """
        sides = match.there, match.back
        covered = [side.covered for side in sides]
        smaller = min(parts, key=lambda part: _radius(part.points))
        thickness = principal_extents(smaller.points)[2] / max(part.nearest_distance for part in parts)
        middle = parts.before.points.mean(axis=0)
        moved_by = float(np.linalg.norm(transformed(middle[None], match.transform)[0] - middle))
        return cls(
            covered=max(covered),
            explained=min(covered) if explained is None else explained,
            contradicted=float(np.sqrt(sum(side.contradicted for side in sides))),
            observability=min(float(observability(part)[0]) for part in parts),
            thickness=float(np.log(np.clip(thickness, 0.1, 10.0))),
            distance=float(np.clip(moved_by / _radius(smaller.points) - 1.0, 0.0, 1.0)),
        )


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

    def log_odds(self, facts: MatchFacts) -> float:
        """Log odds that two matched objects are one, before other partners are considered."""
        standardised = np.clip((np.array(facts) - self.means) / self.scales, -FARTHEST, FARTHEST)
        return float(self.intercept + self.weights @ standardised)


class SameObjectModel(dict[Situation, LogisticWeights]):
    """The probability that two matched objects are one: a logistic model for each situation."""

    def to_json(self) -> str:
        """The parameters as text."""
        situations = {
            name: {field: np.asarray(value).tolist() for field, value in vars(own).items()}
            for name, own in self.items()
        }
        return json.dumps({"facts": MatchFacts._fields, "situations": situations}, indent=1, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str) -> "SameObjectModel":
        """The model that `to_json` wrote.

        Raises:
            ValueError: other facts, which must be learned again.
        """
        content: Mapping[str, Any] = json.loads(text)
        if content["facts"] != list(MatchFacts._fields):
            raise ValueError("other facts: make the file with python -m gmmjax.learning.same_object")
        models = cls()
        for name in get_args(Situation):
            own = content["situations"][name]
            means, scales, weights = (np.array(own[field], np.float64) for field in ("means", "scales", "weights"))
            models[name] = LogisticWeights(means, scales, weights, own["intercept"])
        return models


@functools.cache
def shipped_model() -> SameObjectModel:
    """The model of the package."""
    return SameObjectModel.from_json((resources.files(__package__) / PARAMETER_FILE).read_text())


def pairing_probabilities(log_odds: Float[np.ndarray, "g n"]) -> Float[np.ndarray, "g n"]:
    """The probability of each pair when every change has at most one partner, or none.

    The odds of a pair by those of all pairs that share a change with it, and of none.

    Args:
        log_odds: of each disappeared (row) and appeared change (column) that they are one object, considered by
            themselves; minus infinity: they are not.
    """
    odds = np.exp(np.minimum(log_odds, MAX_LOG_ODDS))
    return np.asarray(odds / (1 + odds.sum(axis=0, keepdims=True) + odds.sum(axis=1, keepdims=True) - odds))


def principal_extents(points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " 3"]:
    """The extents along the principal axes, longest first, of points that fill them evenly: sqrt 12 deviations."""
    variances = np.linalg.eigvalsh(np.cov(points.T, bias=True))
    return np.asarray(np.sqrt(12 * np.maximum(variances[::-1], 0)))


def observability(part: LocalSurface) -> Float64[np.ndarray, " 3"]:
    """The information of the normals of an object on its translation, least first: 0 where it can slide along itself.

    The square roots of the eigenvalues of the normal equations of point-to-plane ICP for translations (Gelfand,
    Ikemoto, Rusinkiewicz and Levoy 2003): one of them is 0 for a pipe, two for a plane.
    """
    information = np.linalg.eigvalsh(part.normals.T @ part.normals / len(part))
    return np.asarray(np.sqrt(np.maximum(information, 0)))


def _radius(points: Float[np.ndarray, "n 3"]) -> float:
    return max(float(np.sqrt(points.var(axis=0).sum())), np.finfo(np.float64).tiny)
