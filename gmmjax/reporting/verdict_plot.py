"""How a verdict was tuned, as one HTML file that needs nothing else."""

from typing import Any

import numpy as np

from gmmjax.reporting.tuning_plot import COLORS, GREY
from gmmjax.tuning import VerdictCourse, VerdictResult

TITLES = {"poses_unknown": "without poses", "poses_given": "with poses"}


def verdict_html(result: VerdictResult) -> str:
    """For each verdict the log score by the draw towards the start, and the weights that moved most.

    Args:
        result: of `tune_verdict`.

    Returns:
        HTML, with plotly.js inside.
    """
    from plotly import subplots

    courses = result.courses
    rows = max(len(courses), 1)
    titles = [
        title
        for name, course in courses.items()
        for title in (
            f"Verdict {TITLES[name]}: log score of {course.candidates} candidates held back, nats",
            "Weights in the log odds of a change",
        )
    ]
    figure = subplots.make_subplots(
        rows=rows, cols=2, subplot_titles=titles, horizontal_spacing=0.2, vertical_spacing=0.2 / rows
    )
    for row, course in enumerate(courses.values(), start=1):
        _add_losses(figure, course, row)
        _add_weights(figure, course, row)
    figure.update_layout(
        title={"text": _headline(result), "x": 0.02},
        template="plotly_white",
        width=1100,
        height=380 * rows + 150,
        barmode="group",
        legend={"orientation": "h", "y": -0.15 / rows, "yanchor": "top"},
        margin={"t": 110},
    )
    return str(figure.to_html(include_plotlyjs=True, full_html=True))


def _add_losses(figure: Any, course: VerdictCourse, row: int) -> None:
    """The scores over the draws, the strongest first, from the start's, whose draw is infinite."""
    names = ["as it was" if np.isinf(draw) else f"{draw:g}" for draw in course.draws]
    common = {"row": row, "col": 1}
    line = {"color": COLORS[0]}
    figure.add_scatter(
        x=names, y=course.losses, mode="lines+markers", line=line, name="held back", showlegend=row == 1, **common
    )
    figure.add_scatter(
        x=[names[course.chosen]],
        y=[course.losses[course.chosen]],
        mode="markers",
        name="chosen",
        marker={"color": "#1b1f2a", "size": 10, "symbol": "diamond"},
        showlegend=row == 1,
        **common,
    )
    figure.update_xaxes(title="draw towards the start, candidates", type="category", **common)


def _add_weights(figure: Any, course: VerdictCourse, row: int, most: int = 12) -> None:
    """The weights before and after, those that moved most, at most a number; that which moved most on top."""
    moved = course.moved_weights()[:most][::-1]
    names = [name for name, _, _ in moved]
    common = {"y": names, "orientation": "h", "showlegend": row == 1, "row": row, "col": 2}
    figure.add_bar(x=[after for _, _, after in moved], name="tuned", marker={"color": COLORS[1]}, **common)
    figure.add_bar(x=[before for _, before, _ in moved], name="before", marker={"color": GREY}, **common)
    figure.update_xaxes(title="log odds for a standard deviation of the fact", row=row, col=2)


def _headline(result: VerdictResult) -> str:
    verdict = "Verdict tuned" if result.improved else "Verdict not better than before"
    line = f"{len(result.pairs)} pairs, each held back once"
    if result.before is not None and result.after is not None:
        line += (
            f"; detect on them: segment F1 {result.after.f1:.3f} (before {result.before.f1:.3f}), "
            f"{result.after.false_segments} false segments (before {result.before.false_segments})"
        )
    return f"<b>{verdict}</b><br><sub>{line}</sub>"
