"""The list of changes of a report: a row for each object, which opens to a card."""

from collections.abc import Callable
from html import escape

from gmmjax.changes import Change, Changes, object_motion
from gmmjax.pair import Pair
from gmmjax.reporting.html_explanations import facts_list
from gmmjax.reporting.pictures import data_uri
from gmmjax.reporting.summary import ObjectRow, length_text, percent

CloseUps = Callable[[tuple[int, ...]], Pair[bytes]]
# The page grows by some 30 kB for the pictures of each.
MOST_WITH_PICTURES = 48
SORTING = {
    "order": "probability",
    "label": "label",
    "kind": "kind",
    "size": "size",
    "volume": "volume",
    "points": "points",
}


def changes_panel(changes: Changes, rows: list[ObjectRow], close_ups: CloseUps, longest: float) -> str:
    """The rows with their cards, and what sorts them and steps through them.

    Args:
        changes: what was found.
        rows: of its objects.
        close_ups: makes the pictures of an object.
        longest: log odds of the longest bar.
    """
    if not rows:
        threshold = percent(changes.config.threshold)
        return f"""<aside class="panel" aria-label="Changes"><h2>No change</h2>
<p class="none">Nothing in either scan reached a probability of {threshold} of being changed.</p></aside>"""
    pictures = [close_ups(row.labels) if number < MOST_WITH_PICTURES else None for number, row in enumerate(rows)]
    items = "".join(
        _item(number, row, changes, pair, longest)
        for number, (row, pair) in enumerate(zip(rows, pictures, strict=True))
    )
    options = "".join(f'<option value="{name}">{text}</option>' for name, text in SORTING.items())
    left_out = f'<p class="none">Close-ups are made of the {MOST_WITH_PICTURES} most probable changes.</p>'
    left_out *= len(rows) > MOST_WITH_PICTURES
    return f"""<aside class="panel" aria-label="Changes">
<div class="panel-head"><h2>Changes</h2><label>by <select id="sort">{options}</select></label>
<span class="steps">{_step("previous", "Previous change", "k", "↑")}{_step("next", "Next change", "j", "↓")}
<button type="button" id="everything" title="Back to everything (Esc)" disabled>All</button></span></div>
<ol class="changes" id="changes">{items}</ol>{left_out}
<p class="none">The label is also that of the points in before.*, after.* and labels.npz.</p></aside>"""


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
    return f"""<li class="change {row.kind}" id="change-{label}" data-labels="{" ".join(map(str, row.labels))}" {data}>
<button type="button" class="row" aria-expanded="false" aria-controls="card-{label}"><b class="label">{row.label}</b>
<span class="what"><b>{escape(row.text)}</b><small>{facts}</small></span>
<span class="probability"><b>{row.probability}</b><span class="meter" aria-hidden="true"><span \
style="width:{100 * change.probability:.0f}%"></span></span></span></button>
<div class="card" id="card-{label}" hidden>{_pictures(row, pictures)}{_properties(row, changes)}
{_why(row, changes, longest)}</div></li>"""


def _pictures(row: ObjectRow, pictures: Pair[bytes] | None) -> str:
    if pictures is None:
        return ""
    return (
        '<div class="close-ups">'
        + "".join(
            f'<figure><img src="{data_uri(picture)}" loading="lazy" decoding="async" width="360" height="270" '
            f'alt="Close-up of change {row.label} {side}"><figcaption>{side.capitalize()}</figcaption></figure>'
            for side, picture in zip(("before", "after"), pictures, strict=True)
        )
        + "</div>"
    )


def _properties(row: ObjectRow, changes: Changes) -> str:
    """What is known of the object, as names and values."""
    change = changes[row.labels[-1]]
    unit = f" {changes.unit}" if changes.unit else ""
    moved = len(row.labels) == 2
    values = {"Kind": row.kind, "Probability": row.probability}
    if moved:
        values |= _motion(row, changes)
    values |= {
        "Significance": _significance(change),
        "Size": row.size + unit,
        "Area": row.area,
        "Volume": _volume(row, change),
        "Position after" if moved else "Position": row.centre + unit,
        "Points": row.points,
    }
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
    """With how it was measured."""
    if change.volume_counted_in is not None:
        return f"counted in change {change.volume_counted_in}, the other surface of the same place"
    surface = row.volume and change.volume_method == "surface"
    return f"{row.volume}, between both surfaces" if surface else row.volume


def _significance(change: Change) -> str:
    return f"{change.significance:.1f} standard deviations"


def _why(row: ObjectRow, changes: Changes, longest: float) -> str:
    """What the other scan saw there; of a moved object, in both places."""
    headings = ("Where it was", "Where it is") if len(row.labels) == 2 else ("Why",)
    parts = []
    for heading, label in zip(headings, row.labels, strict=True):
        explanation = changes[label].explanation
        if explanation is not None:
            parts.append(f'<section class="why"><h3>{heading}</h3>{facts_list(explanation, longest)}</section>')
    return "".join(parts)
