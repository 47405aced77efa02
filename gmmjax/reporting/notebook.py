"""What a notebook shows of changes: the answer, a small picture of both clouds, a row for each object.

The styles are inline, and there is no background, so that it looks right in light and in dark notebooks.
"""

import base64
import dataclasses
from html import escape
from pathlib import PurePath

from gmmjax.changes import Changes
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.summary import ObjectRow, answer, headings, object_rows, registration_text, volumes_text
from gmmjax.reporting.thumbnails import ThumbnailSettings, thumbnails


@dataclasses.dataclass(frozen=True)
class NotebookSettings:
    """What a notebook shows.

    Attributes:
        rows: objects in the table at most; without a limit a thousand changes would bury the notebook.
        thumbnails: how the clouds are drawn, at twice the size that they are shown in.
    """

    rows: int = 20
    thumbnails: ThumbnailSettings = ThumbnailSettings(width=640, height=480, most_unchanged=60_000)


def changes_html(
    changes: Changes, clouds: Pair[PointCloud] | None, settings: NotebookSettings = NotebookSettings()
) -> str:
    """The changes as a fragment of HTML that needs nothing else.

    Args:
        changes: what was found.
        clouds: as they were given to the detection; None: they are not known, and there is no picture.
        settings: what is shown.
    """
    sentences = [text for text in (volumes_text(changes), registration_text(changes)) if text is not None]
    lines = [f'<p style="margin:0 0 .3em"><b>{escape(answer(changes))}</b></p>']
    if clouds is not None:
        lines.append(_pictures(clouds, changes, settings))
    rows = object_rows(changes)
    if rows:
        lines.append(_table(changes, rows[: settings.rows]))
    if len(rows) > settings.rows:
        left = len(rows) - settings.rows
        lines.append(f'<p style="margin:.3em 0">and {left:,} more: changes.report("report.html") has all.</p>')
    lines += [f'<p style="margin:.3em 0;opacity:.75">{escape(text)}</p>' for text in sentences]
    return f'<div style="max-width:60em">{"".join(lines)}</div>'


def _pictures(clouds: Pair[PointCloud], changes: Changes, settings: NotebookSettings) -> str:
    width = settings.thumbnails.width // 2
    figures = [
        f'<figure style="display:inline-block;margin:0 .8em .4em 0;vertical-align:top">'
        f'<img alt="The {side} cloud" width="{width}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
        f'<figcaption style="font-size:90%;max-width:{width}px;overflow-wrap:anywhere">{side}{_name(cloud)}: '
        f"{len(cloud):,} points</figcaption></figure>"
        for side, cloud, png in zip(
            ("before", "after"), clouds, thumbnails(clouds, changes, settings.thumbnails), strict=True
        )
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
