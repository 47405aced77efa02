"""Plots of how good detections are: scores as bars, and the reliability of probabilities."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from gmmjax.errors import InputError, check_choice
from gmmjax.plotting.figures import Style, axes_or_new, light_frame, verbatim
from gmmjax.plotting.mixtures import COLORS, MARKERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmmjax.evaluation import Reliability, Row

Measure = Literal["f1", "precision", "recall", "point_f1", "point_precision", "point_recall"]


def plot_scores(rows: "Sequence[Row]", *, measure: Measure = "f1", ax: "Axes | None" = None) -> "Axes":
    """Draws the scores of detectors as bars: a group for each condition, a bar for each detector.

    Args:
        rows: of an `Evaluation`: its `rows`, or its `totals`.
        measure: "f1", "precision" or "recall" of the segments, or "point_f1", "point_precision" or "point_recall".
        ax: where to draw; None: a new figure.

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; an unknown measure; no rows.
    """
    check_choice("measure", measure, get_args(Measure))
    if not rows:
        raise InputError("rows: there are none to draw")
    conditions = list(dict.fromkeys((row.group, row.condition) for row in rows))
    detectors = list(dict.fromkeys(row.detector for row in rows))
    ax = axes_or_new(ax, (max(6.0, 1.5 + 0.28 * len(conditions) * len(detectors)), 4.2))
    width = 0.8 / len(detectors)
    for number, detector in enumerate(detectors):
        own = {(row.group, row.condition): row for row in rows if row.detector == detector}
        places = [place for place, condition in enumerate(conditions) if condition in own]
        values = [float(getattr(own[conditions[place]].scores, measure)) for place in places]
        left = np.array(places) - 0.4 + (number + 0.5) * width
        bars = ax.bar(left, values, 0.92 * width, color=COLORS[number % len(COLORS)], label=detector)
        ax.bar_label(bars, [f"{value:.2f}" for value in values], fontsize="x-small", padding=1)
    names = [_condition_name(group, condition, conditions) for group, condition in conditions]
    slanted = max(map(len, names)) > 12 and len(names) > 3
    ax.set_xticks(range(len(names)), names, rotation=25 if slanted else 0, ha="right" if slanted else "center")
    ax.set_ylim(0, 1.08)
    of = "points" if measure.startswith("point_") else "segments"
    ax.set_ylabel(f"{measure.removeprefix('point_').replace('f1', 'F1')} of the {of}")
    light_frame(ax, axis="y")
    _verbatim_legend(ax, outside=len(detectors) > 1)
    for text in ax.get_xticklabels():
        verbatim(text)
    return ax


def plot_reliability(curves: "Reliability | Mapping[str, Reliability]", *, ax: "Axes | None" = None) -> "Axes":
    """Draws reliability curves: what share of what was reported at a probability is true.

    On the diagonal, what is reported at 0.9 is true nine times in ten; below it the probabilities are too high. Bars
    are 95 % intervals of the shares (Wilson 1927), by the number of probabilities in each bin.

    Args:
        curves: one, or several by name, such as the `changes` of a `ReliabilityRecord`.
        ax: where to draw; None: a new figure.

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; no curve has any probability.
    """
    named = curves if isinstance(curves, Mapping) else {"": curves}
    filled = {name: curve for name, curve in named.items() if curve.count.any()}
    if not filled:
        raise InputError("curves: have no probability to draw")
    ax = axes_or_new(ax, (5.8, 5.6))
    ax.plot([0, 1], [0, 1], color="0.6", linestyle=":", linewidth=1.2, zorder=1)
    for number, (name, curve) in enumerate(filled.items()):
        bins = np.flatnonzero(curve.count)
        count, true = curve.count[bins], curve.true[bins]
        mean, share = curve.predicted[bins] / count, true / count
        lower, upper = _wilson(true, count)
        text = f"Brier score {curve.brier:.3f}, calibration error {curve.calibration_error:.3f}"
        style: Style = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)], "capsize": 2}
        errors = np.maximum([share - lower, upper - share], 0)
        ax.errorbar(mean, share, errors, label=f"{name}\n{text}" if name else text, elinewidth=0.9, **style)
    light_frame(ax)
    ax.set_aspect("equal")
    ax.set_xlim(-0.02, 1.02)
    ax.set_ylim(-0.02, 1.02)
    ax.set_xlabel("mean reported probability")
    ax.set_ylabel("share that is true")
    _verbatim_legend(ax)
    return ax


def _condition_name(group: str, condition: str, conditions: Sequence[tuple[str, str]]) -> str:
    """Without the group, where there is only one."""
    if len({group for group, _ in conditions}) == 1:
        return condition
    return group if condition == "all" else f"{group}, {condition}"


def _wilson(true: np.ndarray, count: np.ndarray, deviations: float = 1.96) -> tuple[np.ndarray, np.ndarray]:
    """The interval of a share, by Wilson's score."""
    square, share = deviations**2, true / count
    middle = (share + square / (2 * count)) / (1 + square / count)
    spread = deviations * np.sqrt(share * (1 - share) / count + square / (4 * count**2)) / (1 + square / count)
    return middle - spread, middle + spread


def _verbatim_legend(ax: "Axes", outside: bool = False) -> None:
    place: Style = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 4, "frameon": False} if outside else {}
    for text in ax.legend(fontsize="small", **place).get_texts():
        verbatim(text)
