"""Chapter 4 as one self-contained HTML page."""

from collections.abc import Mapping, Sequence
from html import escape

from gmmjax.reporting import asset, page_head, script_json
from gmmjax.thesis.chapter4 import THESIS, Cell, Headline, PartResult, Plan, Table, ThesisResults
from gmmjax.thesis.report.bar_charts import (
    Chart,
    condition_chart,
    filter_chart,
    found_chart,
    opposite_chart,
    score_chart,
    survey_chart,
)
from gmmjax.thesis.report.chapter_text import METHODS_TEXT, THESIS_TEXT
from gmmjax.thesis.report.cloud_plots import View, annihilation_views, grid_views, top_views

_ASSETS = "gmmjax.thesis.report"
# Tables with more rows are collapsed.
OPEN_ROWS = 12
CHARTS = {
    "3.9": score_chart,
    "4.6": filter_chart,
    "4.9": condition_chart,
    "4.10": survey_chart,
    "4.12": opposite_chart,
}


def thesis_html(results: ThesisResults) -> str:
    """The figures and tables, each beside the results of the thesis.

    Args:
        results: of `run_chapter`.

    Returns:
        HTML, with plotly.js inside.
    """
    from plotly.offline import get_plotlyjs

    charts: dict[str, Chart] = {}
    sections = "".join(_part(part, charts) for part in results.parts)
    return f"""{page_head("Chapter 4 of the thesis again", asset("thesis.css", _ASSETS))}<body>
<main>
{_header(results)}
{_summary(results.parts)}
{sections}
{_footer()}
</main>
<script type="application/json" id="charts">{script_json(charts)}</script>
<script>{get_plotlyjs()}</script>
<script>{asset("thesis.js", _ASSETS)}</script>
</body>
</html>
"""


def _header(results: ThesisResults) -> str:
    failed = len(results.failures)
    units = "1 unit of the work" if failed == 1 else f"{failed} units of the work"
    note = f'<p class="note">{units} failed and is left out; the same command tries again.</p>' if failed else ""
    return f"""<header>
<h1>Chapter 4 of the thesis, run again</h1>
<p class="files">{escape(_extent(results.plan))}</p>
{note}</header>"""


def _extent(plan: Plan) -> str:
    return (
        f"Seeds from {plan.first_seed} on. Clouds of each kind that are clustered: {plan.clustering_seeds}; trials of "
        f"each artificial condition: {plan.trials}; pairs of each kind of survey: {plan.survey_seeds}; of localised "
        f"maps without and with the outlier filter: {plan.filtering_seeds}."
    )


def _summary(parts: Sequence[PartResult]) -> str:
    lines = [line for part in parts for line in part.headlines]
    if not lines:
        return ""
    head = "".join(f'<th class="text">{heading}</th>' for heading in ("Figure", "Measure", "Method"))
    body = "".join(_summary_row(line, before) for line, before in zip(lines, [None, *lines], strict=False))
    return f"""<section class="thesis"><h2>Summary</h2>
<p class="said">{METHODS_TEXT}</p>
<div class="scroll"><table class="numbers"><thead><tr>{head}<th>Here</th><th>Thesis</th></tr></thead>
<tbody>{body}</tbody></table></div></section>"""


def _summary_row(line: Headline, before: Headline | None) -> str:
    """A line of the summary; figure and measure are left out where they repeat those of the line before."""
    same = before is not None and (before.figure, before.measure) == (line.figure, line.measure)
    figure = f'<a href="#figure-{line.figure}">{line.figure}</a>'
    texts = ("", "") if same else (figure, escape(line.measure))
    cells = "".join(f'<td class="text">{text}</td>' for text in (*texts, escape(line.method)))
    return f"<tr>{cells}<td>{escape(line.here)}</td><td>{escape(line.thesis) or '–'}</td></tr>"


def _part(part: PartResult, charts: dict[str, Chart]) -> str:
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in part.notes)
    if not part.outcomes:
        return f'<section class="thesis"><h2>{escape(part.name.capitalize())}</h2>{notes}</section>'
    sections = [_section(table, part, notes if not number else "", charts) for number, table in enumerate(part.tables)]
    return "".join(sections)


def _section(table: Table, part: PartResult, notes: str, charts: dict[str, Chart]) -> str:
    return f"""<section class="thesis" id="figure-{table.figure}">
<h2>Figure {table.figure}: {escape(table.title)}</h2>
<p class="said"><b>The thesis.</b> {escape(THESIS_TEXT[table.figure])}</p>
{notes}{_pictures(table, part, charts)}
{_numbers(table)}
<p class="csv"><a href="{table.file_name}">{table.file_name}</a></p>
</section>"""


def _pictures(table: Table, part: PartResult, charts: dict[str, Chart]) -> str:
    """The elements of a figure's charts; the charts are added to those of the page."""
    if table.figure == "4.1":
        return _views("annihilation", annihilation_views(part.outcomes), charts)
    if table.figure == "4.2":
        views = _views("grid", grid_views(part.outcomes), charts)
        return views + _chart("chart-4.2", found_chart(part.outcomes), charts)
    own = _chart(f"chart-{table.figure}", CHARTS[table.figure](table), charts)
    seen = top_views(part.outcomes) if table.figure == "4.6" else None
    return (_chart("clouds-4.6", seen, charts) if seen else "") + own


def _chart(name: str, chart: Chart, charts: dict[str, Chart]) -> str:
    charts[name] = chart
    return f'<div class="chart" id="{name}" style="height:{chart["layout"]["height"]}px"></div>'


def _views(name: str, views: Sequence[View], charts: dict[str, Chart]) -> str:
    places = []
    for number, view in enumerate(views):
        charts[f"{name}-{number}"] = view.chart
        places.append(
            f'<figure><figcaption><b>{escape(view.heading)}</b><span class="name">{escape(view.caption)}</span>'
            f'</figcaption><div class="view" id="{name}-{number}"></div></figure>'
        )
    return f'<div class="views">{"".join(places)}</div>'


def _numbers(table: Table) -> str:
    head = "".join(f"<th{_kind(name, table)}>{escape(_heading(name))}</th>" for name in table.columns)
    body = "".join(_row(row, table) for row in table.rows)
    content = f"""<div class="scroll"><table class="numbers"><thead><tr>{head}</tr></thead>
<tbody>{body}</tbody></table></div>"""
    if len(table.rows) <= OPEN_ROWS:
        return content
    return f"<details><summary>All {len(table.rows)} rows</summary>{content}</details>"


def _row(row: Mapping[str, Cell], table: Table) -> str:
    cells = "".join(f"<td{_kind(name, table)}>{escape(_text(value))}</td>" for name, value in row.items())
    of_thesis = ' class="thesis-row"' if row.get("method") == THESIS else ""
    return f"<tr{of_thesis}>{cells}</tr>"


def _kind(column: str, table: Table) -> str:
    """The class of a column of text."""
    return ' class="text"' if any(isinstance(row[column], str) for row in table.rows) else ""


def _heading(name: str) -> str:
    words = name.replace("_", " ").replace("f1", "F1")
    return words[:1].upper() + words[1:]


def _text(value: Cell) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "▼" if value else ""
    return f"{value:,.2f}" if isinstance(value, float) else str(value)


def _footer() -> str:
    from gmmjax import __version__

    return f"<footer>gmmjax {escape(__version__)}, <code>gmmjax evaluate thesis</code></footer>"
