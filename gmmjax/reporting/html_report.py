"""The report: one HTML file that needs nothing else, not even a network."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import PurePath
from typing import Any

from gmmjax.changes import Change, Changes
from gmmjax.clouds import PointCloud
from gmmjax.reporting.html_explanations import explanation_hint, rejected_section, strongest_log_odds, why_row
from gmmjax.reporting.page_parts import asset, script_json
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.scene_plot import drawn_points, scene_views
from gmmjax.reporting.summary import (
    ObjectRow,
    answer,
    dropped_rows,
    dropped_text,
    headings,
    object_rows,
    percent,
    poses_text,
    registration_text,
)

# The browser itself then refuses to load anything from anywhere.
CONTENT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


def report_html(before: PointCloud, after: PointCloud, changes: Changes, title: str | None = None) -> str:
    """The report of a detection as one self-contained page.

    Args:
        before: the before cloud that the changes were found in.
        after: the after cloud, as given; it is shown registered.
        changes: what was found.
        title: of the page; default the names of the two files.

    Returns:
        HTML, with plotly.js inside.
    """
    names = _name(before, "before"), _name(after, "after")
    after = dataclasses.replace(after, points=changes.registration.apply(after.points))
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{CONTENT_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title or f"{names[0]} → {names[1]}")} · gmmjax</title>
<style>{asset("report.css")}</style>
</head>
<body>
<main>
{_header(names, changes, title)}
{_views(names, changes)}
{_table(changes)}
{rejected_section(changes, strongest_log_odds(changes))}{_details(changes)}
</main>
<script type="application/json" id="scene">{script_json(scene_views(before, after, changes))}</script>
<script>{_plotly()}</script>
<script>{asset("report.js")}</script>
</body>
</html>
"""


@functools.cache
def _plotly() -> str:
    """plotly.js, 5 MB: read once by a process that writes many reports."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def _header(names: tuple[str, str], changes: Changes, title: str | None) -> str:
    dropped = "".join(
        f'<p class="note">{dropped_text(side, count)}</p>' for side, count in dropped_rows(changes).items()
    )
    text, style = registration_text(changes), "note" if changes.registration.in_doubt else "files"
    registration = "" if text is None else f'<p class="{style}">{escape(text)}</p>'
    poses = "" if (text := poses_text(changes)) is None else f'<p class="files">{escape(text)}</p>'
    heading = f'<p class="title">{escape(title)}</p>' if title else ""
    kinds = {change.kind for change in changes.items}
    legend = "".join(
        f'<li><i style="background:{color}"></i>{kind}</li>' for kind, color in KIND_COLORS.items() if kind in kinds
    )
    return f"""<header>
{heading}<h1>{escape(answer(changes))}</h1>
<p class="files">from <b>{escape(names[0])}</b> to <b>{escape(names[1])}</b></p>
{registration}{poses}{dropped}<ul class="legend">{legend}<li><i class="unchanged"></i>unchanged</li></ul>
</header>"""


def _views(names: tuple[str, str], changes: Changes) -> str:
    captions = {
        "before": ("Before", names[0], changes.labels_before),
        "after": ("After", names[1], changes.labels_after),
    }
    figures = "".join(
        f'<figure><figcaption><b>{heading}</b><span class="name" title="{escape(name)}">{escape(name)}</span>'
        f'<span class="count">{_points_shown(len(labels), drawn_points(labels))}</span></figcaption>'
        f'<div class="view" id="view-{side}"></div></figure>'
        for side, (heading, name, labels) in captions.items()
    )
    return f"""<section class="views" aria-label="Views in three dimensions">
{figures}<figure><figcaption><b>Changes</b><span class="name">both clouds, every change</span></figcaption>
<div class="view" id="view-changes"></div></figure>
</section>
<p class="hint"><span>Drag to turn, scroll to zoom, right-drag to move: the three views go together.</span>
<button type="button" id="reset">Reset the view</button></p>
<noscript><p class="note">The views need JavaScript; the table below does not.</p></noscript>"""


def _points_shown(total: int, drawn: int) -> str:
    return f"{total:,} points" if drawn == total else f"{drawn:,} of {total:,} points drawn"


def _table(changes: Changes) -> str:
    rows, columns = object_rows(changes), headings(changes)
    if not rows:
        threshold = percent(changes.config.threshold)
        return f'<p class="none">Nothing in either cloud reached a probability of {threshold} of being changed.</p>'
    head = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in columns)
    longest = strongest_log_odds(changes)
    body = "".join(_table_rows(row, [changes[label] for label in row.labels], longest) for row in rows)
    hint = explanation_hint(changes) if any(change.explanation for change in changes) else ""
    return f"""<section class="scroll"><table class="changes"><thead><tr>{head}</tr></thead>
<tbody>{body}</tbody></table></section>
<p class="hint"><span>The label is also that of the points in before.ply, after.ply and labels.npz.</span>{hint}</p>"""


def _table_rows(row: ObjectRow, own: Sequence[Change], longest: float) -> str:
    label, kind, *others = (escape(cell) for cell in row.cells)
    color = KIND_COLORS[row.kind]
    cells = "".join(f"<td>{cell}</td>" for cell in others)
    explanations = (change.explanation for change in own if change.explanation is not None)
    why = "".join(why_row(explanation, "for", len(row.cells), longest) for explanation in explanations)
    return (
        f'<tr><td><b style="color:{color}">{label}</b></td>'
        f'<td class="kind"><i style="background:{color}"></i>{kind}</td>{cells}</tr>{why}'
    )


def _details(changes: Changes) -> str:
    from gmmjax import __version__

    settings = _values(changes.config.to_dict())
    diagnostics = _values(
        {"Earth mover's distance": changes.emd, "registration": changes.registration.to_dict(), **changes.diagnostics}
    )
    return f"""<details><summary>Settings and diagnostics</summary>
<div class="details"><section><h2>Settings</h2>{settings}</section>
<section><h2>Diagnostics</h2>{diagnostics}</section></div></details>
<footer>gmmjax {escape(__version__)}</footer>"""


def _values(value: Any) -> str:
    """Nested plain values as nested tables; lists of scalars on one line."""
    if isinstance(value, Mapping):
        rows = "".join(
            f'<tr><th scope="row">{escape(_readable(str(name)))}</th><td>{_values(content)}</td></tr>'
            for name, content in value.items()
        )
        return f'<table class="values">{rows}</table>' if rows else "none"
    if isinstance(value, str) or not isinstance(value, Sequence):
        return escape(_scalar(value))
    if any(isinstance(item, Mapping | list | tuple) for item in value):
        return "".join(f'<div class="item">{_values(item)}</div>' for item in value)
    return escape(", ".join(_scalar(item) for item in value)) if value else "none"


def _scalar(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _readable(name: str) -> str:
    words = name.replace("_", " ")
    return words[:1].upper() + words[1:]


def _name(cloud: PointCloud, side: str) -> str:
    return PurePath(cloud.source).name if cloud.source else f"the {side} cloud"
