"""Why candidates are changes, or none, as parts of the report."""

from html import escape

from gmmjax.changes import Changes, Contribution, Explanation, RejectedCandidate
from gmmjax.reporting.explanations import (
    Facts,
    confidence_text,
    displaced_text,
    rejected_text,
    signed,
    verdict_text,
)
from gmmjax.reporting.summary import percent, place_cells


def strongest_log_odds(changes: Changes) -> float:
    """The greatest magnitude of a contribution, which is as long as a bar can be; 0 where there is none."""
    explanations = [change.explanation for change in changes.items] + [one.explanation for one in changes.rejected]
    facts = (fact for own in explanations if own is not None for fact in own.contributions)
    return max((abs(fact.log_odds) for fact in facts), default=0.0)


def facts_list(explanation: Explanation, longest: float) -> str:
    """The verdict, and each fact with a bar for its contribution; the weaker ones are shown on request.

    Args:
        explanation: of a candidate.
        longest: log odds of the longest bar.
    """
    facts = Facts.of(explanation)
    # With more at first, a card is longer than a screen.
    first, more = facts.listed[:6], facts.listed[6:]
    rows = [_fact(one, longest) for one in first]
    others = "" if facts.sum_of_others is None else _others(*facts.sum_of_others)
    if not more:
        return f'<p>{verdict_text(explanation)}</p><ul class="facts">{"".join(rows)}{others}</ul>'
    hidden = "".join(_fact(one, longest) for one in more)
    count = len(more) + len(facts.others)
    return (
        f'<p>{verdict_text(explanation)}</p><ul class="facts">{"".join(rows)}</ul>'
        f'<details class="more"><summary>{count} more facts</summary><ul class="facts">{hidden}{others}</ul></details>'
    )


def explanation_hint(changes: Changes) -> str:
    """What the bars are; empty where no change and no candidate has any."""
    if not changes.rejected and not any(change.explanation for change in changes):
        return ""
    text = (
        "The bars are what each fact adds to the log odds of a change, compared with an average candidate: to the "
        "right for a change, to the left against it."
    )
    parts = (part for part in (text, confidence_text(changes)) if part)
    return f'<p class="hint">{escape(" ".join(parts))}</p>'


def rejected_section(changes: Changes, longest: float) -> str:
    """The rejected candidates in a section that is closed at first; nothing where there are none.

    Args:
        changes: what was found.
        longest: log odds of the longest bar.
    """
    text = rejected_text(changes)
    if text is None:
        return ""
    items = "".join(_rejected(number, one, changes, longest) for number, one in enumerate(changes.rejected))
    displaced = displaced_text(changes)
    hint = f'<p class="hint">{escape(displaced)}</p>\n' if displaced else ""
    return f"""{hint}<details class="rejected" id="rejected-section"><summary>{text}</summary>
<p class="hint">What looked changed in one scan and was turned down. Choose one to see it in the view.</p>
<ol class="changes" id="rejected">{items}</ol></details>
"""


def _rejected(number: int, candidate: RejectedCandidate, changes: Changes, longest: float) -> str:
    unit = f" {changes.unit}" if changes.unit else ""
    points, centre, size = place_cells(candidate)
    strongest = Facts.of(candidate.explanation, most=1, against_first=True, least=0.0).listed
    reason = "".join(f": {escape(one.sentence)}" for one in strongest)
    return f"""<li class="change candidate" data-rejected="{number}">
<button type="button" class="row" aria-expanded="false" aria-controls="rejected-{number}"><b class="label">–</b>
<span class="what"><b>{escape(candidate.reason)}</b><small>{_would_be(candidate)}{reason}</small></span>
<span class="probability"><b>{percent(candidate.probability)}</b></span></button>
<div class="card" id="rejected-{number}" hidden><dl class="properties"><dt>Size</dt><dd>{size}{escape(unit)}</dd>
<dt>Position</dt><dd>{centre}{escape(unit)}</dd><dt>Points</dt><dd>{points}</dd></dl>
<section class="why">{facts_list(candidate.explanation, longest)}</section></div></li>"""


def _would_be(candidate: RejectedCandidate) -> str:
    return f"would have {candidate.kind}"


def _others(total: str, text: str) -> str:
    return f'<li class="others"><b>{total}</b><span></span><span>{text}</span></li>'


def _fact(fact: Contribution, longest: float) -> str:
    side = "against" if fact.log_odds < 0 else "for"
    width = 50 * abs(fact.log_odds) / longest if longest else 0.0
    bar = f'<span class="bar" aria-hidden="true"><span class="{side}" style="width:{width:.1f}%"></span></span>'
    return f"<li><b>{signed(fact.log_odds)}</b>{bar}<span>{escape(fact.sentence)}</span></li>"
