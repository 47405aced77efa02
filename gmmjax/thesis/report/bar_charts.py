"""The bar charts of chapter 4 as plain data for plotly.js."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from gmmjax.thesis.chapter4 import MEASURES, PUBLISHED, THESIS, Outcome, Table, clustering, filtering, gaussians
from gmmjax.thesis.laboratory import CLOUD_KINDS

Chart = dict[str, Any]

# The colours of Okabe and Ito, who chose them for colour-blind readers.
MEASURE_COLORS = dict(zip(MEASURES, ("#b9bec5", "#56B4E9", "#E69F00", "#0072B2"), strict=True))
METHOD_COLORS = {"joint": "#0072B2", PUBLISHED: "#D55E00", THESIS: "#969cac"}
CLUSTERING_COLORS = {clustering.ONE_START: "#56B4E9", clustering.BEST: "#0072B2", clustering.GRID: "#D55E00"}
TYPE_COLOR, CHOSEN_COLOR = "#b9c7d8", "#D55E00"
INK, LINE = "#1b1f24", "#e2e5e9"
FONT = {"family": "system-ui, -apple-system, Segoe UI, Roboto, Helvetica Neue, Arial, sans-serif", "color": INK}
# Height of a row of panels, and of the figure's margins together, pixels.
PANEL, MARGINS = 190, 110


def score_chart(table: Table) -> Chart:
    """Figure 3.9: a column of panels for each cloud, a row for each criterion, a bar for each model."""
    clouds, criteria = list(clustering.CLOUDS), list(dict.fromkeys(row["criterion"] for row in table.rows))
    panels = [
        (
            f"{cloud}, {str(criterion).upper()}",
            [row for row in table.rows if _matches(row, cloud=cloud, criterion=criterion)],
        )
        for criterion in criteria
        for cloud in clouds
    ]
    traces = []
    for number, (_, rows) in enumerate(panels, start=1):
        colors = [CHOSEN_COLOR if row["lowest"] else TYPE_COLOR for row in rows]
        places = [[row["covariances"] for row in rows], [str(row["gaussians"]) for row in rows]]
        marked = ["▼" if row["lowest"] else "" for row in rows]
        traces.append(
            {
                **_bars(number, places, [row["score"] for row in rows], "", ""),
                "marker": {"color": colors},
                "text": marked,
                "textposition": "outside",
                "hovertemplate": "%{x}: %{y:,.0f} nats<extra></extra>",
                "cliponaxis": False,
            }
        )
    layout = _panels([title for title, _ in panels], columns=len(clouds), rows=len(criteria))
    for number in range(1, len(panels) + 1):
        layout[_axis("y", number)] |= {"exponentformat": "none", "separatethousands": True}
    return {"data": traces, "layout": layout}


def found_chart(outcomes: Sequence[Outcome]) -> Chart:
    """Figures 4.1 and 4.2: the fraction of the fits that found each number of Gaussians."""
    traces = []
    for number, cloud in enumerate(clustering.CLOUDS, start=1):
        for method, found in _found(outcomes, cloud).items():
            counts = Counter(found)
            shares = [counts[own] / len(found) for own in sorted(counts)]
            traces.append(_bars(number, sorted(counts), shares, method, CLUSTERING_COLORS[method]))
    layout = _panels([f"{cloud} in truth" for cloud in clustering.CLOUDS], columns=2, rows=1, tall=240)
    for number in (1, 2):
        layout[_axis("y", number)] |= {
            "range": [0, 1.02],
            "tickformat": ".0%",
            "title": _axis_title("share of the fits"),
        }
        layout[_axis("x", number)] |= {"dtick": 1, "title": _axis_title("Gaussians found")}
    return {"data": _once_in_legend(traces), "layout": layout}


def condition_chart(table: Table) -> Chart:
    """Figure 4.9: a panel for each method, four bars for each condition; the thesis's F1 as a line."""
    names = [
        (condition.overlap, str(condition).removesuffix(condition.overlap).strip())
        for condition in gaussians.CONDITIONS
    ]
    order = sorted(range(len(names)), key=lambda place: names[place][0])
    places = [[f"{names[place][0]} overlap" for place in order], [names[place][1] for place in order]]
    traces = []
    for number, method in enumerate(gaussians.METHODS, start=1):
        rows = {row["condition"]: row for row in table.rows if row["method"] == method}
        own = [rows[str(gaussians.CONDITIONS[place])] for place in order]
        traces += [
            _bars(number, places, [row[measure] for row in own], _named(measure), MEASURE_COLORS[measure])
            for measure in MEASURES
        ]
        published_f1 = [list(gaussians.THESIS_F1.values())[min(gaussians.NUMBERS[place // 2]) > 0] for place in order]
        traces.append(_thesis_marks(number, places, published_f1))
    return {
        "data": _once_in_legend(traces),
        "layout": _share_panels(gaussians.METHODS, columns=1, rows=len(gaussians.METHODS)),
    }


def survey_chart(table: Table) -> Chart:
    """Figure 4.10: a panel for each method and for the thesis, four bars for each kind of data."""
    methods = ("joint", PUBLISHED, THESIS)
    return _measure_panels(table, "data", list(CLOUD_KINDS.values()), methods)


def filter_chart(table: Table) -> Chart:
    """Figure 4.6: a panel for each method, four bars without and with the outlier filter."""
    return _measure_panels(table, "filters", [filtering.WITHOUT, filtering.WITH], ("joint", PUBLISHED))


def opposite_chart(table: Table) -> Chart:
    """Figure 4.12: a bar for each method and kind of data."""
    kinds = list(CLOUD_KINDS.values())
    traces = []
    for method, color in METHOD_COLORS.items():
        rows = {row["data"]: row["accuracy"] for row in table.rows if row["method"] == method}
        traces.append(_bars(1, kinds, [rows.get(kind) for kind in kinds], method, color))
    layout = _share_panels([""], columns=1, rows=1, tall=240)
    layout["yaxis"]["title"] = _axis_title("accuracy")
    return {"data": traces, "layout": layout}


def _measure_panels(table: Table, column: str, groups: Sequence[str], methods: Sequence[str]) -> Chart:
    traces = []
    # In two lines, so that three panels have room for them.
    places = [group.replace(" ", "<br>", 1) for group in groups]
    for number, method in enumerate(methods, start=1):
        rows = {row[column]: row for row in table.rows if row["method"] == method}
        for measure in MEASURES:
            values = [rows[group][measure] if group in rows else None for group in groups]
            traces.append(_bars(number, places, values, _named(measure), MEASURE_COLORS[measure]))
    return {"data": _once_in_legend(traces), "layout": _share_panels(methods, columns=len(methods), rows=1, tall=240)}


def _found(outcomes: Sequence[Outcome], cloud: str) -> Mapping[str, list[int]]:
    own = [outcome for outcome in outcomes if outcome.condition == cloud]
    annihilation = [outcome.result for outcome in own if outcome.method == clustering.ANNIHILATION]
    return {
        clustering.ONE_START: [found for result in annihilation for found in result["found"]],
        clustering.BEST: [result["best"] for result in annihilation],
        clustering.GRID: [outcome.result["best"] for outcome in own if outcome.method == clustering.GRID],
    }


def _matches(row: Mapping[str, Any], **wanted: Any) -> bool:
    return all(row[name] == value for name, value in wanted.items())


def _named(measure: str) -> str:
    return "F1" if measure == "f1" else measure


def _bars(panel: int, x: Sequence[Any], y: Sequence[Any], name: str, color: str) -> Chart:
    return {
        "type": "bar",
        "x": list(x),
        "y": list(y),
        "name": name,
        "legendgroup": name,
        "showlegend": bool(name),
        "marker": {"color": color},
        "hovertemplate": f"%{{x}}: %{{y:.3g}}<extra>{name}</extra>",
        **axes_of(panel),
    }


def _thesis_marks(panel: int, x: Sequence[Any], y: Sequence[float]) -> Chart:
    """The thesis's F1, as a line across each group of bars."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": list(x),
        "y": list(y),
        "name": "F1 of the thesis, about",
        "legendgroup": THESIS,
        "marker": {"symbol": "line-ew", "size": 52, "line": {"width": 2.5, "color": INK}},
        "hovertemplate": "%{y:.2f}<extra>the thesis</extra>",
        **axes_of(panel),
    }


def _once_in_legend(traces: Sequence[Chart]) -> list[Chart]:
    """The traces of several panels, of which only the first one of each name is in the legend."""
    seen: set[str] = set()
    once = []
    for trace in traces:
        once.append({**trace, "showlegend": trace["name"] not in seen})
        seen.add(trace["name"])
    return once


def axes_of(panel: int) -> Chart:
    """The axes that a trace of this panel refers to; the first panel is 1."""
    suffix = "" if panel == 1 else str(panel)
    return {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}


def _axis(name: str, panel: int) -> str:
    return f"{name}axis" if panel == 1 else f"{name}axis{panel}"


def _share_panels(titles: Sequence[str], columns: int, rows: int, tall: int = PANEL) -> Chart:
    layout = _panels(titles, columns, rows, tall)
    for number in range(1, len(titles) + 1):
        layout[_axis("y", number)] |= {"range": [0, 1.04], "dtick": 0.2}
    return layout


def _panels(titles: Sequence[str], columns: int, rows: int, tall: int = PANEL) -> Chart:
    """The layout of panels with titles, row by row from the top."""
    layout: Chart = {
        "barmode": "group",
        "bargap": 0.25,
        "font": {**FONT, "size": 13},
        "height": tall * rows + MARGINS,
        "margin": {"l": 64, "r": 12, "t": 56, "b": 54},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top", "font": {"size": 13}},
        "annotations": [],
    }
    wide, high = 0.07 if columns > 1 else 0.0, 90 / (tall * rows) if rows > 1 else 0.0
    width, height = (1 - wide * (columns - 1)) / columns, (1 - high * (rows - 1)) / rows
    for number, title in enumerate(titles, start=1):
        row, column = divmod(number - 1, columns)
        left, top = column * (width + wide), 1 - row * (height + high)
        on = axes_of(number)
        layout[_axis("x", number)] = {
            "domain": [left, left + width],
            "anchor": on["yaxis"],
            "showgrid": False,
            "linecolor": LINE,
            "dividercolor": LINE,
        }
        layout[_axis("y", number)] = {
            "domain": [max(0.0, top - height), top],
            "anchor": on["xaxis"],
            "gridcolor": LINE,
            "zerolinecolor": LINE,
        }
        layout["annotations"].append(panel_title(title, left, top))
    return layout


def panel_title(text: str, x: float, y: float) -> Chart:
    """The heading of a panel.

    Args:
        text: of the heading.
        x: the panel's left edge, as a fraction of the figure's width.
        y: its upper edge, as a fraction of the height.
    """
    place = {"x": x, "y": y, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom", "yshift": 4}
    return {"text": f"<b>{text}</b>", "showarrow": False, "font": {"size": 14}, **place}


def _axis_title(text: str) -> Chart:
    return {"text": text, "standoff": 8, "font": {"size": 13}}
