"""EM with annihilation: from many components down, the best message length wins (FJ02; thesis 2.2.2)."""

import dataclasses
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeVar, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._typing import Array
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures.component_wise import component_wise_sweep
from gmmjax.mixtures.covariance_type import COVARIANCE_TYPES, CovarianceType
from gmmjax.mixtures.criteria import message_length
from gmmjax.mixtures.expectation_maximisation import (
    FeatureChunks,
    Moments,
    annihilating_maximisation,
    expectation,
)
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.noise import log_uniform_density
from gmmjax.mixtures.polish import Polished, gaussian_mixtures, polished
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.weighted_points import WeightedPoints

_Tree = TypeVar("_Tree")
Step = Literal["joint", "component-wise"]


STEP_LIMIT = (
    "the log likelihood had not converged after max_steps steps at the number of components that was chosen: "
    "raise max_steps or tolerance"
)
NOT_AT_REST = (
    "the parameters had not come to rest after max_polish_steps steps, so they have no derivatives: raise "
    "max_polish_steps, or fit in float64"
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
    not_at_rest: "FitStatus" = NOT_AT_REST  # type: ignore[assignment]


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
        polish: go on with the components that won until the parameters rest, not only the likelihood. What comes out
            has derivatives with respect to the prior, the points and their masses, for `jax.grad` and the like; without
            it there are none.
        max_polish_steps: plain steps of the polish at the most, until the parameters hardly change; up to 500
            accelerated ones follow.
    """

    min_components: int = 1
    covariance_type: CovarianceType = "full"
    step: Step = "joint"
    tolerance: float = 1e-5
    max_steps: int = 100
    patience: float = float("inf")
    polish: bool = False
    max_polish_steps: int = 5000

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: a setting out of its range, by name.
        """
        check_choice("covariance_type", self.covariance_type, COVARIANCE_TYPES)
        check_choice("step", self.step, get_args(Step))
        if self.step == "component-wise" and self.covariance_type == "tied":
            raise InputError("covariance_type='tied' belongs to no single component; choose step='joint'")
        for name in ("min_components", "max_steps", "max_polish_steps"):
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
        bits: 64 or 32, of the floating point numbers that it was computed in.
        noise_share: the share of the observations that are of no component; 0 without a noise component.
    """

    mixture: GaussianMixture
    message_length: Float[Array, ""]
    log_likelihood: Float[Array, ""]
    steps: Int[Array, ""]
    result: FitStatus
    bits: Int[Array, ""]
    noise_share: Float[Array, ""]


class Algorithm(NamedTuple):
    """EM for one kind of model, as functions of the model (any pytree); the points are bound in them.

    Attributes:
        expectation: what the points give to the components, any pytree, and the log likelihood.
        message_length: of the model with its log likelihood.
        update: the next model from the model, what the points give, and whether the model is at rest, where the
            update is not used; at most the weakest component dies.
        without_weakest: the model without its weakest component.
        live_count: how many components are live.
        observations: the total mass of the points.
    """

    expectation: Callable[[Any], tuple[Any, JaxArray]]
    message_length: Callable[[Any, JaxArray], JaxArray]
    update: Callable[[Any, Any, JaxArray], Any]
    without_weakest: Callable[[Any], Any]
    live_count: Callable[[Any], JaxArray]
    observations: JaxArray


class Annihilated(NamedTuple):
    """Result of `annihilate`: the model with the shortest message length, its scores, and how the search ended."""

    model: Any
    message_length: JaxArray
    log_likelihood: JaxArray
    steps: JaxArray
    result: FitStatus


class _Candidate(NamedTuple):
    """A converged model and its scores."""

    model: Any
    message_length: JaxArray
    log_likelihood: JaxArray
    converged: JaxArray


class _State(NamedTuple):
    model: Any
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

    A pure function of arrays: `jit`, and `vmap` over points, starts and priors. Failure is a status in the result. With
    `settings.polish` it has derivatives, `jax.grad` and `jax.jacfwd`, with respect to points, masses and prior; they
    hold while no component lives or dies, and are NaN where the parameters did not come to rest.

    Args:
        points: the points and their masses, n in d dimensions, in a scale of order 1 about an origin near the points.
        start: the mixture to start from, such as `initial_mixture`.
        prior: `Prior.figueiredo_jain` for the published algorithm.
        settings: frozen and hashable: a static argument under `jit`.

    Raises:
        InputError: a noise component for the component-wise step; differentiated without `settings.polish`.
    """
    if settings.step == "component-wise" and prior.noise_share is not None:
        raise InputError("noise_share is for step='joint'; the published sweep has no noise component")
    log_noise = None if prior.noise_share is None else log_uniform_density(points)
    given = FeatureChunks.of(points), prior, log_noise
    start = _with_noise(jax.tree.map(jnp.asarray, start), prior)
    # Which components win is discrete; what differs smoothly with the arguments is where they come to rest.
    held, start = jax.lax.stop_gradient((given, start))
    end = annihilate(start, _gaussian_mixture_algorithm(*held, settings), settings)
    fit = _polished(end, *given, settings) if settings.polish else without_derivatives(end, given)
    noise_share = 1 - jnp.sum(fit.model.weights) if log_noise is not None else jnp.zeros_like(fit.message_length)
    mixture = eqx.tree_at(lambda mixture: mixture.weights, fit.model, fit.model.weights / (1 - noise_share))
    bits = bits_of(fit.message_length)
    return Fit(mixture, fit.message_length, fit.log_likelihood, fit.steps, fit.result, bits, noise_share)


def bits_of(score: JaxArray) -> Int[JaxArray, ""]:
    """Bits of the floating point numbers of a computation, for `Fit.bits`."""
    return jnp.asarray(8 * score.dtype.itemsize, jnp.int32)


def _with_noise(mixture: GaussianMixture, prior: Prior) -> GaussianMixture:
    """The mixture whose weights leave to the noise component what the prior expects."""
    if prior.noise_share is None:
        return mixture
    return eqx.tree_at(lambda own: own.weights, mixture, mixture.weights * (1 - prior.noise_share))


def _polished(
    end: "Annihilated", chunks: FeatureChunks, prior: Prior, log_noise: JaxArray | None, settings: FitSettings
) -> "Annihilated":
    """The components that won, polished, with the scores of where they rest."""
    covariance_type = settings.covariance_type
    kind = gaussian_mixtures(covariance_type, settings.min_components)
    rest = polished(kind, end.model, (chunks, prior, log_noise), max_steps=settings.max_polish_steps)
    _, log_likelihood = expectation(rest.model, chunks, log_noise)
    length = message_length(rest.model, log_likelihood, jnp.sum(chunks.mass), covariance_type)
    return at_rest(end, rest, length, log_likelihood)


def at_rest(end: "Annihilated", rest: Polished, length: JaxArray, log_likelihood: JaxArray) -> "Annihilated":
    """The result of annihilation with the model at rest in place of the one where it ended."""
    result = FitStatus.where(rest.converged, FitStatus.converged, FitStatus.not_at_rest)
    result = FitStatus.where(end.result == FitStatus.not_finite, FitStatus.not_finite, result)
    return Annihilated(rest.model, length, log_likelihood, end.steps + rest.steps, result)


def _gaussian_mixture_algorithm(
    chunks: FeatureChunks, prior: Prior, log_noise: JaxArray | None, settings: FitSettings
) -> Algorithm:
    observations = jnp.sum(chunks.mass)
    covariance_type, least = settings.covariance_type, settings.min_components

    def update(mixture: GaussianMixture, moments: Moments, at_rest: JaxArray) -> GaussianMixture:
        if settings.step == "joint":
            return annihilating_maximisation(moments, mixture.live, prior, covariance_type, least)
        # Not in vain at rest, where its result is dropped: `cond` skips it outside of `vmap`.
        return jax.lax.cond(
            at_rest, lambda: mixture, lambda: component_wise_sweep(mixture, chunks, prior, covariance_type, least)
        )

    return Algorithm(
        expectation=lambda mixture: expectation(mixture, chunks, log_noise),
        message_length=lambda mixture, likelihood: message_length(mixture, likelihood, observations, covariance_type),
        update=update,
        without_weakest=without_weakest,
        live_count=lambda mixture: mixture.count,
        observations=observations,
    )


def annihilate(start: Any, algorithm: Algorithm, settings: FitSettings) -> Annihilated:
    """EM with annihilation (FJ02, figure 2) for any model; see `fit_by_annihilation`.

    Args:
        start: the model to start from, a pytree of JAX arrays.
        algorithm: the steps of EM for this model.
        settings: when EM has converged, and when the search ends.
    """
    state = jax.lax.while_loop(
        lambda state: ~state.finished, lambda state: _step(state, algorithm, settings), _initial_state(start, algorithm)
    )
    best = state.best
    result = FitStatus.where(best.converged, FitStatus.converged, FitStatus.step_limit)
    result = FitStatus.where(state.finite, result, FitStatus.not_finite)
    return Annihilated(best.model, best.message_length, best.log_likelihood, state.steps_in_all, result)


def _initial_state(start: Any, algorithm: Algorithm) -> _State:
    infinity = jnp.asarray(jnp.inf, algorithm.observations.dtype)
    zero, no, yes = jnp.asarray(0, jnp.int32), jnp.asarray(False), jnp.asarray(True)
    return _State(start, -infinity, zero, zero, _Candidate(start, infinity, -infinity, no), finished=no, finite=yes)


def _step(state: _State, algorithm: Algorithm, settings: FitSettings) -> _State:
    """One E-step; then the M-step or, at convergence, the annihilation of the weakest component."""
    model, observations = state.model, algorithm.observations
    given, log_likelihood = algorithm.expectation(model)
    converged = jnp.abs(log_likelihood - state.previous) < settings.tolerance * observations
    at_rest = converged | (state.steps >= settings.max_steps)
    length = algorithm.message_length(model, log_likelihood)
    best = _select(
        at_rest & (length < state.best.message_length),
        _Candidate(model, length, log_likelihood, converged),
        state.best,
    )
    updated = algorithm.update(model, given, at_rest)
    updated = _select(at_rest, algorithm.without_weakest(model), updated)
    died = algorithm.live_count(updated) < algorithm.live_count(model)
    finite = jnp.isfinite(log_likelihood)
    exhausted = at_rest & (algorithm.live_count(model) <= settings.min_components)
    hopeless = at_rest & (length > best.message_length + settings.patience * observations)
    return _State(
        model=updated,
        previous=jnp.where(died, -jnp.inf, log_likelihood),
        steps=jnp.where(at_rest, 0, state.steps + 1),
        steps_in_all=state.steps_in_all + 1,
        best=best,
        finished=exhausted | hopeless | ~finite,
        finite=finite,
    )


def without_weakest(mixture: GaussianMixture) -> GaussianMixture:
    """The mixture without its live component of the smallest weight, which goes to the others in proportion."""
    live = mixture.live & ~weakest(mixture.weights, mixture.live)
    weights = jnp.where(live, mixture.weights, 0)
    total = jnp.sum(weights)
    weights = weights * jnp.sum(mixture.weights) / jnp.where(total > 0, total, 1)
    return GaussianMixture.masked(weights, mixture.means, mixture.covariances, live)


def weakest(weights: Float[Array, " k"], live: Bool[Array, " k"]) -> Bool[Array, " k"]:
    """True at the live component of the smallest weight."""
    return jnp.arange(len(weights)) == jnp.argmin(jnp.where(live, weights, jnp.inf))


@eqx.filter_custom_jvp
def without_derivatives(result: _Tree, arguments: Any) -> _Tree:
    """The result, which was computed from arguments in a way that has no derivatives; to ask for them is an error."""
    del arguments
    return result


@without_derivatives.def_jvp
def _no_derivatives(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    raise InputError(
        "a fit has derivatives only with FitSettings(polish=True); where none are wanted, hide its points and prior "
        "from the differentiation by jax.lax.stop_gradient"
    )


def _select(condition: JaxArray, chosen: _Tree, other: _Tree) -> _Tree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), chosen, other)
