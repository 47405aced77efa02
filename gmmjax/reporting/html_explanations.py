"""Why candidates are changes, or none, as parts of the report."""

from html import escape

from gmmjax.changes import Changes, Contribution, Explanation, RejectedCandidate
from gmmjax.reporting.explanations import (
    ExplanationSettings,
    Facts,
    Side,
    confidence_text,
    rejected_text,
    signed,
    verdict_text,
)
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.summary import HEADINGS, percent, place_cells

REJECTED_HEADINGS = ("Kind", "Reason", *HEADINGS[2:-1])


def strongest_log_odds(changes: Changes) -> float:
    """The greatest magnitude of a contribution, which is as long as a bar can be; 0 where there is none."""
    explanations = [change.explanation for change in changes.items] + [one.explanation for one in changes.rejected]
    facts = (fact for own in explanations if own is not None for fact in own.contributions)
    return max((abs(fact.log_odds) for fact in facts), default=0.0)


def why_row(
    explanation: Explanation,
    side: Side,
    columns: int,
    longest: float,
    settings: ExplanationSettings = ExplanationSettings(),
) -> str:
    """A row of a table, closed at first: the verdict, and each fact with a bar for its contribution.

    Args:
        explanation: of the candidate in the row above.
        side: of the facts that decided; the strongest of them is shown while the row is closed.
        columns: of the table.
        longest: log odds of the longest bar.
        settings: which facts are listed.
    """
    facts, deciding = (Facts.of(explanation, settings.least_log_odds, None, first) for first in (None, side))
    rows = "".join(_fact(one, longest) for one in facts.listed)
    if facts.sum_of_others is not None:
        total, text = facts.sum_of_others
        rows += f'<li class="others"><b>{total}</b><span></span><span>{text}</span></li>'
    first = "".join(f": {escape(one.sentence)} ({signed(one.log_odds)})" for one in deciding.listed[:1])
    return (
        f'<tr class="why"><td colspan="{columns}"><details><summary>Why{first}</summary>'
        f'<p>{verdict_text(explanation)}</p><ul class="facts">{rows}</ul></details></td></tr>'
    )


def explanation_hint(changes: Changes) -> str:
    """What the bars are, for below a table."""
    text = (
        "Why: what each fact adds to the log odds of a change, compared with an average candidate; "
        "bars to the right speak for a change, bars to the left against it."
    )
    return "".join(f"<span>{escape(part)}</span>" for part in (text, confidence_text(changes)) if part)


def rejected_section(changes: Changes, longest: float) -> str:
    """The rejected candidates in a section that is closed at first; nothing where there are none.

    Args:
        changes: what was found.
        longest: log odds of the longest bar.
    """
    text = rejected_text(changes)
    if text is None:
        return ""
    head = "".join(f'<th scope="col">{heading}</th>' for heading in REJECTED_HEADINGS)
    body = "".join(_rejected_rows(candidate, longest) for candidate in changes.rejected)
    return f"""<details class="rejected"><summary>{text}</summary>
<section class="scroll"><table class="changes"><thead><tr>{head}</tr></thead>
<tbody>{body}</tbody></table></section>
<p class="hint">{explanation_hint(changes)}</p></details>
"""


def _rejected_rows(candidate: RejectedCandidate, longest: float) -> str:
    texts = candidate.reason, percent(candidate.probability), *place_cells(candidate)
    cells = "".join(f"<td>{escape(text)}</td>" for text in texts)
    dot = f'<i style="background:{KIND_COLORS[candidate.kind]}"></i>'
    row = f"<tr><td>{dot}{escape(candidate.kind)}</td>{cells}</tr>"
    return row + why_row(candidate.explanation, "against", len(REJECTED_HEADINGS), longest)


def _fact(fact: Contribution, longest: float) -> str:
    side = "against" if fact.log_odds < 0 else "for"
    width = 50 * abs(fact.log_odds) / longest if longest else 0.0
    bar = f'<span class="bar" aria-hidden="true"><span class="{side}" style="width:{width:.1f}%"></span></span>'
    return f"<li><b>{signed(fact.log_odds)}</b>{bar}<span>{escape(fact.sentence)}</span></li>"
