r"""The polish: EM on a frozen set of components until the parameters rest, and derivatives through where they rest.

Annihilation ends when the likelihood hardly gains, about $10^{-3}$ short of the parameters' fixed point. From there the
polish goes on; what it ends in depends smoothly on the prior, the points and their masses, as long as no component
lives or dies.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._typing import Array
from gmmjax.mixtures.covariance_type import CovarianceType
from gmmjax.mixtures.expectation_maximisation import (
    FeatureChunks,
    annihilating_maximisation,
    expectation,
    frozen_maximisation,
)
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior

# The largest change of a parameter at rest, in units of its component: little more than rounding leaves.
REST = {"float64": 1e-10, "float32": 1e-4}
# So near the fixed point EM's steps shrink regularly, and accelerating them pays; further off it leads astray.
NEAR = {"float64": 1e-4, "float32": 1e-3}
# Accelerated steps at the most; a fit of overlapping components takes about a hundred.
MOST_ACCELERATED = 500


class StandardisedMixture(eqx.Module):
    """A mixture relative to a reference: each component in the units of the reference's, so all is of order 1.

    Attributes:
        weights: by the reference's weights.
        means: from the reference's means, in its standard deviations along its axes (its Cholesky factor).
        covariances: in the same axes; the identity for the reference itself.
    """

    weights: Float[Array, " k"]
    means: Float[Array, "k d"]
    covariances: Float[Array, "k d d"]

    @classmethod
    def of(cls, mixture: GaussianMixture, reference: GaussianMixture) -> "StandardisedMixture":
        """The mixture in the units of the reference, which has the same live components."""
        factors = jnp.linalg.cholesky(reference.covariances)
        half = jax.vmap(_divided)(factors, mixture.covariances)
        return cls(
            weights=mixture.weights / jnp.where(reference.live, reference.weights, 1),
            means=jax.vmap(_divided)(factors, (mixture.means - reference.means)[..., None])[..., 0],
            covariances=jax.vmap(_divided)(factors, half.swapaxes(1, 2)),
        )

    def mixture(self, reference: GaussianMixture) -> GaussianMixture:
        """The mixture itself; dead slots have their constants, whatever stands in them here."""
        factors = jnp.linalg.cholesky(reference.covariances)
        return GaussianMixture.masked(
            weights=self.weights * reference.weights,
            means=reference.means + jnp.einsum("kij,kj->ki", factors, self.means),
            covariances=jnp.einsum("kij,kjl,kml->kim", factors, self.covariances, factors),
            live=reference.live,
        )


class Kind(NamedTuple):
    """EM on one kind of model (any pytree), given what the points and the prior are (any pytree).

    Functions that are the same at every call: a new one would be traced again.

    Attributes:
        step: of (model, given), in which a component that is too weak dies.
        frozen_step: of (model, given), in which none dies.
        standardised: of (model, reference), the parameters of a model in units of another one of the same components.
        model: of (parameters, reference, given), the model of such parameters.
        live: which components of a model are live.
    """

    step: Callable[[Any, Any], Any]
    frozen_step: Callable[[Any, Any], Any]
    standardised: Callable[[Any, Any], Any]
    model: Callable[[Any, Any, Any], Any]
    live: Callable[[Any], Bool[Array, " k"]]


class Polished(NamedTuple):
    """Result of `polished`: the model at rest, the steps it took, and whether it rests."""

    model: Any
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def polished(kind: Kind, model: Any, given: Any, *, max_steps: int) -> Polished:
    """The fixed point of EM on the live components of a model; those that lose their support on the way die.

    Plain steps until the parameters hardly change, then accelerated ones (`fixed_point`). Derivatives with respect to
    what is given are implicit; where the parameters do not come to rest they are NaN. With respect to the model to
    start from they are 0.

    Args:
        kind: of the model.
        model: near the fixed point, such as where annihilation ended.
        given: points and prior.
        max_steps: plain steps at the most.
    """
    # Optimistix takes a while to import, and most fits do without.
    from gmmjax.mixtures.fixed_point import fixed_point

    held = jax.lax.stop_gradient(given)
    precision = str(jax.tree.leaves(model)[0].dtype)
    reference, steps = _settled(kind, jax.lax.stop_gradient(model), held, NEAR[precision], max_steps)
    start = kind.standardised(reference, reference)
    end = fixed_point(
        _frozen_map(kind), start, (given, reference), tolerance=REST[precision], max_steps=MOST_ACCELERATED
    )
    return Polished(kind.model(end.parameters, reference, given), steps + end.steps, end.converged)


@functools.cache
def _frozen_map(kind: Kind) -> Callable[[Any, Any], Any]:
    def step(parameters: Any, arguments: Any) -> Any:
        given, reference = arguments
        return kind.standardised(kind.frozen_step(kind.model(parameters, reference, given), given), reference)

    return step


def _settled(kind: Kind, model: Any, given: Any, near: float, max_steps: int) -> tuple[Any, Int[Array, ""]]:
    """Plain steps until no parameter changes by more than `near`, in units of its component; and their number."""

    def further(state: tuple[Any, JaxArray, JaxArray]) -> tuple[Any, JaxArray, JaxArray]:
        model, _, steps = state
        updated = kind.step(model, given)
        return updated, _largest_change(kind, model, updated), steps + 1

    def unsettled(state: tuple[Any, JaxArray, JaxArray]) -> JaxArray:
        return (state[1] > near) & (state[2] < max_steps)

    infinity = jnp.asarray(jnp.inf, jax.tree.leaves(model)[0].dtype)
    settled, _, steps = jax.lax.while_loop(unsettled, further, (model, infinity, jnp.asarray(0, jnp.int32)))
    return settled, steps


def _largest_change(kind: Kind, model: Any, updated: Any) -> Float[Array, ""]:
    """The largest change of a parameter in units of its component; infinite where a component died."""
    before, after = kind.standardised(model, model), kind.standardised(updated, model)
    changes = jax.tree.map(lambda old, new: jnp.max(jnp.abs(new - old)), before, after)
    return jnp.where(jnp.all(kind.live(model) == kind.live(updated)), jax.tree.reduce(jnp.maximum, changes), jnp.inf)


@functools.cache
def gaussian_mixtures(covariance_type: CovarianceType, min_components: int) -> Kind:
    """EM on `GaussianMixture`, given the features of the points, the prior, and the noise component's log density."""

    def step(mixture: GaussianMixture, given: _Given) -> GaussianMixture:
        chunks, prior, log_noise = given
        moments, _ = expectation(mixture, chunks, log_noise)
        return annihilating_maximisation(moments, mixture.live, prior, covariance_type, min_components)

    def frozen_step(mixture: GaussianMixture, given: _Given) -> GaussianMixture:
        chunks, prior, log_noise = given
        moments, _ = expectation(mixture, chunks, log_noise)
        return frozen_maximisation(moments, mixture.live, prior, covariance_type)

    def model(parameters: StandardisedMixture, reference: GaussianMixture, given: _Given) -> GaussianMixture:
        return parameters.mixture(reference)

    return Kind(step, frozen_step, StandardisedMixture.of, model, lambda mixture: mixture.live)


_Given = tuple[FeatureChunks, Prior, JaxArray | None]


def _divided(factor: Float[Array, "d d"], columns: Float[Array, "d n"]) -> Float[Array, "d n"]:
    return jax.scipy.linalg.solve_triangular(factor, columns, lower=True)
