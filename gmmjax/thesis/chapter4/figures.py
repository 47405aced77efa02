"""The figures of chapter 4, drawn with matplotlib, which is imported when the first one is drawn."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool

from gmmjax.evaluation import LabelledPair
from gmmjax.plotting import plot_bars, plot_mixture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rows = Sequence[Mapping[str, Any]]
MEASURES = {"accuracy": "accuracy", "precision": "precision", "recall": "recall", "f1": "F1"}


def clusters(panels: Mapping[str, Any]) -> "Figure":
    """Figure 4.1: clouds with the Gaussians of their mixtures.

    Args:
        panels: by their title a `Clustered`.
    """
    figure, axes = _panels(1, len(panels), (4.0, 4.0))
    _draw_clusters(axes[0], panels)
    return figure


def searches(panels: Mapping[str, Any], found: Mapping[str, Mapping[str, Sequence[int]]]) -> "Figure":
    """Figure 4.2: clouds as the grid search clusters them, and the share of the fits that found each number.

    Args:
        panels: by their title a `Clustered`.
        found: by method and cloud the number of Gaussians of each fit.
    """
    figure, axes = _panels(2, max(2, len(panels)), (4.5, 4.0))
    _draw_clusters(axes[0], panels)
    for ax, cloud in zip(axes[1], next(iter(found.values())), strict=False):
        counts = {method: Counter(numbers[cloud]) for method, numbers in found.items()}
        numbers = sorted(set().union(*counts.values()))
        plot_bars(
            numbers, {name: [own[number] / own.total() for number in numbers] for name, own in counts.items()}, ax=ax
        )
        ax.set(xlabel=f"Gaussians found, {cloud} in truth", ylabel="share of the fits")
    for ax in axes[1, 2:]:
        ax.set_axis_off()
    return figure


def conditions(rows: Rows) -> "Figure":
    """Figure 4.9: a panel for each method, four bars for each condition; the thesis's F1 as dotted lines."""
    said = {row["condition"]: row["f1"] for row in rows if row["method"] == "thesis"}
    methods = list(dict.fromkeys(row["method"] for row in rows if row["method"] != "thesis"))
    figure, axes = _panels(len(methods), 1, (11.0, 2.6))
    for ax, method in zip(axes[:, 0], methods, strict=True):
        _draw_measures(
            ax, [row for row in rows if row["method"] == method and row["condition"] not in said], "condition"
        )
        ax.set_title(method, pad=20)
        for condition, f1 in said.items():
            ax.axhline(f1, color="0.3", linestyle=":", linewidth=1)
            text, place = f" thesis, {condition}", (1.0, f1)
            ax.annotate(text, place, xycoords=("axes fraction", "data"), va="center", fontsize="x-small")
    return figure


def measures(rows: Rows, groups: str) -> "Figure":
    """Figure 4.10: a panel for each method and for the thesis, four bars for each kind of data."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure, axes = _panels(1, len(methods), (4.5, 3.2))
    for ax, method in zip(axes[0], methods, strict=True):
        _draw_measures(ax, [row for row in rows if row["method"] == method], groups)
        ax.set_title(method, pad=20)
    return figure


def opposite(rows: Rows) -> "Figure":
    """Figure 4.12: a bar for each method and kind of data."""
    figure, axes = _panels(1, 1, (8.0, 3.2))
    methods, data = (list(dict.fromkeys(row[name] for row in rows)) for name in ("method", "data"))
    values = {(row["method"], row["data"]): row["accuracy"] for row in rows}
    plot_bars(data, {method: [values.get((method, own)) for own in data] for method in methods}, ax=axes[0, 0])
    axes[0, 0].set(ylabel="accuracy", ylim=(0, 1.1))
    return figure


def filters(pair: LabelledPair, kept: tuple[Bool[np.ndarray, " n0"], Bool[np.ndarray, " n1"]], rows: Rows) -> "Figure":
    """Figure 4.6: both localised maps from above, with all points and without outliers, and the measures of each."""
    figure, axes = _panels(2, 2, (5.5, 4.5))
    for ax, outliers in zip(axes[0], (True, False), strict=True):
        for cloud, own, color in zip((pair.before, pair.after), kept, ("#0072B2", "#E69F00"), strict=True):
            changed = cloud.truth >= 0
            for chosen, tint in ((own & ~changed, color), (own & changed, "#009E73"), (~own & outliers, "#D4005A")):
                ax.plot(*cloud.points[chosen, :2].T, ",", color=tint)
        ax.set(aspect="equal", xlabel="x (m)", title="all points" if outliers else "without outliers")
    for ax, method in zip(axes[1], dict.fromkeys(row["method"] for row in rows), strict=True):
        _draw_measures(ax, [row for row in rows if row["method"] == method], "filters")
        ax.set_title(method, pad=20)
    return figure


def _panels(rows: int, columns: int, size: tuple[float, float]) -> tuple["Figure", np.ndarray]:
    """A figure of panels of this size, inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * size[0], rows * size[1]), layout="compressed")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _draw_clusters(axes: Sequence["Axes"], panels: Mapping[str, Any]) -> None:
    for ax, (title, clustered) in zip(axes, panels.items(), strict=False):
        plot_mixture(clustered.mixture, clustered.points, numbers=False, unit="m", ax=ax)
        ax.set_title(f"{title}: {clustered.gaussians} found")
    for ax in axes[len(panels) :]:
        ax.set_axis_off()


def _draw_measures(ax: "Axes", rows: Rows, groups: str) -> None:
    values = {label: [row[name] for row in rows] for name, label in MEASURES.items()}
    plot_bars([row[groups] for row in rows], values, ax=ax)
    ax.set_ylim(0, 1.1)
