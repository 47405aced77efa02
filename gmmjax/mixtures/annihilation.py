"""EM with annihilation: from many components down, the best message length wins (FJ02; thesis 2.2.2)."""

import dataclasses
from typing import Any, Generic, Literal, TypeVar, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._derivatives import nan_derivatives_unless, without_derivatives
from gmmjax._host import check_static
from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures.covariance_type import COVARIANCE_TYPES, CovarianceType, parameters_per_component
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.mixture_model import AbstractMixtureModel, Mixture
from gmmjax.mixtures.polish import polished
from gmmjax.mixtures.prior import Prior

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
INVALID_INPUT = (
    "a point, mass, scatter, start or number of the prior is NaN, infinite or negative where it must not be, or the "
    "mass is too little for a Gaussian: correct the input"
)
NO_POLISH = (
    "a fit has derivatives only with FitSettings(polish=True); where none are wanted, hide its points and prior "
    "from the differentiation by jax.lax.stop_gradient"
)
NOT_FINITE = (
    "the likelihood became NaN or infinite, because a covariance was singular: raise the prior's noise_floor, "
    "or fit in float64"
)


class FitStatus(eqx.Enumeration):
    """Outcome of a fit."""

    converged: "FitStatus" = "the log likelihood converged"  # type: ignore[assignment]
    step_limit: "FitStatus" = STEP_LIMIT  # type: ignore[assignment]
    not_finite: "FitStatus" = NOT_FINITE  # type: ignore[assignment]
    not_at_rest: "FitStatus" = NOT_AT_REST  # type: ignore[assignment]
    invalid_input: "FitStatus" = INVALID_INPUT  # type: ignore[assignment]


def failed(result: FitStatus) -> Bool[Array, "..."]:
    """True for a fit without a usable mixture; one value for each of a batch."""
    return (result == FitStatus.not_finite) | (result == FitStatus.invalid_input)


@dataclasses.dataclass(frozen=True)
class FitSettings:
    """Settings of a fit.

    Attributes:
        min_components: annihilation ends at this number of components.
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
            InputError: a setting out of its range, by name, or one that is traced.
        """
        check_static(**{f"settings.{field.name}": getattr(self, field.name) for field in dataclasses.fields(self)})
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


class Annihilated(eqx.Module, Generic[Mixture]):
    """Result of `annihilate`: the mixture with the shortest message length, its scores, and how the search ended."""

    mixture: Mixture
    message_length: JaxArray
    log_likelihood: JaxArray
    steps: JaxArray
    result: FitStatus


class _Candidate(eqx.Module, Generic[Mixture]):
    """A converged mixture and its scores."""

    mixture: Mixture
    message_length: JaxArray
    log_likelihood: JaxArray
    converged: JaxArray


class _State(eqx.Module, Generic[Mixture]):
    mixture: Mixture
    previous: JaxArray  # log likelihood one step ago; minus infinity after an annihilation
    steps: JaxArray  # since the last annihilation at convergence
    steps_in_all: JaxArray
    best: _Candidate[Mixture]
    finished: JaxArray
    finite: JaxArray


def bits_of(score: JaxArray) -> Int[JaxArray, ""]:
    """Bits of the floating point numbers of a computation, for `Fit.bits`."""
    return jnp.asarray(8 * score.dtype.itemsize, jnp.int32)


def fit_model(model: AbstractMixtureModel[Mixture, Any], start: Mixture, settings: FitSettings) -> Annihilated[Mixture]:
    """EM with annihilation, and the polish where the settings ask for it, for any kind of mixture.

    A pure function of arrays. With `settings.polish` the result has derivatives with respect to the leaves of the
    model; without, to ask for them is an error.

    Args:
        model: points and prior.
        start: the mixture to start from, a pytree of JAX arrays; derivatives with respect to it are 0.
        settings: when EM has converged, when the search ends, and whether to polish.

    Returns:
        The end of the search. Where it failed, its scores are NaN; where it has not converged, so are its derivatives.
    """
    # Which components win is discrete; what differs smoothly with the arguments is where they come to rest.
    held, held_start = jax.lax.stop_gradient((model, start))
    end = annihilate(held, held_start, settings)
    if not settings.polish:
        return without_derivatives(_judged(end, held, held_start), (model, start), NO_POLISH)
    rest = polished(model, end.mixture, max_steps=settings.max_polish_steps)
    _, log_likelihood = model.expectation(rest.mixture)
    length = model.message_length(rest.mixture, log_likelihood, model.observations)
    result = FitStatus.where(rest.converged, FitStatus.converged, FitStatus.not_at_rest)
    lost = (end.result == FitStatus.not_finite) | ~jnp.isfinite(log_likelihood)
    result = FitStatus.where(lost, FitStatus.not_finite, result)
    end = Annihilated(rest.mixture, length, log_likelihood, end.steps + rest.steps, result)
    end = _judged(end, held, held_start)
    return nan_derivatives_unless(end.result == FitStatus.converged, end, (model, start))


def _judged(
    end: Annihilated[Mixture], model: AbstractMixtureModel[Mixture, Any], start: Mixture
) -> Annihilated[Mixture]:
    """The end of a search, invalid where the input was none to fit to; where it failed all numbers are NaN."""
    parameters = parameters_per_component(model.chunks.dimension, model.covariance_type)
    valid = is_usable((model, start), model.chunks.mass, model.prior, parameters)
    result = FitStatus.where(valid, end.result, FitStatus.invalid_input)
    scored = end.mixture, end.message_length, end.log_likelihood
    mixture, length, log_likelihood = jax.tree.map(lambda leaf: _nan_where(failed(result), leaf), scored)
    return Annihilated(mixture, length, log_likelihood, end.steps, result)


def _nan_where(lost: Bool[Array, ""], leaf: JaxArray) -> JaxArray:
    return jnp.where(lost, jnp.nan, leaf) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf


def is_usable(given: Any, mass: Float[Array, "..."], prior: Prior, parameters: int) -> Bool[Array, ""]:
    """True if the points and the prior can be fitted: `checked_points` and `check_prior` for traced arrays.

    Args:
        given: all that the fit is made of.
        mass: of the points.
        prior: of the fit.
        parameters: of a single Gaussian, without its weight.
    """
    usable = prior.in_domain & (jnp.min(mass) >= 0) & (jnp.sum(mass) > parameters)
    for leaf in map(jnp.asarray, jax.tree.leaves(given)):
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            usable &= jnp.all(jnp.isfinite(leaf))
    return usable


def annihilate(
    model: AbstractMixtureModel[Mixture, Any], start: Mixture, settings: FitSettings
) -> Annihilated[Mixture]:
    """EM with annihilation (FJ02, figure 2): from the components of `start` down, the best message length wins.

    EM runs to convergence; the mixture is scored by its message length; the weakest component is annihilated and EM
    goes on, until `min_components` are left. Within EM the prior annihilates components too weak to pay for themselves.
    Arguments as in `fit_model`.
    """
    observations = model.observations
    state = jax.lax.while_loop(
        lambda state: ~state.finished,
        lambda state: _step(state, model, observations, settings),
        varying_as(_initial_state(start, observations), model),
    )
    best = state.best
    result = FitStatus.where(best.converged, FitStatus.converged, FitStatus.step_limit)
    result = FitStatus.where(state.finite, result, FitStatus.not_finite)
    return Annihilated(best.mixture, best.message_length, best.log_likelihood, state.steps_in_all, result)


def _initial_state(start: Mixture, observations: JaxArray) -> _State[Mixture]:
    infinity = jnp.asarray(jnp.inf, observations.dtype)
    zero, no, yes = jnp.asarray(0, jnp.int32), jnp.asarray(False), jnp.asarray(True)
    return _State(start, -infinity, zero, zero, _Candidate(start, infinity, -infinity, no), finished=no, finite=yes)


def _step(
    state: _State[Mixture], model: AbstractMixtureModel[Mixture, Any], observations: JaxArray, settings: FitSettings
) -> _State[Mixture]:
    """One E-step; then the M-step or, at convergence, the annihilation of the weakest component."""
    mixture = state.mixture
    sums, log_likelihood = model.expectation(mixture)
    converged = jnp.abs(log_likelihood - state.previous) < settings.tolerance * observations
    at_rest = converged | (state.steps >= settings.max_steps)
    length = model.message_length(mixture, log_likelihood, observations)
    best = _select(
        at_rest & (length < state.best.message_length),
        _Candidate(mixture, length, log_likelihood, converged),
        state.best,
    )
    updated = model.updated(mixture, sums)
    updated = _select(at_rest, model.without_weakest(mixture), updated)
    count = model.gaussians(mixture).count
    died = model.gaussians(updated).count < count
    finite = jnp.isfinite(log_likelihood)
    exhausted = at_rest & (count <= model.min_components)
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


def _select(condition: JaxArray, chosen: _Tree, other: _Tree) -> _Tree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), chosen, other)
