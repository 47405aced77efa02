"""Settings of change detection, tuned by gradient on scans of one's own: those of the mixture, or the verdict."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import optax

from gmmjax.changes import DetectionConfig
from gmmjax.errors import InputError
from gmmjax.evaluation import Scores
from gmmjax.tuning.detection_scores import detection_scores, gained
from gmmjax.tuning.pair_loss import LABELLED, UNLABELLED, Loss
from gmmjax.tuning.parameter_names import VERDICT
from gmmjax.tuning.parameters import check_parameters
from gmmjax.tuning.scan_pairs import ScanPair, on_surfaces
from gmmjax.tuning.search import ALL, HELD_BACK, Search, TuningState, alike, described, least
from gmmjax.tuning.settings import LossChoice, TuningSettings
from gmmjax.tuning.split_pairs import split_pairs
from gmmjax.tuning.verdict_tuning import VerdictResult, VerdictState, tune_verdict

Stop = Literal["steps", "patience", "not finite"]
STOPS: dict[Stop, str] = {
    "steps": "all steps were taken",
    "patience": "the loss of the pairs held back had not fallen any more",
    "not finite": "no pair gave a loss and a gradient that are numbers; the last good settings were kept",
}


@dataclasses.dataclass(frozen=True)
class TuningResult:
    """Result of tuning settings of the mixture.

    Attributes:
        config: with the tuned settings; as it was given where they are no better.
        improved: whether they were tuned, and are better.
        loss: what was minimised.
        parameters: the names of the settings.
        tuned: their best values.
        baseline: losses of the config as it was given: of all pairs, of those trained on, of those held back.
        best: the same of the tuned settings.
        f1_before: segment and point F1 of `detect_changes` on all pairs, with the config as it was given; None without
            truth.
        f1_after: the same with the tuned settings.
        best_step: the step that they are of; 0 is before the first.
        best_start: the start that they are of.
        stopped: why it ended.
        training: names of the pairs that were trained on.
        held_back: names of the pairs that were not.
        state: the whole course.
    """

    config: DetectionConfig
    improved: bool
    loss: Loss
    parameters: tuple[str, ...]
    tuned: dict[str, float]
    baseline: tuple[float, ...]
    best: tuple[float, ...]
    best_step: int
    best_start: int
    stopped: Stop
    training: tuple[str, ...]
    held_back: tuple[str, ...]
    state: TuningState
    f1_before: tuple[float, float] | None = None
    f1_after: tuple[float, float] | None = None

    def to_dict(self) -> dict[str, Any]:
        """The result as plain values, with its course; None in place of what is not a number."""
        groups = ("all", "trained", "held_back")
        return {
            "improved": self.improved,
            "config": self.config.to_dict(),
            "loss": self.loss,
            "tuned": self.tuned,
            "losses_before": dict(zip(groups, _plain(self.baseline), strict=True)),
            "losses_after": dict(zip(groups, _plain(self.best), strict=True)),
            "f1_before": self.f1_before,
            "f1_after": self.f1_after,
            "best_step": self.best_step,
            "best_start": self.best_start,
            "stopped": self.stopped,
            "trained_on": list(self.training),
            "held_back": list(self.held_back),
            "course": {
                "parameters": list(self.parameters),
                "values": _plain(self.state.values),
                "losses": _plain(self.state.losses),
            },
        }


def _plain(values: np.ndarray | tuple[float, ...]) -> Any:
    """Nested lists with None in place of what is not a number."""
    numbers = np.asarray(values)
    plain = numbers.astype(object)
    plain[~np.isfinite(numbers)] = None
    return plain.tolist()


def tune(
    pairs: Sequence[ScanPair],
    *,
    config: DetectionConfig = DetectionConfig(),
    settings: TuningSettings = TuningSettings(),
    optimiser: optax.GradientTransformation | None = None,
    resume: TuningState | VerdictState | None = None,
    checkpoint: Callable[[TuningState | VerdictState], None] = lambda state: None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> TuningResult | VerdictResult:
    """Tunes change detection by gradient, on pairs of one's own: the verdict on scans, or settings of the mixture.

    What is tuned is said by `TuningSettings.parameters`; see `tune_verdict` and `tune_mixture`. By default it is the
    verdict where all pairs are labelled scans of surfaces, and the mixture's settings elsewhere.

    Args:
        pairs: of scans like those that changes will be looked for in; see `unchanged_pair` for those of places where
            nothing changed.
        config: everything that is not tuned, and where tuning starts.
        settings: what is tuned, and how.
        optimiser: of the mixture's settings, see `tune_mixture`.
        resume: of an earlier call with the same pairs and settings that was interrupted.
        checkpoint: called with the state after every step.
        progress: called with what is being done and the share of the work that is done.

    Returns:
        What was tuned and how it was found.

    Raises:
        InputError: no pairs, truth that does not fit the points or is missing where it is needed, or parameters that
            cannot be tuned; it names the pair.

    Warns:
        InputWarning: too few pairs to hold some back.
    """
    if not len(pairs):
        raise InputError("pairs is empty; give at least one pair of scans")
    if _of_verdict(pairs, config, settings):
        known = resume if isinstance(resume, VerdictState) else None
        return tune_verdict(
            pairs, config=config, settings=settings, resume=known, checkpoint=checkpoint, progress=progress
        )
    return tune_mixture(
        pairs,
        config=config,
        settings=settings,
        optimiser=optimiser,
        resume=resume if isinstance(resume, TuningState) else None,
        checkpoint=checkpoint,
        progress=progress,
    )


def _of_verdict(pairs: Sequence[ScanPair], config: DetectionConfig, settings: TuningSettings) -> bool:
    """True if the verdict is tuned."""
    if settings.parameters is not None:
        check_parameters(settings.parameters, config)
        return VERDICT in settings.parameters
    decides = config.method == "joint" and config.evidence and settings.loss == "auto"
    return decides and all(pair.labelled for pair in pairs) and all(on_surfaces(pair, config) for pair in pairs)


def tune_mixture(
    pairs: Sequence[ScanPair],
    *,
    config: DetectionConfig = DetectionConfig(),
    settings: TuningSettings = TuningSettings(),
    optimiser: optax.GradientTransformation | None = None,
    resume: TuningState | None = None,
    checkpoint: Callable[[TuningState], None] = lambda state: None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> TuningResult:
    """Tunes settings of the joint mixture by gradient, on pairs with truth or without.

    Each step fits the joint mixture of some pairs, follows the gradient of their loss through the fits (by implicit
    differentiation), and takes a step of the optimiser. It ends when the pairs that are held back gain no more. The
    settings with the least loss of all pairs are chosen (a handful of scenes differ by more than so few settings can be
    fitted to them), moved to the middle of those about them that are as good. They are kept only if they are clearly
    better than what was given, not at the cost of the pairs that were held back, and if `detect_changes` finds no less
    by them; or if it finds more.

    Args:
        pairs: of scans like those that changes will be looked for in; a handful is enough for one or two settings.
        config: everything that is not tuned, and where tuning starts: a setting that is None starts at what is derived
            from the data.
        settings: what is tuned, by which loss, and how long.
        optimiser: any of optax, in place of Adam with the settings' learning rate. The free numbers that it moves are
            logarithms (of the noise share, log odds).
        resume: of an earlier call with the same pairs and settings that was interrupted.
        checkpoint: called with the state after every step.
        progress: called with what is being done and the share of the work that is done.

    Returns:
        The tuned config and the course that led there.

    Raises:
        InputError: no pairs, truth that does not fit the points, a loss that needs truth which is not there, settings
            that cannot be tuned, or a loss that is not finite at the start; it names the pair.

    Warns:
        InputWarning: fewer than three pairs: those that are trained on are also validated on.
    """
    names = settings.of_mixture
    check_parameters(names, config)
    loss = _loss_of(pairs, settings.loss)
    progress("Preparing the pairs", 0.0)
    split = split_pairs(pairs, config, settings, progress)
    search = Search(split, names, loss, settings, optimiser or optax.adam(settings.learning_rate))
    state = search.first_state() if resume is None else resume
    checkpoint(state)
    state, stopped = _searched(search, state, settings, checkpoint, progress)
    progress("Centring the settings", 0.9)
    result = _result(search, state, config, stopped)
    if loss in LABELLED:
        result = _judged_by_detection(result, pairs, config, progress)
    progress("Done", 1.0)
    return result if result.improved else dataclasses.replace(result, config=config)


def _searched(
    search: Search,
    state: TuningState,
    settings: TuningSettings,
    checkpoint: Callable[[TuningState], None],
    progress: Callable[[str, float], None],
) -> tuple[TuningState, Stop]:
    """The last state of the course from this one on, and why it ends there."""
    while state.steps < settings.steps:
        progress(described(state, search.names, search.loss), 0.05 + 0.85 * state.steps / settings.steps)
        following = search.step(state)
        if following is None:
            return state, "not finite"
        state = following
        checkpoint(state)
        if state.steps - least(state.losses[..., HELD_BACK])[0] >= settings.patience:
            return state, "patience"
    return state, "steps"


def _judged_by_detection(
    result: TuningResult,
    pairs: Sequence[ScanPair],
    config: DetectionConfig,
    progress: Callable[[str, float], None],
) -> TuningResult:
    """The result with what `detect_changes` makes of the settings.

    They are kept if it finds no less by them; where the loss is not clearly lower, only if it finds more.
    """

    def scores(settings: DetectionConfig, first: float) -> Scores:
        return detection_scores(
            pairs, [settings] * len(pairs), lambda stage, share: progress(stage, first + 0.04 * share)
        )

    before, after = scores(config, 0.92), scores(result.config, 0.96)
    no_less, more = gained(before, after)
    return dataclasses.replace(
        result,
        improved=no_less and (result.improved or more),
        f1_before=(before.f1, before.point_f1),
        f1_after=(after.f1, after.point_f1),
    )


def _loss_of(pairs: Sequence[ScanPair], choice: LossChoice) -> Loss:
    if not len(pairs):
        raise InputError("pairs is empty; give at least one pair of scans")
    without = [pair.name for pair in pairs if not pair.labelled]
    if choice == "auto":
        if without and len(without) < len(pairs):
            raise InputError(f"pairs {', '.join(without)}: have no truth, and others have; give truth for all or none")
        return UNLABELLED[0] if without else LABELLED[0]
    if choice in LABELLED and without:
        raise InputError(f"pairs {', '.join(without)}: have no truth; give it, or choose loss='likelihood'")
    return choice


def _result(search: Search, state: TuningState, config: DetectionConfig, stopped: Stop) -> TuningResult:
    """The best settings of the course, in a config, and whether their loss is clearly lower."""
    step, start = least(state.losses[..., ALL])
    values, best = search.centred(state.values[step, start])
    baseline, names = state.baseline, search.names
    tuned = {name: float(value) for name, value in zip(names, values, strict=True)}
    # Not `<`: any loss is better than none, where the config as it was given has none.
    improved = bool(not best[ALL] >= baseline[ALL] - alike(baseline[ALL], search.loss))
    # A few pairs more or less: those held back may lose a little, but not what all together gain.
    improved = improved and bool(not best[HELD_BACK] - baseline[HELD_BACK] > baseline[ALL] - best[ALL])
    training, held_back = search.pairs.names
    return TuningResult(
        config=DetectionConfig.from_dict({**config.to_dict(), **tuned}),
        improved=improved,
        loss=search.loss,
        parameters=names,
        tuned=tuned,
        baseline=tuple(baseline.tolist()),
        best=tuple(best.tolist()),
        best_step=step,
        best_start=start,
        stopped=stopped,
        training=training,
        held_back=held_back,
        state=state,
    )
