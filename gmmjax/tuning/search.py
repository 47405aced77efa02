"""The search for the best settings: starts that race, gradients through the fits, steps of the optimiser."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Bool, Float

from gmmjax.errors import InputError
from gmmjax.mixtures import map_on_cores
from gmmjax.tuning.pair_loss import Loss, PairLoss, pair_loss, pair_loss_alone, total_gradient, total_loss
from gmmjax.tuning.parameters import free_of, free_values, settings_of
from gmmjax.tuning.scan_pairs import ReadyPair
from gmmjax.tuning.settings import TuningSettings
from gmmjax.tuning.split_pairs import SplitPairs

# The losses of a step: of all pairs, of those that are trained on, of those that are held back.
ALL, TRAINED, HELD_BACK = 0, 1, 2
# Steps after which only the best start goes on.
RACE = 8
# Random starts of each pair's fits. Of volumes the best counts, by its message length, as in `detect_changes`, whatever
# the others ended in; of surfaces all count the same, and fewer do.
FITS_OF_VOLUMES, FITS_OF_SURFACES = 4, 2
# A loss that differs by less than this share (the likelihood: by this many nats a point) is as good: it differs by
# more from one handful of scenes to another.
ALIKE, ALIKE_NATS = 0.15, 0.02
# Where the middle of the settings that are as good is looked for: up to a factor of 8 to either side.
REACH = np.log(2.0) * np.arange(1, 4)


class TuningState(NamedTuple):
    """State of a tuning after some steps; arrays alone, so that it can be stored and resumed.

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
        """Number of steps taken."""
        return len(self.losses) - 1


class Search:
    """The losses and the optimiser of one tuning."""

    def __init__(
        self,
        pairs: SplitPairs,
        names: tuple[str, ...],
        loss: Loss,
        settings: TuningSettings,
        optimiser: optax.GradientTransformation,
    ) -> None:
        self.pairs, self.names, self.loss, self.settings, self.optimiser = pairs, names, loss, settings, optimiser
        self.key = jax.random.key(settings.seed)

    def first_state(self) -> TuningState:
        """The starts with their losses.

        Raises:
            InputError: a loss that is not finite.
        """
        starts = self.settings.starts
        own = np.array([free_values(self.names, pair.prior, float(pair.frame.spread)) for pair in self.pairs.training])
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

    def centred(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The middle of the settings about the best ones that are as good, one setting after the other; and its losses.

        The loss of a handful of scenes is often flat up to an edge behind which some scene fails; where that edge lies
        differs from scene to scene, and the least loss may lie beside it.

        Args:
            values: of the settings with the least loss.
        """
        free = free_of(self.names, values)
        losses = self._judged(free[None], self.names)[0]
        highest = losses[ALL] + alike(losses[ALL], self.loss)
        for axis in np.eye(len(free)):
            sides = [free + sign * step * axis for sign in (-1, 1) for step in REACH]
            good = (self._judged(np.array(sides), self.names)[:, ALL] <= highest).reshape(2, -1)
            # How far it goes on being as good, below and above.
            below, above = (REACH[own - 1] if own else 0.0 for own in np.cumprod(good, axis=1).sum(axis=1))
            middle = free + (above - below) / 2 * axis
            of_middle = self._judged(middle[None], self.names)[0]
            if of_middle[ALL] <= highest:
                free, losses = middle, of_middle
        return np.array(list(settings_of(self.names, free).values())), losses

    def _gradients(self, free: np.ndarray, step: int) -> np.ndarray:
        """The gradient of each start's loss on the pairs of a step; NaN where none of them has one."""
        generator = np.random.default_rng([self.settings.seed, step])
        count = min(self.settings.pairs_per_step, len(self.pairs.training))
        chosen = [self.pairs.training[n] for n in generator.choice(len(self.pairs.training), count, replace=False)]
        sums, gradients = self._parts(pair_loss, free, self.names, chosen, jax.random.fold_in(self.key, step))
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
        groups = (self.pairs.training, self.pairs.held_back)
        pairs = list({id(pair): pair for group in groups for pair in group}.values())
        places = [[pairs.index(pair) for pair in group] for group in (pairs, *groups)]
        sums, _ = self._parts(pair_loss_alone, free, names, pairs, self.key)
        return np.array([[total_loss(own[group], self.loss) for group in places] for own in sums])

    def _parts(
        self,
        function: Callable[..., PairLoss],
        free: np.ndarray,
        names: tuple[str, ...],
        pairs: Sequence[ReadyPair],
        key: Any,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sums and gradients of every start and pair, over the random starts of their fits; no gradients are zeros."""
        tasks, counts = [], []
        for own in free:
            for pair in pairs:
                fits = FITS_OF_VOLUMES if pair.volumetric else FITS_OF_SURFACES
                tasks += [(own, pair, fit) for fit in jax.random.split(key, fits)]
                counts.append(fits)
        results = map_on_cores(lambda own, pair, fit: function(own, pair, fit, names, self.loss), tasks, "float64")
        sums, gradients = [], []
        for pair, last, count in zip(list(pairs) * len(free), np.cumsum(counts), counts, strict=True):
            own = slice(last - count, last)
            if pair.volumetric:
                best = last - count + int(np.argmin(results.message_length[own]))
                own = slice(best, best + 1)
            sums.append(results.sums[own].mean(axis=0))
            gradients.append(np.zeros(0) if results.gradients is None else results.gradients[own].mean(axis=0))
        shape = (len(free), len(pairs))
        return np.reshape(sums, (*shape, 2)), np.reshape(gradients, (*shape, *gradients[0].shape))

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


def alike(loss: float, kind: Loss) -> float:
    """By how much a loss may differ from this one and be as good."""
    return ALIKE_NATS if kind == "likelihood" else ALIKE * float(loss)


def least(losses: np.ndarray) -> tuple[int, int]:
    """Step and start of the least loss."""
    step, start = np.unravel_index(np.argmin(np.where(np.isfinite(losses), losses, np.inf)), losses.shape)
    return int(step), int(start)


def described(state: TuningState, names: tuple[str, ...], loss: Loss) -> str:
    """Describe the state of a tuning in one line."""
    step, start = least(state.losses[..., ALL])
    values = ", ".join(f"{name} {value:.3g}" for name, value in zip(names, state.values[step, start], strict=True))
    losses = f"{state.losses[step, start, ALL]:.4g} (was {state.baseline[ALL]:.4g})"
    return f"Step {state.steps + 1}: {loss} {losses} at {values}"
