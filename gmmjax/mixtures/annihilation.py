"""EM with annihilation: from many components down, the best message length wins (FJ02; thesis 2.2.2)."""

import dataclasses
from typing import Literal, NamedTuple, TypeVar, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Float, Int

from gmmjax._typing import Array
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures.component_wise import component_wise_sweep
from gmmjax.mixtures.covariance_type import COVARIANCE_TYPES, CovarianceType
from gmmjax.mixtures.criteria import message_length
from gmmjax.mixtures.expectation_maximisation import FeatureChunks, annihilating_maximisation, expectation
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.weighted_points import WeightedPoints

_Tree = TypeVar("_Tree")
Step = Literal["joint", "component-wise"]


STEP_LIMIT = (
    "the log likelihood had not converged after max_steps steps at the number of components that was chosen: "
    "raise max_steps or tolerance"
)
NOT_FINITE = (
    "the likelihood became NaN or infinite, because a covariance was singular: raise the prior's noise_floor, "
    "or fit in float64"
)


class FitStatus(eqx.Enumeration):
    """How a fit ended."""

    converged: "FitStatus" = "the log likelihood converged"  # type: ignore[assignment]
    step_limit: "FitStatus" = STEP_LIMIT  # type: ignore[assignment]
    not_finite: "FitStatus" = NOT_FINITE  # type: ignore[assignment]


@dataclasses.dataclass(frozen=True)
class FitSettings:
    """How a mixture is fitted.

    Attributes:
        min_components: annihilation ends at this number of components; of so many none dies.
        covariance_type: constraint on the covariances.
        step: "joint" updates all components at once (fast); "component-wise" is FJ02's sweep. The component-wise sweep
            knows no tied covariance.
        tolerance: convergence at a gain of log likelihood below this, in nats an observation.
        max_steps: steps at the most for each number of components.
        patience: nats an observation by which the message length may rise above the best one before the fit is ended
            early; infinity goes on down to `min_components`, as FJ02 do.
    """

    min_components: int = 1
    covariance_type: CovarianceType = "full"
    step: Step = "joint"
    tolerance: float = 1e-5
    max_steps: int = 100
    patience: float = float("inf")

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: a setting out of its range, by name.
        """
        check_choice("covariance_type", self.covariance_type, COVARIANCE_TYPES)
        check_choice("step", self.step, get_args(Step))
        if self.step == "component-wise" and self.covariance_type == "tied":
            raise InputError("covariance_type='tied' belongs to no single component; choose step='joint'")
        for name in ("min_components", "max_steps"):
            if getattr(self, name) < 1:
                raise InputError(f"{name}={getattr(self, name)} must be at least 1")
        for name in ("tolerance", "patience"):
            if not getattr(self, name) >= 0:
                raise InputError(f"{name}={getattr(self, name)} must not be negative")


class Fit(eqx.Module):
    """A fitted mixture.

    Attributes:
        mixture: the mixture with the shortest message length.
        message_length: of that mixture, in nats; see `gmmjax.mixtures.message_length`.
        log_likelihood: of the observations under it, in nats.
        steps: EM steps in all.
        result: a `FitStatus`; one per fit, so one per restart.
    """

    mixture: GaussianMixture
    message_length: Float[Array, ""]
    log_likelihood: Float[Array, ""]
    steps: Int[Array, ""]
    result: FitStatus


class _Candidate(NamedTuple):
    """A converged mixture and its scores."""

    mixture: GaussianMixture
    message_length: JaxArray
    log_likelihood: JaxArray
    converged: JaxArray


class _State(NamedTuple):
    mixture: GaussianMixture
    previous: JaxArray  # log likelihood one step ago; minus infinity after an annihilation
    steps: JaxArray  # since the last annihilation at convergence
    steps_in_all: JaxArray
    best: _Candidate
    finished: JaxArray
    finite: JaxArray


def fit_by_annihilation(
    points: WeightedPoints, start: GaussianMixture, prior: Prior, settings: FitSettings = FitSettings()
) -> Fit:
    """Fits one mixture to one cloud, from the components of `start` down (FJ02, figure 2).

    EM runs to convergence; the mixture is scored by its message length; the weakest component is annihilated and EM
    goes on, until `min_components` are left. Within EM the prior annihilates components too weak to pay for themselves.

    A pure function of arrays: `jit`, and `vmap` over points, starts and priors. Failure is a status in the result.

    Args:
        points: the points and their masses, n in d dimensions, in a scale of order 1 about an origin near the points.
        start: the mixture to start from, such as `initial_mixture`.
        prior: `Prior.figueiredo_jain` for the published algorithm.
        settings: frozen and hashable: a static argument under `jit`.
    """
    chunks = FeatureChunks.of(points)
    start = jax.tree.map(jnp.asarray, start)
    state = jax.lax.while_loop(
        lambda state: ~state.finished, lambda state: _step(state, chunks, prior, settings), _initial_state(start)
    )
    best = state.best
    result = FitStatus.where(best.converged, FitStatus.converged, FitStatus.step_limit)
    result = FitStatus.where(state.finite, result, FitStatus.not_finite)
    return Fit(best.mixture, best.message_length, best.log_likelihood, state.steps_in_all, result)


def _initial_state(start: GaussianMixture) -> _State:
    infinity = jnp.asarray(jnp.inf, start.means.dtype)
    zero, no, yes = jnp.asarray(0, jnp.int32), jnp.asarray(False), jnp.asarray(True)
    return _State(start, -infinity, zero, zero, _Candidate(start, infinity, -infinity, no), finished=no, finite=yes)


def _step(state: _State, chunks: FeatureChunks, prior: Prior, settings: FitSettings) -> _State:
    """One E-step; then the M-step or, at convergence, the annihilation of the weakest component."""
    mixture, covariance_type = state.mixture, settings.covariance_type
    observations = jnp.sum(chunks.mass)
    moments, log_likelihood = expectation(mixture, chunks)
    converged = jnp.abs(log_likelihood - state.previous) < settings.tolerance * observations
    at_rest = converged | (state.steps >= settings.max_steps)
    length = message_length(mixture, log_likelihood, observations, covariance_type)
    best = _select(
        at_rest & (length < state.best.message_length),
        _Candidate(mixture, length, log_likelihood, converged),
        state.best,
    )
    if settings.step == "joint":
        updated = annihilating_maximisation(moments, mixture.live, prior, covariance_type, settings.min_components)
    else:
        # Not in vain at rest, where its result is dropped: `cond` skips it outside of `vmap`.
        updated = jax.lax.cond(
            at_rest,
            lambda: mixture,
            lambda: component_wise_sweep(mixture, chunks, prior, covariance_type, settings.min_components),
        )
    updated = _select(at_rest, without_weakest(mixture), updated)
    died = updated.count < mixture.count
    finite = jnp.isfinite(log_likelihood)
    exhausted = at_rest & (mixture.count <= settings.min_components)
    hopeless = at_rest & (length > best.message_length + settings.patience * observations)
    return _State(
        mixture=updated,
        previous=jnp.where(died, -jnp.inf, log_likelihood),
        steps=jnp.where(at_rest, 0, state.steps + 1),
        steps_in_all=state.steps_in_all + 1,
        best=best,
        finished=exhausted | hopeless | ~finite,
        finite=finite,
    )


def without_weakest(mixture: GaussianMixture) -> GaussianMixture:
    """The mixture without its live component of the smallest weight; the others' weights are renormalised."""
    weakest = jnp.argmin(jnp.where(mixture.live, mixture.weights, jnp.inf))
    live = mixture.live & (jnp.arange(len(mixture.live)) != weakest)
    weights = jnp.where(live, mixture.weights, 0)
    total = jnp.sum(weights)
    return GaussianMixture.masked(weights / jnp.where(total > 0, total, 1), mixture.means, mixture.covariances, live)


def _select(condition: JaxArray, chosen: _Tree, other: _Tree) -> _Tree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), chosen, other)
