"""The lists of a report: changes and rejected candidates, a row for each, which opens to a card that says why."""

from collections.abc import Callable, Mapping
from html import escape

from gmmjax.changes import Change, Changes, Contribution, Explanation, RejectedCandidate, object_motion
from gmmjax.pair import Pair
from gmmjax.reporting.explanations import Facts, confidence_text, displaced_text, rejected_text, signed, verdict_text
from gmmjax.reporting.pictures import data_uri
from gmmjax.reporting.quantities import length_text, percent
from gmmjax.reporting.summary import ObjectRow, place_cells

CloseUps = Callable[[tuple[int, ...]], Pair[bytes]]
# The page grows by some 30 kB for the pictures of each.
MAX_WITH_PICTURES = 48
# Facts of a card that are shown at first: with more, it is longer than a screen.
FIRST_FACTS = 6
SORTING = {
    "order": "probability",
    "label": "label",
    "kind": "kind",
    "size": "size",
    "volume": "volume",
    "points": "points",
}


def strongest_log_odds(changes: Changes) -> float:
    """Return the greatest magnitude of a contribution, which is as long as a bar can be; 0 where there is none."""
    explanations = [change.explanation for change in changes.items] + [one.explanation for one in changes.rejected]
    facts = (fact for own in explanations if own is not None for fact in own.contributions)
    return max((abs(fact.log_odds) for fact in facts), default=0.0)


def changes_panel(changes: Changes, rows: list[ObjectRow], close_ups: CloseUps, longest: float) -> str:
    """Make the list of changes, with what sorts it and steps through it; the longest bar is of `longest` log odds."""
    if not rows:
        threshold = percent(changes.config.threshold)
        return f"""<aside class="panel" aria-label="Changes"><h2>No change</h2>
<p class="none">Nothing in either scan reached a probability of {threshold} of being changed.</p></aside>"""
    pictures = [close_ups(row.labels) if number < MAX_WITH_PICTURES else None for number, row in enumerate(rows)]
    items = "".join(
        _item(number, row, changes, pair, longest)
        for number, (row, pair) in enumerate(zip(rows, pictures, strict=True))
    )
    options = "".join(f'<option value="{name}">{text}</option>' for name, text in SORTING.items())
    left_out = f'<p class="none">Close-ups are made of the {MAX_WITH_PICTURES} most probable changes.</p>'
    left_out *= len(rows) > MAX_WITH_PICTURES
    return f"""<aside class="panel" aria-label="Changes">
<div class="panel-head"><h2>Changes</h2><label>by <select id="sort">{options}</select></label>
<span class="steps">{_step("previous", "Previous change", "k", "↑")}{_step("next", "Next change", "j", "↓")}
<button type="button" id="everything" title="Back to everything (Esc)" disabled>All</button></span></div>
<ol class="changes" id="changes">{items}</ol>{left_out}
<p class="none">The label is also that of the points in before.*, after.* and labels.npz.</p></aside>"""


def rejected_section(changes: Changes, longest: float) -> str:
    """Make the list of rejected candidates, closed at first; "" where there are none."""
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


def explanation_hint(changes: Changes) -> str:
    """Say what the bars are; "" where no change and no candidate has any."""
    if not changes.rejected and not any(change.explanation for change in changes):
        return ""
    text = (
        "The bars are what each fact adds to the log odds of a change, compared with an average candidate: to the "
        "right for a change, to the left against it."
    )
    parts = (part for part in (text, confidence_text(changes)) if part)
    return f'<p class="hint">{escape(" ".join(parts))}</p>'


def _step(name: str, text: str, key: str, sign: str) -> str:
    return f'<button type="button" id="{name}" title="{text} ({key})" aria-label="{text}">{sign}</button>'


def _item(number: int, row: ObjectRow, changes: Changes, pictures: Pair[bytes] | None, longest: float) -> str:
    change = changes[row.labels[-1]]
    label = row.labels[0]
    keys = {
        "order": number,
        "label": label,
        "kind": row.kind,
        "size": float(change.box.extent.prod()),
        "volume": change.volume or 0.0,
        "points": change.point_count,
    }
    data = " ".join(f'data-{name}="{value}"' for name, value in keys.items())
    size = f"{row.size} {changes.unit}" if changes.unit else row.size
    facts = " · ".join(f"<span>{escape(text)}</span>" for text in (size, row.volume) if text)
    meter = f'<span class="meter" aria-hidden="true"><span style="width:{100 * change.probability:.0f}%"></span></span>'
    return f"""<li class="change {row.kind}" id="change-{label}" data-labels="{" ".join(map(str, row.labels))}" {data}>
{_row(f"card-{label}", row.label, row.text, facts, row.probability, meter)}
<div class="card" id="card-{label}" hidden>{_pictures(row, pictures)}{_properties(row, changes)}
{_why(row, changes, longest)}</div></li>"""


def _rejected(number: int, candidate: RejectedCandidate, changes: Changes, longest: float) -> str:
    unit = f" {changes.unit}" if changes.unit else ""
    points, centre, size = place_cells(candidate)
    strongest = Facts.of(candidate.explanation, most=1, against_first=True, least=0.0).listed
    facts = f"would have {candidate.kind}" + "".join(f": {escape(one.sentence)}" for one in strongest)
    properties = {"Size": size + unit, "Position": centre + unit, "Points": points}
    return f"""<li class="change candidate" data-rejected="{number}">
{_row(f"rejected-{number}", "–", candidate.reason, facts, percent(candidate.probability))}
<div class="card" id="rejected-{number}" hidden>{_property_list(properties)}
<section class="why">{_facts(candidate.explanation, longest)}</section></div></li>"""


def _row(card: str, label: str, text: str, facts: str, probability: str, meter: str = "") -> str:
    """Make the button that opens a card; `facts` and `meter` are HTML."""
    return f"""<button type="button" class="row" aria-expanded="false" aria-controls="{card}">\
<b class="label">{label}</b>
<span class="what"><b>{escape(text)}</b><small>{facts}</small></span>
<span class="probability"><b>{probability}</b>{meter}</span></button>"""


def _pictures(row: ObjectRow, pictures: Pair[bytes] | None) -> str:
    if pictures is None:
        return ""
    figures = (
        f'<figure><img src="{data_uri(picture)}" loading="lazy" decoding="async" width="360" height="270" '
        f'alt="Close-up of change {row.label} {side}"><figcaption>{side.capitalize()}</figcaption></figure>'
        for side, picture in zip(("before", "after"), pictures, strict=True)
    )
    return f'<div class="close-ups">{"".join(figures)}</div>'


def _properties(row: ObjectRow, changes: Changes) -> str:
    """List what is known of the object, as names and values."""
    change = changes[row.labels[-1]]
    unit = f" {changes.unit}" if changes.unit else ""
    moved = len(row.labels) == 2
    values = {"Kind": row.kind, "Probability": row.probability}
    if moved:
        values |= _motion(row, changes)
    return _property_list(
        values
        | {
            "Significance": f"{change.significance:.1f} standard deviations",
            "Size": row.size + unit,
            "Area": row.area,
            "Volume": _volume(row, change),
            "Position after" if moved else "Position": row.centre + unit,
            "Points": row.points,
        }
    )


def _property_list(values: Mapping[str, str]) -> str:
    rows = "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in values.items() if value)
    return f'<dl class="properties">{rows}</dl>'


def _motion(row: ObjectRow, changes: Changes) -> dict[str, str]:
    distance, degrees = object_motion(changes, (row.labels[0], row.labels[1]))
    same = changes[row.labels[-1]].moved_probability
    return {
        "Same object": "" if same is None else percent(same),
        "Moved by": length_text(distance, changes.unit),
        "Turned by": "" if degrees is None else f"{degrees:.0f}°",
    }


def _volume(row: ObjectRow, change: Change) -> str:
    """Give the volume with how it was measured."""
    if change.volume_counted_in is not None:
        return f"counted in change {change.volume_counted_in}, the other surface of the same place"
    surface = row.volume and change.volume_method == "surface"
    return f"{row.volume}, between both surfaces" if surface else row.volume


def _why(row: ObjectRow, changes: Changes, longest: float) -> str:
    """List what the other scan saw there; for a moved object, in both places."""
    headings = ("Where it was", "Where it is") if len(row.labels) == 2 else ("Why",)
    parts = []
    for heading, label in zip(headings, row.labels, strict=True):
        explanation = changes[label].explanation
        if explanation is not None:
            parts.append(f'<section class="why"><h3>{heading}</h3>{_facts(explanation, longest)}</section>')
    return "".join(parts)


def _facts(explanation: Explanation, longest: float) -> str:
    """List the verdict, and each fact with a bar for its contribution; the weaker ones are shown on request."""
    facts = Facts.of(explanation)
    listed = [_fact(one, longest) for one in facts.listed]
    first, more = "".join(listed[:FIRST_FACTS]), "".join(listed[FIRST_FACTS:])
    others = ""
    if facts.sum_of_others is not None:
        total, text = facts.sum_of_others
        others = f'<li class="others"><b>{total}</b><span></span><span>{text}</span></li>'
    if not more:
        return f'<p>{verdict_text(explanation)}</p><ul class="facts">{first}{others}</ul>'
    count = len(listed) - FIRST_FACTS + len(facts.others)
    return (
        f'<p>{verdict_text(explanation)}</p><ul class="facts">{first}</ul>'
        f'<details class="more"><summary>{count} more facts</summary><ul class="facts">{more}{others}</ul></details>'
    )


def _fact(fact: Contribution, longest: float) -> str:
    side = "against" if fact.log_odds < 0 else "for"
    width = 50 * abs(fact.log_odds) / longest if longest else 0.0
    bar = f'<span class="bar" aria-hidden="true"><span class="{side}" style="width:{width:.1f}%"></span></span>'
    return f"<li><b>{signed(fact.log_odds)}</b>{bar}<span>{escape(fact.sentence)}</span></li>"
