"""Why candidates are changes, or none, in words: the same on the terminal and in the report."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gmmjax.changes import Change, Changes, Contribution, Explanation, RejectedCandidate
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.quantities import percent
from gmmjax.reporting.summary import measures_text, place_cells

GAP = "  "
# Contributions below it are given as a sum alone: 0.1 changes a probability of 0.5 by 0.025.
LISTED = 0.1


class Facts(NamedTuple):
    """The facts of a candidate that are listed, the strongest first, and the others."""

    listed: Sequence[Contribution]
    others: Sequence[Contribution]

    @classmethod
    def of(
        cls, explanation: Explanation, most: int | None = None, *, against_first: bool = False, least: float = LISTED
    ) -> "Facts":
        """List the `most` strongest contributions of a magnitude of at least `least`; those against first, if asked."""
        ranked = sorted(
            explanation.contributions,
            key=lambda one: (abs(one.log_odds) < least, against_first and one.log_odds > 0, -abs(one.log_odds)),
        )
        count = sum(abs(one.log_odds) >= least for one in ranked)
        count = count if most is None else min(count, most)
        return cls(ranked[:count], ranked[count:])

    @property
    def sum_of_others(self) -> tuple[str, str] | None:
        """The sum of the others and their number: ("+0.3", "12 more facts together"); None where there are none."""
        count = len(self.others)
        more = "more " if self.listed else ""
        total = signed(sum((one.log_odds for one in self.others), 0.0))
        return (total, f"{count} {more}fact{'s' * (count != 1)} together") if count else None


def signed(log_odds: float) -> str:
    """Give log odds to one decimal, always with their sign: "+3.1", "−0.4"."""
    # Adding 0.0 makes a zero of minus zero.
    return f"{round(log_odds, 1) + 0.0:+.1f}".replace("-", "−")


def verdict_text(explanation: Explanation) -> str:
    """Give the three probabilities: "changed 95 %, unchanged 4 %, not observed 1 %"."""
    return (
        f"changed {percent(explanation.changed)}, unchanged {percent(explanation.unchanged)}, "
        f"not observed {percent(explanation.unobserved)}"
    )


def rejected_text(changes: Changes) -> str | None:
    """Say how many candidates were rejected, without a full stop; None where there were none."""
    count = len(changes.rejected)
    were = "candidate was" if count == 1 else "candidates were"
    return f"{count:,} {were} rejected" if count else None


def displaced_text(changes: Changes) -> str | None:
    """Say what is off the other scan's surface by more than noise and registration explain, and was judged unchanged.

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
    """Say that probabilities are multiplied by the registration's confidence; None where that is certain."""
    confidence = changes.registration.confidence
    if confidence == 1:
        return None
    return f"Probabilities of changes are these, multiplied by the registration's confidence of {percent(confidence)}."


def explanation_lines(changes: Changes, width: int, *, only: int | None = None) -> Iterator[tuple[str, str]]:
    """Yield the lines for a terminal, each with its style: the changes and their facts, then the rejected candidates.

    Args:
        changes: what was found.
        width: of the terminal, characters.
        only: label of the one change that is explained, a moved object with its partner; None: all of them, and the
            rejected candidates.
    """
    if not changes.items and not changes.rejected:
        yield "Nothing to explain: nothing looked changed.", "dim"
        return
    explained = any(change.explanation is not None for change in changes.items)
    if not explained and not changes.rejected:
        yield from _wrapped(
            "", "No explanations: facts are measured on scans only, by joint with evidence.", width, "dim"
        )
        return
    yield from _wrapped("", "Contributions to the log odds of a change, the strongest first:", width, "dim")
    if explained:
        yield from _of_changes(changes, width, only)
    if (text := confidence_text(changes)) is not None:
        yield from _wrapped("", text, width, "dim")
    if changes.rejected and only is None:
        yield from _of_rejected(changes, width)


def _of_changes(changes: Changes, width: int, only: int | None) -> Iterator[tuple[str, str]]:
    names = [f"{label}{GAP}● {_kind(change)}" for label, change in enumerate(changes.items)]
    longest = max(map(len, names))
    for label, (name, change) in enumerate(zip(names, changes.items, strict=True)):
        if change.explanation is None or (only is not None and only not in (label, change.partner)):
            continue
        heading = f"{name:<{longest}}{GAP}"
        yield from _wrapped(heading, verdict_text(change.explanation), width, KIND_COLORS[change.kind])
        if (text := measures_text(changes, change)) is not None:
            yield from _wrapped(4 * " ", text, width, "")
        yield from _facts(Facts.of(change.explanation, most=5), width)


def _kind(change: Change) -> str:
    return change.kind if change.partner is None else f"{change.kind} (with {change.partner})"


def _of_rejected(changes: Changes, width: int) -> Iterator[tuple[str, str]]:
    # More would scroll the changes off the screen.
    listed = changes.rejected[:10]
    left = len(changes.rejected) - len(listed)
    yield "", ""
    yield f"{rejected_text(changes)}{f', the likeliest {len(listed)}' * bool(left)}:", "bold"
    for candidate in listed:
        count, centre, _ = place_cells(candidate)
        place = f"{count} point{'s' * (candidate.point_count != 1)} at {centre}"
        yield from _wrapped(_heading(candidate, listed), place, width, KIND_COLORS[candidate.kind])
        yield from _facts(Facts.of(candidate.explanation, most=2, against_first=True), width)
    if left:
        yield from _wrapped("", f"{left:,} more are in report.html and changes.json.", width, "dim")


def _heading(candidate: RejectedCandidate, listed: tuple[RejectedCandidate, ...]) -> str:
    """Give kind, probability and reason, in columns."""
    kinds, reasons = max(len(one.kind) for one in listed), max(len(one.reason) for one in listed)
    share = percent(candidate.probability)
    return f"● {candidate.kind:<{kinds}}{GAP}{share:>5}{GAP}{candidate.reason:<{reasons}}{GAP}"


def _facts(facts: Facts, width: int) -> Iterator[tuple[str, str]]:
    for one in facts.listed:
        yield from _wrapped(f"{signed(one.log_odds):>7}{GAP}", one.sentence, width, "")
    if facts.sum_of_others is not None:
        total, text = facts.sum_of_others
        yield from _wrapped(f"{total:>7}{GAP}", text, width, "dim")


def _wrapped(heading: str, text: str, width: int, style: str) -> Iterator[tuple[str, str]]:
    """Yield the text after the heading, its further lines below its beginning."""
    # In a terminal that leaves hardly any room for the text it is better that it wraps by itself.
    for line in broken(text, max(width, len(heading) + 20), heading, " " * len(heading)):
        yield line, style


def broken(text: str, width: int, first: str = "", further: str = "") -> list[str]:
    """Break a text into lines between words and never within one, the first and the further ones indented."""
    lines = textwrap.wrap(
        text, width, initial_indent=first, subsequent_indent=further, break_long_words=False, break_on_hyphens=False
    )
    return lines or [first]
