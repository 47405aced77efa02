"""The course of a tuning as one HTML file that needs nothing else."""

from typing import Any

import numpy as np

from gmmjax.tuning import ALL, DESCRIPTIONS, HELD_BACK, TRAINED, TuningResult

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY = "#969cac"
# Numbers at 1, 2 and 5 of each decade.
LOGARITHMIC = {"type": "log", "dtick": "D2", "exponentformat": "none"}
# Step numbers on the axis, at most.
STEP_NUMBERS = 12
# Heights in pixels.
PANEL, MARGINS = 250, 190


def tuning_html(result: TuningResult) -> str:
    """The losses and each setting, step by step, for each start; what was chosen is marked.

    Args:
        result: of `tune`.

    Returns:
        HTML, with plotly.js inside.
    """
    from plotly import subplots

    names = result.parameters
    titles = [f"Loss: {DESCRIPTIONS[result.loss]}", *names]
    figure = subplots.make_subplots(
        rows=len(titles), cols=1, shared_xaxes=True, subplot_titles=titles, vertical_spacing=0.08
    )
    for start in range(result.state.free.shape[0]):
        _add_start(figure, result, start)
    figure.add_scatter(
        x=[0, result.state.steps],
        y=[result.baseline[ALL]] * 2,
        mode="lines",
        name="as it was, all pairs",
        line={"color": GREY, "dash": "dash"},
        row=1,
        col=1,
    )
    _mark(figure, result.best_step, result.best[ALL], 1)
    for row, name in enumerate(names, start=2):
        _mark(figure, result.best_step, result.tuned[name], row)
    for row in range(1, len(titles) + 1):
        figure.update_yaxes(_axis(figure, row), row=row, col=1)
    figure.update_xaxes(tick0=0, dtick=-(-result.state.steps // STEP_NUMBERS) or 1)
    figure.update_xaxes(title="step", row=len(titles), col=1)
    figure.update_layout(
        title={"text": _headline(result), "x": 0.02},
        template="plotly_white",
        width=900,
        height=PANEL * len(titles) + MARGINS,
        legend={"orientation": "h", "y": -60 / (PANEL * len(titles)), "yanchor": "top"},
        margin={"t": 110},
    )
    return str(figure.to_html(include_plotlyjs=True, full_html=True))


def _axis(figure: Any, row: int) -> dict[str, Any]:
    """Logarithmic where the values of a panel are positive and span a decade: less would not show three numbers."""
    shown = np.concatenate([np.asarray(line.y, float) for line in figure.select_traces(row=row, col=1)])
    positive = shown[np.isfinite(shown)]
    return LOGARITHMIC if positive.min() > 0 and positive.max() >= 10 * positive.min() else {"type": "linear"}


def _headline(result: TuningResult) -> str:
    values = ", ".join(f"{name} = {value:.4g}" for name, value in result.tuned.items())
    verdict = "Tuned" if result.improved else "Not better than before"
    return (
        f"<b>{verdict}: {values}</b><br><sub>loss {result.best[ALL]:.4g}, before {result.baseline[ALL]:.4g}; "
        f"{len(result.training)} pairs trained on, {len(result.held_back)} held back</sub>"
    )


def _add_start(figure: Any, result: TuningResult, start: int) -> None:
    state, color = result.state, COLORS[start % len(COLORS)]
    raced = np.isfinite(state.losses[:, start, ALL])
    steps = np.flatnonzero(raced)
    name = f"start {start + 1}"
    line = {"color": color}
    common = {"mode": "lines+markers", "marker": {"size": 4}, "col": 1, "legendgroup": name}
    kinds = {TRAINED: ("trained on", "dot"), HELD_BACK: ("held back", "dash"), ALL: ("all pairs", "solid")}
    for kind, (label, dash) in kinds.items():
        losses = state.losses[raced, start, kind]
        style = {**line, "dash": dash, "width": 2 if kind == ALL else 1}
        figure.add_scatter(x=steps, y=losses, name=f"{name}, {label}", line=style, row=1, **common)
    for parameter in range(state.values.shape[2]):
        values = state.values[raced, start, parameter]
        figure.add_scatter(x=steps, y=values, name=name, line=line, showlegend=False, row=2 + parameter, **common)


def _mark(figure: Any, step: int, value: float, row: int) -> None:
    figure.add_scatter(
        x=[step],
        y=[value],
        mode="markers",
        name="chosen",
        marker={"color": "#1b1f2a", "size": 10, "symbol": "diamond"},
        showlegend=row == 1,
        row=row,
        col=1,
    )
