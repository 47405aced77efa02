"""The course of a tuning, as `gmmjax tune` writes it beside the settings."""

from typing import TYPE_CHECKING, Any

import numpy as np

from gmmjax.plotting.axes import COLORS, INK, Style, light_frame, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gmmjax.tuning import TuningResult, VerdictCourse, VerdictResult

GREY = "#969cac"
CHOSEN: Style = {"color": INK, "marker": "D", "markersize": 8, "linestyle": "", "label": "chosen", "zorder": 4}
TITLES = {"poses_unknown": "without poses", "poses_given": "with poses"}


def tuning_figure(result: "TuningResult | VerdictResult") -> "Figure":
    """Draw how a tuning went; what was chosen is marked.

    Args:
        result: of `tune`: the losses and each setting step by step for each start; of a verdict the log score by the
            draw towards the start, and the weights that moved most.
    """
    from gmmjax.tuning import VerdictResult

    return _verdict_figure(result) if isinstance(result, VerdictResult) else _settings_figure(result)


def _settings_figure(result: "TuningResult") -> "Figure":
    from gmmjax.tuning import ALL, DESCRIPTIONS

    figure = _figure((9.0, 2.6 * (1 + len(result.parameters)) + 1.4), _tuning_headline(result))
    losses, *settings = figure.subplots(1 + len(result.parameters), 1, sharex=True, squeeze=False)[:, 0]
    losses.set_title(f"Loss: {DESCRIPTIONS[result.loss]}")
    losses.axhline(result.baseline[ALL], color=GREY, linestyle="--", label="as it was, all pairs")
    for start in range(result.state.losses.shape[1]):
        _draw_losses(losses, result, start)
    losses.plot(result.best_step, result.best[ALL], **CHOSEN)
    for number, (ax, name) in enumerate(zip(settings, result.parameters, strict=True)):
        ax.set_title(name)
        for start in range(result.state.losses.shape[1]):
            ax.plot(result.state.values[:, start, number], ".-", color=COLORS[start % len(COLORS)])
        ax.plot(result.best_step, result.tuned[name], **CHOSEN)
    for ax in (losses, *settings):
        _dress(ax)
    figure.axes[-1].set_xlabel("step")
    figure.legend(loc="outside lower center", ncols=4, fontsize="small")
    return figure


def _draw_losses(ax: "Axes", result: "TuningResult", start: int) -> None:
    """Draw the losses of a start, as far as it was followed."""
    from gmmjax.tuning import ALL, HELD_BACK, TRAINED

    kinds = {TRAINED: ("trained on", ":", 1), HELD_BACK: ("held back", "--", 1), ALL: ("all pairs", "-", 2)}
    for kind, (label, line, width) in kinds.items():
        style: Style = {"color": COLORS[start % len(COLORS)], "linestyle": line, "linewidth": width, "marker": "."}
        ax.plot(result.state.losses[:, start, kind], label=f"start {start + 1}, {label}", **style)


def _dress(ax: "Axes") -> None:
    """Show whole steps; a logarithmic axis where positive values span a decade: less would show no numbers."""
    from matplotlib.ticker import MaxNLocator

    light_frame(ax)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    shown = np.concatenate([np.asarray(line.get_ydata(), float) for line in ax.lines])
    shown = shown[np.isfinite(shown)]
    if shown.min() > 0 and shown.max() >= 10 * shown.min():
        ax.set_yscale("log")


def _tuning_headline(result: "TuningResult") -> str:
    from gmmjax.tuning import ALL

    values = ", ".join(f"{name} = {value:.4g}" for name, value in result.tuned.items())
    verdict = "Tuned" if result.improved else "Not better than before"
    return (
        f"{verdict}: {values}\nloss {result.best[ALL]:.4g}, before {result.baseline[ALL]:.4g}; "
        f"{len(result.training)} pairs trained on, {len(result.held_back)} held back"
    )


def _verdict_figure(result: "VerdictResult") -> "Figure":
    count = max(len(result.courses), 1)
    figure = _figure((11.0, 3.8 * count + 1.2), _verdict_headline(result))
    rows = figure.subplots(count, 2, squeeze=False)
    for (losses, weights), (name, course) in zip(rows, result.courses.items(), strict=False):
        losses.set_title(f"Verdict {TITLES[name]}: log score of {course.candidates}\ncandidates held back, nats")
        _draw_scores(losses, course)
        weights.set_title("Weights in the log odds of a change")
        _draw_weights(weights, course)
    return figure


def _draw_scores(ax: "Axes", course: "VerdictCourse") -> None:
    """Draw the scores over the draws, the strongest first, from the start's, whose draw is infinite."""
    names = ["as it was" if np.isinf(draw) else f"{draw:g}" for draw in course.draws]
    ax.plot(names, course.losses, ".-", color=COLORS[0], label="held back")
    ax.plot(names[course.chosen], course.losses[course.chosen], **CHOSEN)
    light_frame(ax)
    ax.set_xlabel("draw towards the start, candidates")
    ax.legend(fontsize="small")


def _draw_weights(ax: "Axes", course: "VerdictCourse") -> None:
    """Draw the twelve weights that moved most before and after; that which moved most on top."""
    names, before, after = zip(*course.moved_weights()[:12], strict=True)
    places = np.arange(len(names))
    ax.barh(places - 0.2, after, 0.38, color=COLORS[1], label="tuned")
    ax.barh(places + 0.2, before, 0.38, color=GREY, label="before")
    ax.set_yticks(places, names)
    ax.invert_yaxis()
    light_frame(ax, axis="x")
    ax.set_xlabel("log odds for a standard deviation of the fact")
    ax.legend(fontsize="small")


def _verdict_headline(result: "VerdictResult") -> str:
    verdict = "Verdict tuned" if result.improved else "Verdict not better than before"
    line = f"{len(result.pairs)} pairs, each held back once"
    if result.before is not None and result.after is not None:
        line += (
            f"; detect on them: segment F1 {result.after.f1:.3f} (before {result.before.f1:.3f}), "
            f"{result.after.false_segments} false segments (before {result.before.false_segments})"
        )
    return f"{verdict}\n{line}"


def _figure(size: tuple[float, float], headline: str) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    verbatim(figure.suptitle(headline))
    return figure
