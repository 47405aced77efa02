"""Curves and bars: searches for the number of Gaussians, scores, reliability, and the offsets of a registration."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from jaxtyping import Float

from gmmjax.changes import Changes, GivenCloud, presented
from gmmjax.errors import InputError, check_choice
from gmmjax.geometry import LocalSurface
from gmmjax.mixtures import CRITERIA, Criterion, Fit, GridSearch, failed
from gmmjax.plotting.axes import (
    COLORS,
    INK,
    MARKERS,
    Style,
    axes_or_new,
    legend_inside,
    light_frame,
    verbatim,
    with_unit,
)
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.quantities import length_text
from gmmjax.reporting.splats import thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gmmjax.evaluation import Reliability, ReliabilityRecord, Row

Measure = Literal["f1", "precision", "recall", "point_f1", "point_precision", "point_recall"]
# Points of the before scan through which planes are laid, at most: with fewer, edges are rounded off; and of the after
# scan whose offsets are counted.
SURFACE_POINTS, OFFSETS = 60_000, 15_000


def plot_grid_search(search: GridSearch, *, criterion: Criterion = "mdl", ax: "Axes | None" = None) -> "Axes":
    """Draw the scores of a grid search over the number of components, a line for each covariance type.

    Args:
        search: its result.
        criterion: "mdl", "bic" or "aic"; the lowest score is marked.
        ax: where to draw; None: a new figure.

    Raises:
        InputError: an unknown criterion.
    """
    check_choice("criterion", criterion, CRITERIA)
    ax = axes_or_new(ax, (7.0, 4.5))
    # What failed is infinite: a gap in the line.
    scores = np.asarray(search.scores[criterion], float)
    shown = np.where(np.isfinite(scores), scores, np.nan)
    for row, name in enumerate(search.covariance_types):
        style: Style = {"color": COLORS[row % len(COLORS)], "marker": MARKERS[row % len(MARKERS)]}
        ax.plot(search.components, shown[row], label=name, **style)
    if np.isfinite(scores).any():
        best, column = np.unravel_index(np.nanargmin(shown), shown.shape)
        text = f"lowest: {search.components[column]}, {search.covariance_types[best]}"
        _mark(ax, float(search.components[column]), float(scores[best, column]), text)
    _count_axes(ax, f"{criterion.upper()} (nats)")
    ax.legend(title="covariances", fontsize="small")
    return ax


def plot_message_length(fits: Fit | Sequence[Fit], *, ax: "Axes | None" = None) -> "Axes":
    """Draw the message length of fits over their number of components; the shortest is marked.

    The line joins the shortest length of each number. Fits of one cloud can be compared: the restarts of
    `fit_restarts`, or fits that start from, or end with, different numbers of components.

    Args:
        fits: one `Fit` with a leading axis of restarts, or several; those that are not finite are left out.
        ax: where to draw; None: a new figure.

    Raises:
        InputError: no fit is finite.
    """
    counts, lengths = _counts_and_lengths([fits] if isinstance(fits, Fit) else fits)
    if not len(counts):
        raise InputError("fits: none of them has a finite message length; there is nothing to draw")
    ax = axes_or_new(ax, (7.0, 4.5))
    numbers = np.unique(counts)
    shortest = [lengths[counts == number].min() for number in numbers]
    ax.plot(numbers, shortest, color=COLORS[0], linewidth=1.2, label="shortest")
    ax.plot(counts, lengths, "o", color=COLORS[0], alpha=0.45, markeredgewidth=0, label="each fit")
    best = int(lengths.argmin())
    _mark(ax, float(counts[best]), float(lengths[best]), f"shortest: {counts[best]} Gaussians")
    _count_axes(ax, "message length (nats)")
    ax.legend(fontsize="small")
    return ax


def plot_scores(rows: "Sequence[Row]", *, measure: Measure = "f1", ax: "Axes | None" = None) -> "Axes":
    """Draw the scores of detectors as bars: a group for each condition, a bar for each detector.

    Args:
        rows: of an `Evaluation`: its `rows`, or its `totals`.
        measure: "f1", "precision" or "recall" of the segments, or "point_f1", "point_precision" or "point_recall".
        ax: where to draw; None: a new figure.

    Raises:
        InputError: an unknown measure; no rows.
    """
    check_choice("measure", measure, get_args(Measure))
    if not rows:
        raise InputError("rows: there are none to draw")
    values = {(row.detector, row.group, row.condition): float(getattr(row.scores, measure)) for row in rows}
    conditions = list(dict.fromkeys((row.group, row.condition) for row in rows))
    alone = len({group for group, _ in conditions}) == 1
    names = [own if alone else group if own == "all" else f"{group}, {own}" for group, own in conditions]
    bars = {
        name: [values.get((name, *condition)) for condition in conditions]
        for name in dict.fromkeys(row.detector for row in rows)
    }
    ax = plot_bars(names, bars, ax=ax)
    of = "points" if measure.startswith("point_") else "segments"
    ax.set(ylim=(0, 1.08), ylabel=f"{measure.removeprefix('point_').replace('f1', 'F1')} of the {of}")
    return ax


def plot_bars(
    groups: Sequence[object], bars: Mapping[str, Sequence[float | None]], *, ax: "Axes | None" = None
) -> "Axes":
    """Draw numbers as groups of bars.

    Args:
        groups: names on the axis.
        bars: by name in the legend the number of each group; None: there is no bar.
        ax: where to draw; None: a new figure.

    Returns:
        The axes.
    """
    ax = axes_or_new(ax, (max(6.0, 1.5 + 0.28 * len(groups) * len(bars)), 4.2))
    width = 0.8 / len(bars)
    for number, (name, values) in enumerate(bars.items()):
        drawn = {place: value for place, value in enumerate(values) if value is not None}
        left = np.array(list(drawn), float) - 0.4 + (number + 0.5) * width
        found = ax.bar(left, list(drawn.values()), 0.92 * width, color=COLORS[number % len(COLORS)], label=name)
        ax.bar_label(found, [f"{value:.2f}" for value in drawn.values()], fontsize="x-small", padding=1)
    ax.set_xlim(-0.5, len(groups) - 0.5)
    names = [str(name) for name in groups]
    slanted = max(map(len, names)) > 12 and len(names) > 3
    ax.set_xticks(range(len(names)), names, rotation=25 if slanted else 0, ha="right" if slanted else "center")
    light_frame(ax, axis="y")
    place: Style = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 4, "frameon": False}
    legend_inside(ax, **(place if len(bars) > 1 else {}))
    for text in ax.get_xticklabels():
        verbatim(text)
    return ax


def plot_reliability(curves: "Reliability | Mapping[str, Reliability]", *, ax: "Axes | None" = None) -> "Axes":
    """Draw reliability curves: what share of what was reported at a probability is true.

    On the diagonal, what is reported at 0.9 is true nine times in ten; below it the probabilities are too high. Bars
    are 95 % intervals of the shares (Wilson 1927), by the number of probabilities in each bin.

    Args:
        curves: one, or several by name, such as the `changes` of a `ReliabilityRecord`.
        ax: where to draw; None: a new figure.

    Raises:
        InputError: no curve has any probability.
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
        text = f"Brier score {curve.brier:.3f}, calibration error {curve.calibration_error:.3f}"
        style: Style = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)], "capsize": 2}
        errors = np.abs(_wilson(true, count) - true / count)
        means, label = curve.predicted[bins] / count, f"{name}\n{text}" if name else text
        ax.errorbar(means, true / count, errors, label=label, elinewidth=0.9, **style)
    light_frame(ax)
    ax.set(aspect="equal", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    ax.set(xlabel="mean reported probability", ylabel="share that is true")
    legend_inside(ax)
    return ax


def reliability_figure(record: "ReliabilityRecord") -> "Figure":
    """Draw the curves of the changes that detectors report, and of all points."""
    from matplotlib.figure import Figure

    kinds = {"changes": record.changes, "points": record.points}
    curves = {f"{name}, {kind}": curve for kind, own in kinds.items() for name, curve in own.items()}
    figure = Figure(figsize=(7, 6.5), layout="compressed")
    plot_reliability(curves, ax=figure.subplots())
    return figure


def plot_registration(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw how far the unchanged points of the after scan are from the surface of the before scan.

    The distance is that from the plane through the nearest points of the before scan, along its normal: once for the
    scan as it was given, and once registered. Dashed lines are the residuals that the detection measured.

    Args:
        changes: what was found.
        before: the before cloud; None: that of `changes.clouds`.
        after: the after cloud, as it was given to the detection; None likewise.
        ax: where to draw; None: a new figure.

    Raises:
        InputError: clouds that are not known or are not those of the changes; no point is unchanged.
    """
    clouds, changes = presented(changes, before, after)
    rows = thinned(np.flatnonzero(changes.labels_after < 0), OFFSETS)
    if not len(rows):
        raise InputError("changes: every point of the after cloud changed, so that no surface can be compared")
    ax = axes_or_new(ax, (7.0, 4.5))
    surface_rows = thinned(np.arange(len(clouds.before)), SURFACE_POINTS)
    surface, points = LocalSurface.of(clouds.before.points[surface_rows]), clouds.after.points[rows]
    registration, unit = changes.registration, changes.unit
    drawn = [("as given", _offsets(surface, points), registration.residual_before, KIND_COLORS["disappeared"])]
    if registration.applied:
        offsets = _offsets(surface, registration.apply(points))
        drawn.append(("registered", offsets, registration.residual, KIND_COLORS["moved"]))
    # To the end a stray point would make all else one bar.
    end = max(float(np.quantile(offsets, 0.97)) for _, offsets, *_ in drawn) or 1.0
    for name, offsets, residual, color in drawn:
        style: Style = {"bins": 60, "range": (0, end), "color": color}
        ax.hist(offsets, alpha=0.25, **style)
        median = length_text(float(np.median(offsets)), unit)
        ax.hist(offsets, histtype="step", linewidth=1.4, label=f"{name}, median {median}", **style)
        if residual is not None and residual <= end:
            ax.axvline(residual, color=color, linestyle="--", linewidth=1.2)
    light_frame(ax)
    ax.set(xlim=(0, end), ylabel="points")
    verbatim(ax.xaxis.label).set_text(with_unit("distance from the surface of the before scan", unit))
    legend_inside(ax)
    return ax


def _mark(ax: "Axes", across: float, upwards: float, text: str) -> None:
    """Draw a ring around the lowest place, and text below it."""
    ring: Style = {"markerfacecolor": "none", "markeredgecolor": INK, "markeredgewidth": 1.6, "markersize": 13}
    ax.plot([across], [upwards], "o", zorder=6, **ring)
    ax.margins(y=0.18)
    style: Style = {"textcoords": "offset points", "fontsize": "small", "color": INK, "ha": "center", "va": "top"}
    ax.annotate(text, (across, upwards), xytext=(0, -11), **style)


def _count_axes(ax: "Axes", label: str) -> None:
    """Label axes of something over whole numbers of Gaussians."""
    from matplotlib.ticker import MaxNLocator

    light_frame(ax)
    left, right = ax.get_xlim()
    ax.set_xlim(min(left, np.ceil(left) - 0.5), max(right, np.floor(right) + 0.5))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    ax.ticklabel_format(axis="y", useOffset=False)
    ax.set(xlabel="number of Gaussians", ylabel=label)


def _counts_and_lengths(fits: Sequence[Fit]) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of components and the message length of all fits that are finite."""
    counts, lengths = [np.zeros(0, int)], [np.zeros(0)]
    for fit in fits:
        length = np.atleast_1d(np.asarray(fit.message_length, float))
        usable = np.isfinite(length) & ~np.atleast_1d(np.asarray(failed(fit.result)))
        counts.append(np.atleast_1d(np.asarray(fit.mixture.live).sum(axis=-1))[usable])
        lengths.append(length[usable])
    return np.concatenate(counts), np.concatenate(lengths)


def _wilson(true: np.ndarray, count: np.ndarray) -> Float[np.ndarray, "2 n"]:
    """Return the lower and upper ends of the 95 % interval of a share, by Wilson's score."""
    deviations, share = 1.96, true / count
    middle = (share + deviations**2 / (2 * count)) / (1 + deviations**2 / count)
    root = np.sqrt(share * (1 - share) / count + deviations**2 / (4 * count**2))
    spread = deviations * root / (1 + deviations**2 / count)
    return np.stack([middle - spread, middle + spread])


def _offsets(surface: LocalSurface, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    there = surface.nearest(points)
    return np.abs(((points - surface.centres[there]) * surface.normals[there]).sum(axis=1))
