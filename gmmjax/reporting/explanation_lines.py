"""Why candidates are changes, or none, as lines for a terminal."""

import textwrap
from collections.abc import Iterator

from gmmjax.changes import Change, Changes, RejectedCandidate
from gmmjax.reporting.explanations import (
    Facts,
    confidence_text,
    rejected_text,
    signed,
    verdict_text,
)
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.summary import measures_text, percent, place_cells

GAP = "  "


def explanation_lines(changes: Changes, width: int, *, only: int | None = None) -> Iterator[tuple[str, str]]:
    """The lines, each with its style: the changes with their facts, then the rejected candidates with fewer.

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
        yield from _facts(Facts.of(candidate.explanation, most=2, first="against"), width)
    if left:
        yield from _wrapped("", f"{left:,} more are in report.html and changes.json.", width, "dim")


def _heading(candidate: RejectedCandidate, listed: tuple[RejectedCandidate, ...]) -> str:
    """Kind, probability and reason, in columns."""
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
    """The text after the heading, its further lines below its beginning."""
    # In a terminal that leaves hardly any room for the text it is better that it wraps by itself.
    room = max(width - len(heading), 20)
    lines = textwrap.wrap(text, room, break_long_words=False, break_on_hyphens=False) or [""]
    for number, line in enumerate(lines):
        yield (heading if number == 0 else " " * len(heading)) + line, style
