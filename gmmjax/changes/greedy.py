"""Algorithm 1: the Gaussians whose removal brings the mixtures closest together (thesis 2.2.4)."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax._typing import Array
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.transport import TransportStatus, exact_transport
from gmmjax.transport.ground_cost import euclidean

# An improvement counts from this share of the ground cost on: less is rounding, not change.
SMALLEST_GAIN = 1e-9


class Removals(eqx.Module):
    """Which Gaussians of a mixture were removed.

    Attributes:
        removed: the slots that were removed.
        emd: earth mover's distance that is left after the removals, in the unit of the means.
        emd_before: earth mover's distance before the first removal.
        valid: whether every transport problem on the way was solved.
    """

    removed: Bool[Array, " k"]
    emd: Float[Array, ""]
    emd_before: Float[Array, ""]
    valid: Bool[Array, ""]


class _State(NamedTuple):
    removed: JaxArray
    emd: JaxArray
    improved: JaxArray
    valid: JaxArray


def remove_extra(reference: GaussianMixture, mixture: GaussianMixture) -> Removals:
    """Algorithm 1: greedily removes from `mixture` the Gaussian whose removal lowers the EMD to `reference` most.

    It goes on until no removal lowers the distance. The weights that are left are renormalised after each removal, as
    in the thesis; the ground cost is the Euclidean distance of the means (3.1.8). Unlike the thesis's published code,
    every Gaussian is tried and every removal is compared with the latest distance.

    With `reference` before and `mixture` after the removed ones appeared; swapped, they disappeared (4.5.1).

    Args:
        reference: the mixture to compare with, k0 slots.
        mixture: the mixture to remove from, k slots; at least one Gaussian is left in it.
    """
    cost = euclidean(reference.means, mixture.means)
    masses = jnp.asarray(mixture.weights)

    def distance(kept: JaxArray) -> tuple[JaxArray, JaxArray]:
        left = jnp.where(kept, masses, 0)
        result = exact_transport(reference.weights, left / jnp.sum(left), cost)
        return result.cost, result.result == TransportStatus.optimal

    smallest_gain = SMALLEST_GAIN * jnp.max(jnp.where(reference.live[:, None] & mixture.live[None], cost, 0))

    def remove_best(state: _State) -> _State:
        kept = mixture.live & ~state.removed
        removable = kept & (jnp.sum(kept) > 1)
        without = kept[None] & ~jnp.eye(len(kept), dtype=bool)
        # Slots that cannot be removed are tried as they are, so that every lane is a proper problem.
        emds, valid = jax.vmap(distance)(jnp.where(removable[:, None], without, kept[None]))
        emds = jnp.where(removable, emds, jnp.inf)
        best = jnp.argmin(emds)
        improved = emds[best] < state.emd - smallest_gain
        return _State(
            removed=state.removed | (improved & (jnp.arange(len(kept)) == best)),
            emd=jnp.where(improved, emds[best], state.emd),
            improved=improved,
            valid=state.valid & jnp.all(valid),
        )

    emd, valid = distance(jnp.asarray(mixture.live))
    start = _State(jnp.zeros_like(mixture.live), emd, jnp.asarray(True), valid)
    end = jax.lax.while_loop(lambda state: state.improved & state.valid, remove_best, start)
    return Removals(end.removed, end.emd, emd, end.valid)
