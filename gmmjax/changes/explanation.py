"""Why a candidate is a change, or is none: the facts that decided, each with its part in the log odds."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from gmmjax.changes.plain_values import finite, probability, text


@dataclasses.dataclass(frozen=True)
class Contribution:
    """One fact of a candidate, and what it adds to the verdict.

    Attributes:
        fact: its name.
        value: as measured, without a unit.
        log_odds: what it adds to the log odds of a change against the likelier of the alternatives (unchanged, not
            observed), compared with an average candidate.
        sentence: the fact in words, such as "92 % of it lies where the other survey saw through".

    Raises:
        ValueError: a value or log odds that are not finite.
    """

    fact: str
    value: float
    log_odds: float
    sentence: str

    def __post_init__(self) -> None:
        if not math.isfinite(self.value) or not math.isfinite(self.log_odds):
            raise ValueError(f"the fact {self.fact} is not finite: {self.value}, log odds {self.log_odds}")

    def to_dict(self) -> dict[str, Any]:
        """The contribution as plain values."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Contribution":
        """The contribution that `to_dict` made plain.

        Raises:
            KeyError, TypeError, ValueError: it is no such dictionary.
        """
        value, log_odds = float(finite(content["value"])), float(finite(content["log_odds"]))
        return cls(text(content["fact"]), value, log_odds, text(content["sentence"]))


@dataclasses.dataclass(frozen=True)
class Explanation:
    """The verdict on one candidate.

    Attributes:
        changed: probability that it is a change.
        unchanged: that both surveys observed the same there, but for noise, registration error and density.
        unobserved: that the other survey did not observe the place.
        contributions: of all facts, those with the greatest magnitude first.

    Raises:
        ValueError: a probability that does not lie between 0 and 1.
    """

    changed: float
    unchanged: float
    unobserved: float
    contributions: tuple[Contribution, ...]

    def __post_init__(self) -> None:
        for name in ("changed", "unchanged", "unobserved"):
            # The comparison is false for NaN.
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"the probability {name} must lie between 0 and 1, not {getattr(self, name)}")

    def to_dict(self) -> dict[str, Any]:
        """The explanation as plain values."""
        return {
            "changed": self.changed,
            "unchanged": self.unchanged,
            "unobserved": self.unobserved,
            "contributions": [contribution.to_dict() for contribution in self.contributions],
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Explanation":
        """The explanation that `to_dict` made plain.

        Raises:
            KeyError, TypeError, ValueError: it is no such dictionary.
        """
        return cls(
            changed=probability(content["changed"]),
            unchanged=probability(content["unchanged"]),
            unobserved=probability(content["unobserved"]),
            contributions=tuple(Contribution.from_dict(one) for one in content["contributions"]),
        )
