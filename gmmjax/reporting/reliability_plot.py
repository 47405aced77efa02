"""Reliability curves as one HTML file that needs nothing else."""

from collections.abc import Mapping
from typing import Any

COLORS = ("#0072B2", "#D55E00", "#009E73")


def reliability_html(curves: Mapping[str, Mapping[str, Any]]) -> str:
    """The reliability curves of some detectors: of the changes that they report, and of all points.

    Args:
        curves: `ReliabilityRecord.to_dict()`.

    Returns:
        HTML, with plotly.js inside.
    """
    from plotly import graph_objects

    figure = graph_objects.Figure()
    figure.add_scatter(x=[0, 1], y=[0, 1], mode="lines", name="perfect", line={"color": "#969cac", "dash": "dot"})
    for number, (detector, kinds) in enumerate(curves.items()):
        for kind, curve in kinds.items():
            if curve["count"]:
                figure.add_trace(_trace(f"{detector}, {kind}", curve, COLORS[number % len(COLORS)], kind == "points"))
    axis = {"range": [-0.02, 1.02], "showgrid": True}
    figure.update_layout(
        title="Reliability of the reported probabilities",
        template="plotly_white",
        width=860,
        height=640,
        xaxis={**axis, "title": "mean reported probability"},
        yaxis={**axis, "title": "share that is true", "scaleanchor": "x"},
    )
    return str(figure.to_html(include_plotlyjs=True, full_html=True))


def _trace(name: str, curve: Mapping[str, Any], color: str, dashed: bool) -> dict[str, Any]:
    bins = curve["bins"]
    brier, error = curve["brier"], curve["expected_calibration_error"]
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": f"{name}<br>Brier {brier:.4f}, calibration error {error:.4f}",
        "x": [part["mean_probability"] for part in bins],
        "y": [part["share_true"] for part in bins],
        "text": [f"{part['count']:,} reported from {part['from']:.1f} to {part['to']:.1f}" for part in bins],
        "line": {"color": color, "dash": "dash" if dashed else "solid"},
        "marker": {"color": color, "size": 8},
    }
