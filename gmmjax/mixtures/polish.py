r"""The polish: EM on a frozen set of components until the parameters rest, and derivatives through where they rest.

Annihilation ends when the likelihood hardly gains, about $10^{-3}$ short of the parameters' fixed point. From there the
polish goes on; what it ends in depends smoothly on the prior, the points and their masses, as long as no component
lives or dies.
"""

from typing import Any, Generic

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.mixtures.fixed_point import fixed_point
from gmmjax.mixtures.mixture_model import AbstractMixtureModel, Mixture

# The largest change of a parameter at rest, in units of its component: little more than rounding leaves.
REST = {"float64": 1e-10, "float32": 1e-4}
# So near the fixed point EM's steps shrink regularly, and accelerating them pays; further off it leads astray.
NEAR = {"float64": 1e-4, "float32": 1e-3}
# Accelerated steps at the most; a fit of overlapping components takes about a hundred.
MAX_ACCELERATED = 500


class Polished(eqx.Module, Generic[Mixture]):
    """Result of `polished`: the mixture at rest, the steps it took, and whether it rests."""

    mixture: Mixture
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def polished(model: AbstractMixtureModel[Mixture, Any], mixture: Mixture, *, max_steps: int) -> Polished[Mixture]:
    """The fixed point of EM on the live components of a mixture; those that lose their support on the way die.

    Plain steps until the parameters hardly change, then accelerated ones (`fixed_point`). Derivatives with respect to
    the model's leaves, points and prior, are implicit; where the parameters do not come to rest they are NaN. With
    respect to the mixture to start from they are 0.

    Args:
        model: points and prior.
        mixture: near the fixed point, such as where annihilation ended.
        max_steps: plain steps at the most.
    """
    held = jax.lax.stop_gradient(model)
    precision = str(jax.tree.leaves(mixture)[0].dtype)
    reference, steps = _settled(held, jax.lax.stop_gradient(mixture), NEAR[precision], max_steps)
    start = model.standardised(reference, reference)
    end = fixed_point(_frozen_step, start, (model, reference), tolerance=REST[precision], max_steps=MAX_ACCELERATED)
    return Polished(model.from_standardised(end.parameters, reference), steps + end.steps, end.converged)


def _frozen_step(parameters: Any, arguments: tuple[AbstractMixtureModel[Any, Any], Any]) -> Any:
    model, reference = arguments
    mixture = model.from_standardised(parameters, reference)
    sums, _ = model.expectation(mixture)
    return model.standardised(model.frozen_maximisation(mixture, sums), reference)


def _settled(
    model: AbstractMixtureModel[Mixture, Any], mixture: Mixture, near: float, max_steps: int
) -> tuple[Mixture, Int[Array, ""]]:
    """Plain steps until no parameter changes by more than `near`, in units of its component; and their number."""

    def further(state: tuple[Mixture, JaxArray, JaxArray]) -> tuple[Mixture, JaxArray, JaxArray]:
        mixture, _, steps = state
        sums, _ = model.expectation(mixture)
        updated = model.annihilating_maximisation(mixture, sums)
        return updated, _largest_change(model, mixture, updated), steps + 1

    def unsettled(state: tuple[Mixture, JaxArray, JaxArray]) -> JaxArray:
        return (state[1] > near) & (state[2] < max_steps)

    infinity = jnp.asarray(jnp.inf, jax.tree.leaves(mixture)[0].dtype)
    start = varying_as((mixture, infinity, jnp.asarray(0, jnp.int32)), model)
    settled, _, steps = jax.lax.while_loop(unsettled, further, start)
    return settled, steps


def _largest_change(model: AbstractMixtureModel[Mixture, Any], mixture: Mixture, updated: Mixture) -> Float[Array, ""]:
    """The largest change of a parameter in units of its component; infinite where a component died."""
    before, after = model.standardised(mixture, mixture), model.standardised(updated, mixture)
    changes = jax.tree.map(lambda old, new: jnp.max(jnp.abs(new - old)), before, after)
    same = jnp.all(model.gaussians(mixture).live == model.gaussians(updated).live)
    return jnp.where(same, jax.tree.reduce(jnp.maximum, changes), jnp.inf)
