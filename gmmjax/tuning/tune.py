"""Settings of change detection, tuned by gradient on scans of one's own."""

import dataclasses
import warnings
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Bool, Float

from gmmjax.changes.config import DetectionConfig
from gmmjax.errors import InputError, InputWarning, check_choice
from gmmjax.mixtures.cores import map_on_cores
from gmmjax.tuning.pair_loss import (
    LABELLED,
    UNLABELLED,
    Loss,
    pair_loss,
    pair_loss_alone,
    total_gradient,
    total_loss,
)
from gmmjax.tuning.parameters import ParameterName, check_parameters, free_values, settings_of
from gmmjax.tuning.scan_pairs import ReadyPair, ScanPair, ready_pair

LossChoice = Literal["auto", "f1", "brier", "log", "likelihood"]
Stop = Literal["steps", "patience", "not finite"]
STOPS: dict[Stop, str] = {
    "steps": "all steps were taken",
    "patience": "the loss of the pairs held back had not fallen any more",
    "not finite": "no pair gave a loss and a gradient that are numbers; the last good settings were kept",
}
# A gain below this share of the loss (of the likelihood, so many nats a point) may be the luck of the few
# pairs that it is measured on.
LEAST_GAIN, LEAST_NATS = 0.01, 0.005
# The losses of a step: of all pairs, of those that are trained on, of those that are held back.
ALL, TRAINED, HELD_BACK = 0, 1, 2
# After so many steps only the best start goes on.
RACE = 8
# Random starts of the fits over which the losses of a pair are averaged; with more than so many pairs, one.
JUDGING_FITS, MANY_PAIRS = 2, 12


@dataclasses.dataclass(frozen=True)
class TuningSettings:
    """How settings are tuned.

    Attributes:
        parameters: the settings that are tuned: noise_floor, tolerance, concentration, noise_share, covariance_scale,
            degrees_of_freedom.
        loss: "f1" (1 less the expected F1 of the points), "brier" or "log" score of their probabilities, all against
            truth; "likelihood" of held-out points, without. "auto": "f1" where all pairs have truth, else "likelihood".
        steps: of the optimiser at the most.
        learning_rate: of Adam, where no other optimiser is given: about the factor, less 1, by which a setting changes
            in a step.
        pairs_per_step: drawn at random for each step; all, where there are no more.
        starts: the first from the config's settings (or those derived from the data), the others up to a factor of 5
            beside them; after a few steps the best alone goes on.
        validation_share: of the pairs, which are held back: not trained on.
        patience: steps without a lower loss of the pairs held back after which it ends.
        max_points: that each fit sees, and that are judged of each cloud.
        seed: of all that is random.
    """

    parameters: tuple[ParameterName, ...] = ("noise_floor", "tolerance")
    loss: LossChoice = "auto"
    steps: int = 40
    learning_rate: float = 0.2
    pairs_per_step: int = 4
    starts: int = 3
    validation_share: float = 0.4
    patience: int = 12
    max_points: int = 4096
    seed: int = 0

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: a setting out of its range, by name.
        """
        check_choice("loss", self.loss, get_args(LossChoice))
        least = {"steps": 1, "pairs_per_step": 1, "starts": 1, "patience": 1, "max_points": 100, "seed": 0}
        for name, lowest in least.items():
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < lowest:
                raise InputError(f"{name}={value!r} must be a whole number of at least {lowest}")
        if not (isinstance(self.learning_rate, int | float) and 0 < self.learning_rate < float("inf")):
            raise InputError(f"learning_rate={self.learning_rate!r} must be a positive number")
        if not (isinstance(self.validation_share, int | float) and 0 < self.validation_share < 1):
            raise InputError(f"validation_share={self.validation_share!r} must lie between 0 and 1")


class TuningState(NamedTuple):
    """Where tuning stands after some steps; arrays alone, so that it can be stored and taken up again.

    Attributes:
        free: the settings of each start, as free numbers.
        optimiser: the leaves of the optimiser's state.
        racing: which starts still go on.
        values: the settings of each step and start, the first of them before any step.
        losses: of these, on all pairs, on those that are trained on, and on those that are held back; NaN where the
            start had stopped.
        baseline: the three losses of the config as it was given.
    """

    free: Float[np.ndarray, "s p"]
    optimiser: tuple[np.ndarray, ...]
    racing: Bool[np.ndarray, " s"]
    values: Float[np.ndarray, "t s p"]
    losses: Float[np.ndarray, "t s 3"]
    baseline: Float[np.ndarray, " 3"]

    @property
    def steps(self) -> int:
        """How many steps were taken."""
        return len(self.losses) - 1


@dataclasses.dataclass(frozen=True)
class TuningResult:
    """Result of `tune`.

    Attributes:
        config: with the tuned settings; as it was given where they did not lower the loss, or at the cost of the pairs
            held back.
        improved: whether they did.
        loss: what was minimised.
        parameters: the names of the settings.
        tuned: their best values.
        baseline: losses of the config as it was given: of all pairs, of those trained on, of those held back.
        best: the same of the tuned settings.
        best_step: the step that they are of; 0 is before the first.
        best_start: the start that they are of.
        stopped: why it ended.
        training: names of the pairs that were trained on.
        validation: names of the pairs that were held back.
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
    validation: tuple[str, ...]
    state: TuningState


class _Pairs(NamedTuple):
    """Pairs made ready, and their names."""

    training: list[ReadyPair]
    validation: list[ReadyPair]
    names: tuple[tuple[str, ...], tuple[str, ...]]


def tune(
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
    settings with the least loss of all pairs are chosen: a handful of scenes differ by more than so few settings can be
    fitted to them. They are kept only if they are better than what was given, and not at the cost of the pairs that
    were held back.

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
    names = tuple(settings.parameters)
    check_parameters(names, config)
    loss = _loss_of(pairs, settings.loss)
    progress("Preparing the pairs", 0.0)
    ready = _ready(pairs, config, settings, progress)
    search = _Search(ready, names, loss, settings, optimiser or optax.adam(settings.learning_rate))
    state = search.first_state() if resume is None else resume
    checkpoint(state)
    stopped: Stop = "steps"
    while state.steps < settings.steps:
        progress(_described(state, names, loss), 0.05 + 0.95 * state.steps / settings.steps)
        following = search.step(state)
        if following is None:
            stopped = "not finite"
            break
        state = following
        checkpoint(state)
        if state.steps - _least(state.losses[..., HELD_BACK])[0] >= settings.patience:
            stopped = "patience"
            break
    progress("Done", 1.0)
    return _result(state, names, loss, config, stopped, ready.names)


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


def _ready(
    pairs: Sequence[ScanPair],
    config: DetectionConfig,
    settings: TuningSettings,
    progress: Callable[[str, float], None],
) -> _Pairs:
    unlabelled = settings.loss == "likelihood"
    ready = []
    for number, pair in enumerate(pairs):
        progress(f"Preparing {pair.name}", 0.05 * number / len(pairs))
        # Held-out points are drawn only where the truth is not looked at.
        own = dataclasses.replace(pair, truth_before=None, truth_after=None) if unlabelled else pair
        ready.append(ready_pair(own, config, settings.max_points, settings.seed + number))
    if len(pairs) < 3:
        warnings.warn(
            f"{len(pairs)} pairs are too few to hold one back: the tuned settings are judged by the pairs that they "
            "were tuned on; give three or more",
            InputWarning,
            stacklevel=3,
        )
        training = validation = list(range(len(pairs)))
    else:
        training, validation = _split([_changed(pair) for pair in pairs], settings)
    return _Pairs(
        [ready[number] for number in training],
        [ready[number] for number in validation],
        (tuple(pairs[number].name for number in training), tuple(pairs[number].name for number in validation)),
    )


def _changed(pair: ScanPair) -> bool:
    return any(truth is not None and bool((truth >= 0).any()) for truth in (pair.truth_before, pair.truth_after))


def _split(changed: Sequence[bool], settings: TuningSettings) -> tuple[list[int], list[int]]:
    """Which pairs are trained on and which are held back: the same share of those with changes and of those without."""
    generator = np.random.default_rng(settings.seed)
    kinds = [np.flatnonzero(np.asarray(changed) == kind) for kind in (True, False)]
    # In an order in which every stretch has its share of both kinds.
    places = np.concatenate([(np.arange(len(kind)) + 0.5) / max(len(kind), 1) for kind in kinds])
    order = np.concatenate([generator.permutation(kind) for kind in kinds])[np.argsort(places, kind="stable")]
    held_back = min(len(changed) - 1, max(1, round(settings.validation_share * len(changed))))
    return sorted(order[held_back:].tolist()), sorted(order[:held_back].tolist())


class _Search:
    """The losses and the optimiser of one tuning."""

    def __init__(
        self,
        pairs: _Pairs,
        names: tuple[str, ...],
        loss: Loss,
        settings: TuningSettings,
        optimiser: optax.GradientTransformation,
    ) -> None:
        self.pairs, self.names, self.loss, self.settings, self.optimiser = pairs, names, loss, settings, optimiser
        self.key = jax.random.key(settings.seed)

    def first_state(self) -> TuningState:
        """The starts with their validation losses.

        Raises:
            InputError: a loss that is not finite.
        """
        starts = self.settings.starts
        own = np.array([free_values(self.names, pair.prior) for pair in self.pairs.training])
        beside = np.random.default_rng(self.settings.seed).uniform(-np.log(5), np.log(5), (starts, len(self.names)))
        beside[0] = 0
        free = np.median(own, axis=0)[None] + beside
        baseline = self._judged(np.zeros((1, 0)), ())[0]
        losses = self._judged(free, self.names)
        if not np.isfinite(losses[0]).all():
            names = (*self.pairs.names[0], *self.pairs.names[1])
            raise InputError(
                f"the loss is {losses[0, ALL]} at the start, on the pairs {', '.join(dict.fromkeys(names))}: look at "
                "the settings of the config, and whether `detect_changes` works for these pairs"
            )
        return TuningState(
            free=free,
            optimiser=_leaves(self._initial(free)),
            racing=np.ones(starts, bool),
            values=self._values(free)[None],
            losses=losses[None],
            baseline=baseline,
        )

    def step(self, state: TuningState) -> TuningState | None:
        """One step of the starts that still race; None where none of them has a gradient any more."""
        racing = np.flatnonzero(state.racing)
        gradients = self._gradients(state.free[racing], state.steps)
        usable = np.isfinite(gradients).all(axis=1)
        racing, gradients = racing[usable], gradients[usable]
        if not len(racing):
            return None
        free, optimiser = self._updated(state, gradients, racing)
        losses = np.full((len(free), 3), np.nan)
        losses[racing] = self._judged(free[racing], self.names)
        if not np.isfinite(losses[racing, ALL]).any():
            return None
        following = TuningState(
            free=free,
            optimiser=optimiser,
            racing=np.isfinite(losses[:, ALL]),
            values=np.concatenate([state.values, self._values(free)[None]]),
            losses=np.concatenate([state.losses, losses[None]]),
            baseline=state.baseline,
        )
        if following.steps == RACE:
            leading = int(np.nanargmin(losses[:, ALL]))
            following = following._replace(racing=np.arange(len(free)) == leading)
        return following

    def _gradients(self, free: np.ndarray, step: int) -> np.ndarray:
        """The gradient of each start's loss on the pairs of a step; NaN where none of them has one."""
        generator = np.random.default_rng([self.settings.seed, step])
        count = min(self.settings.pairs_per_step, len(self.pairs.training))
        chosen = [self.pairs.training[n] for n in generator.choice(len(self.pairs.training), count, replace=False)]
        keys = jax.random.split(jax.random.fold_in(self.key, step), count)
        tasks = [(own, pair, key) for own in free for pair, key in zip(chosen, keys, strict=True)]

        def one(own: Any, pair: ReadyPair, key: Any) -> Any:
            return pair_loss(own, pair, key, self.names, self.loss)

        parts = map_on_cores(one, tasks, "float64")
        sums = parts.sums.reshape(len(free), count, 2)
        gradients = parts.gradients.reshape(len(free), count, 2, -1)
        # A fit that did not come to rest has no gradient; those of the other pairs will do.
        there = np.isfinite(sums).all(axis=2) & np.isfinite(gradients).all(axis=(2, 3))
        slopes = np.full(free.shape, np.nan)
        for start in np.flatnonzero(there.any(axis=1)):
            own = there[start]
            slopes[start] = total_gradient(sums[start, own], gradients[start, own], self.loss)
        return slopes

    def _judged(self, free: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        """For each start the losses of all pairs, of those trained on and of those held back.

        The fits begin always at the same random starts, so that steps can be compared.
        """
        groups = (self.pairs.training, self.pairs.validation)
        pairs = list({id(pair): pair for group in groups for pair in group}.values())
        places = [[pairs.index(pair) for pair in group] for group in (pairs, *groups)]
        fits = JUDGING_FITS if len(pairs) <= MANY_PAIRS else 1
        keys = jax.random.split(jax.random.fold_in(self.key, 2**31 - 1), fits)
        tasks = [(own, pair, key) for own in free for pair in pairs for key in keys]

        def one(own: Any, pair: ReadyPair, key: Any) -> Any:
            return pair_loss_alone(own, pair, key, names, self.loss)

        sums = map_on_cores(one, tasks, "float64").reshape(len(free), len(pairs), fits, 2).sum(axis=2)
        return np.array([[total_loss(own[group], self.loss) for group in places] for own in sums])

    def _updated(
        self, state: TuningState, gradients: np.ndarray, racing: np.ndarray
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        """One step of the optimiser for all starts at once; those that do not race stay."""
        all_gradients = np.zeros_like(state.free)
        all_gradients[racing] = gradients
        # Optimisers are other people's code.
        with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            free, slopes = jnp.asarray(state.free), jnp.asarray(all_gradients)
            structure = jax.tree.structure(self._initial(state.free))
            before = jax.tree.unflatten(structure, [jnp.asarray(leaf) for leaf in state.optimiser])
            updates, after = jax.vmap(self.optimiser.update)(slopes, before, free)
            moved = np.asarray(optax.apply_updates(free, updates))
        still = np.isin(np.arange(len(moved)), racing)
        return np.where(still[:, None], moved, state.free), _leaves(after)

    def _initial(self, free: np.ndarray) -> Any:
        with jax.enable_x64(True):
            return jax.vmap(self.optimiser.init)(jnp.asarray(free))

    def _values(self, free: np.ndarray) -> np.ndarray:
        return np.array([list(settings_of(self.names, own).values()) for own in free])


def _leaves(tree: Any) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(leaf) for leaf in jax.tree.leaves(tree))


def _least(losses: np.ndarray) -> tuple[int, int]:
    """Step and start of the least loss."""
    step, start = np.unravel_index(np.argmin(np.where(np.isfinite(losses), losses, np.inf)), losses.shape)
    return int(step), int(start)


def _described(state: TuningState, names: tuple[str, ...], loss: Loss) -> str:
    step, start = _least(state.losses[..., ALL])
    values = ", ".join(f"{name} {value:.3g}" for name, value in zip(names, state.values[step, start], strict=True))
    losses = f"{state.losses[step, start, ALL]:.4g} (was {state.baseline[ALL]:.4g})"
    return f"Step {state.steps + 1}: {loss} {losses} at {values}"


def _result(
    state: TuningState,
    names: tuple[str, ...],
    loss: Loss,
    config: DetectionConfig,
    stopped: Stop,
    pairs: tuple[tuple[str, ...], tuple[str, ...]],
) -> TuningResult:
    step, start = _least(state.losses[..., ALL])
    best, baseline = state.losses[step, start], state.baseline
    tuned = {name: float(value) for name, value in zip(names, state.values[step, start], strict=True)}
    least_gain = LEAST_NATS if loss == "likelihood" else LEAST_GAIN * baseline[ALL]
    # Not `<`: any loss is better than none, where the config as it was given has none.
    improved = bool(not best[ALL] >= baseline[ALL] - least_gain)
    # A few pairs more or less: those held back may lose a little, but not what all together gain.
    improved = improved and bool(not best[HELD_BACK] - baseline[HELD_BACK] > baseline[ALL] - best[ALL])
    return TuningResult(
        config=DetectionConfig.from_dict({**config.to_dict(), **tuned}) if improved else config,
        improved=improved,
        loss=loss,
        parameters=names,
        tuned=tuned,
        baseline=tuple(baseline.tolist()),
        best=tuple(best.tolist()),
        best_step=step,
        best_start=start,
        stopped=stopped,
        training=pairs[0],
        validation=pairs[1],
        state=state,
    )
