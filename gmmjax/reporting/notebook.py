"""View of changes in a notebook: the answer, a small picture of both clouds, a row for each object.

The styles are inline, and there is no background, so that it looks right in light and in dark notebooks.
"""

from html import escape
from pathlib import PurePath

from gmmjax.changes import Changes, presented
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.pictures import Pictures, PictureSettings, data_uri
from gmmjax.reporting.summary import ObjectRow, answer, headings, object_rows, registration_text, volumes_text

# Objects in the table: without a limit a thousand changes would bury the notebook.
MAX_ROWS = 20


def notebook_html(changes: Changes) -> str:
    """Return the changes as a fragment of HTML that needs nothing else; with a picture where their clouds are known."""
    clouds = None
    if changes.clouds is not None:
        clouds, changes = presented(changes)
    sentences = [text for text in (volumes_text(changes), registration_text(changes)) if text is not None]
    lines = [f'<p style="margin:0 0 .3em"><b>{escape(answer(changes))}</b></p>']
    if clouds is not None:
        lines.append(_pictures(clouds, changes))
    rows = object_rows(changes)
    if rows:
        lines.append(_table(changes, rows[:MAX_ROWS]))
    if len(rows) > MAX_ROWS:
        left = len(rows) - MAX_ROWS
        lines.append(f'<p style="margin:.3em 0">and {left:,} more: changes.report("report.html") has all.</p>')
    lines += [f'<p style="margin:.3em 0;opacity:.75">{escape(text)}</p>' for text in sentences]
    return f'<div style="max-width:60em">{"".join(lines)}</div>'


def _pictures(clouds: Pair[PointCloud], changes: Changes) -> str:
    # Shown at half their size, so that they are sharp on fine screens.
    pictures = Pictures(clouds, changes, PictureSettings(width=640, height=480, max_points=60_000)).overview()
    figures = [
        f'<figure style="display:inline-block;margin:0 .8em .4em 0;vertical-align:top">'
        f'<img alt="The {side} cloud" width="320" src="{data_uri(picture)}">'
        f'<figcaption style="font-size:90%;max-width:320px;overflow-wrap:anywhere">{side}{_name(cloud)}: '
        f"{len(cloud):,} points</figcaption></figure>"
        for side, cloud, picture in zip(("before", "after"), clouds, pictures, strict=True)
    ]
    return f"<div>{''.join(figures)}</div>"


def _name(cloud: PointCloud) -> str:
    return f", {escape(PurePath(cloud.source).name)}" if cloud.source else ""


def _table(changes: Changes, rows: list[ObjectRow]) -> str:
    """The rows, without the columns that are empty in all of them."""
    shown = [column for column, texts in enumerate(zip(*(row.cells for row in rows), strict=True)) if any(texts)]
    line = "border-bottom:1px solid rgba(128,128,128,.4);padding:.2em .8em;text-align:left"
    titles = headings(changes)
    head = "".join(f'<th scope="col" style="{line}">{escape(titles[column])}</th>' for column in shown)
    body = "".join(f"<tr>{_cells(row, shown, line)}</tr>" for row in rows)
    style = "border-collapse:collapse;margin:.3em 0;color:inherit;font-size:inherit"
    return f'<table style="{style}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def _cells(row: ObjectRow, shown: list[int], line: str) -> str:
    dot = f'<span style="color:{KIND_COLORS[row.kind]}">●</span> '
    label, text, *others = (escape(cell) for cell in row.cells)
    cells = label, dot + text, *others
    return "".join(f'<td style="{line}">{cells[column]}</td>' for column in shown)
