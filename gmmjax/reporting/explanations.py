"""Why candidates are changes, or none, in words: the same on the terminal and in the report."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from gmmjax.changes import Changes, Contribution, Explanation
from gmmjax.reporting.summary import percent, place_cells

Side = Literal["for", "against"]


# Contributions below it are given as a sum alone: 0.1 changes a probability of 0.5 by 0.025.
LISTED_LOG_ODDS = 0.1


class Facts(NamedTuple):
    """The facts of a candidate that are listed, and the others.

    Attributes:
        listed: the strongest first.
        others: what is left.
    """

    listed: Sequence[Contribution]
    others: Sequence[Contribution]

    @classmethod
    def of(
        cls,
        explanation: Explanation,
        most: int | None = None,
        first: Side | None = None,
        least_log_odds: float = LISTED_LOG_ODDS,
    ) -> "Facts":
        """The facts that contribute enough, and at most a number of them.

        Args:
            explanation: of a candidate.
            most: number of them; None: all.
            first: those that speak for a change, or against it, come before the others; None: by magnitude alone.
            least_log_odds: magnitude of the contributions that are listed.
        """

        def rank(one: Contribution) -> tuple[bool, bool, float]:
            small = abs(one.log_odds) < least_log_odds
            return small, first is not None and (one.log_odds > 0) != (first == "for"), -abs(one.log_odds)

        ranked = sorted(explanation.contributions, key=rank)
        count = sum(abs(one.log_odds) >= least_log_odds for one in ranked)
        count = count if most is None else min(count, most)
        return cls(ranked[:count], ranked[count:])

    @property
    def sum_of_others(self) -> tuple[str, str] | None:
        """What the others add up to, and how many they are: ("+0.3", "12 more facts"); None where there are none."""
        count = len(self.others)
        more = "more " if self.listed else ""
        total = signed(sum((one.log_odds for one in self.others), 0.0))
        return (total, f"{count} {more}fact{'s' * (count != 1)} together") if count else None


def signed(log_odds: float) -> str:
    """Log odds to one decimal, always with their sign: "+3.1", "−0.4"."""
    # Adding 0.0 makes a zero of minus zero.
    return f"{round(log_odds, 1) + 0.0:+.1f}".replace("-", "−")


def verdict_text(explanation: Explanation) -> str:
    """The three probabilities: "changed 95 %, unchanged 4 %, not observed 1 %"."""
    return (
        f"changed {percent(explanation.changed)}, unchanged {percent(explanation.unchanged)}, "
        f"not observed {percent(explanation.unobserved)}"
    )


def rejected_text(changes: Changes) -> str | None:
    """How many candidates were rejected, without a full stop; None where there were none."""
    count = len(changes.rejected)
    were = "candidate was" if count == 1 else "candidates were"
    return f"{count:,} {were} rejected" if count else None


def displaced_text(changes: Changes) -> str | None:
    """What is off the other scan's surface by more than noise and registration explain, and was judged unchanged.

    None where there is no such candidate. A surface that bends by a few noises over many metres looks the same
    whether a wall gave way or the scan drifted: the verdict is learned from scans that drift.
    """
    found = [one for one in changes.rejected if one.reason == "unchanged" and _mostly_displaced(one.explanation)]
    if not found:
        return None
    largest = max(found, key=lambda one: one.point_count)
    points, centre, _ = place_cells(largest)
    place = f"{points} points at {centre}"
    most = f"points of {len(found):,} candidates, the largest of {place}," if len(found) > 1 else f"of the {place}"
    return (
        f"Most {most} lie surely off the other scan's surface and were judged unchanged: a bent or drifting scan "
        "looks like that, too. Their distances tell how far they are off."
    )


def _mostly_displaced(explanation: Explanation) -> bool:
    return any(one.fact == "displaced" and one.value > 0.5 for one in explanation.contributions)


def confidence_text(changes: Changes) -> str | None:
    """That the confidence in the registration comes on top of the verdicts; None where it is certain."""
    confidence = changes.registration.confidence
    if confidence == 1:
        return None
    return f"Probabilities of changes are these, multiplied by the registration's confidence of {percent(confidence)}."
