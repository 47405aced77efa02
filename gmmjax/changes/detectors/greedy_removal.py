"""Algorithm 1: the Gaussians whose removal brings the mixtures closest together (thesis 2.2.4)."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_batching import sequential_vmap
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax import native
from gmmjax._host import float64_on_host
from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.changes.config import Kinds
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport import GroundCost, TransportStatus, distance_of_means, exact_transport

# An improvement counts from this share of the ground cost on: less is rounding, not change.
SMALLEST_GAIN = 1e-9


class Removals(eqx.Module):
    """Which Gaussians of the two mixtures were removed.

    Attributes:
        disappeared: the slots that were removed from the before mixture.
        appeared: the slots that were removed from the after mixture.
        emd: earth mover's distance that is left after the removals, in the unit of the means.
        emd_before: earth mover's distance before the first removal.
        valid: whether every transport problem on the way was solved.
    """

    disappeared: Bool[Array, " k0"]
    appeared: Bool[Array, " k1"]
    emd: Float[Array, ""]
    emd_before: Float[Array, ""]
    valid: Bool[Array, ""]


class _State(NamedTuple):
    kept_before: JaxArray
    kept_after: JaxArray
    emd: JaxArray
    potentials: JaxArray  # of the after mixture
    improved: JaxArray
    valid: JaxArray


@float64_on_host
def remove_changed(
    before: GaussianMixture,
    after: GaussianMixture,
    kinds: Kinds = "both",
    ground_cost: GroundCost = distance_of_means,
) -> Removals:
    """Algorithm 1: greedily removes the Gaussian whose removal lowers the EMD between the mixtures most.

    It goes on until no removal lowers the distance. The weights that are left in a mixture are renormalised after each
    removal, as in the thesis; the ground cost is the Euclidean distance of the means (3.1.8). Unlike the thesis's
    published code, every Gaussian is tried and every removal is compared with the latest distance.

    For appearances Gaussians are removed from `after`; for disappearances the mixtures are swapped (4.5.1). For both
    kinds every step tries all Gaussians of both mixtures and removes the best. Two separate runs, one each way, would
    not see what the other one removed: they report disappearances where something only appeared, and find less where
    both kinds occur together.

    Args:
        before: mixture of the before cloud, k0 slots.
        after: mixture of the after cloud, k1 slots. At least one Gaussian is left in either.
        kinds: "appeared", "disappeared" or "both".
        ground_cost: between the components; the thesis's is the distance of the means.

    Returns:
        The removals; of mixtures of NumPy arrays NumPy's, computed in float64.

    Under `vmap` pair follows pair where a compiled kernel solves the transport: none waits for the one with the most
    removals.
    """
    removals: Removals = _removals(before, after, kinds, ground_cost)
    return removals


@eqx.filter_jit
def _removals(before: GaussianMixture, after: GaussianMixture, kinds: Kinds, ground_cost: GroundCost) -> Removals:
    remove = functools.partial(_removal, kinds=kinds, ground_cost=ground_cost)
    return (sequential_vmap(remove) if native.used() else remove)(before, after)


def _removal(before: GaussianMixture, after: GaussianMixture, kinds: Kinds, ground_cost: GroundCost) -> Removals:
    cost = ground_cost(before, after)
    slots_before = len(before.weights)

    def distance(kept_before: JaxArray, kept_after: JaxArray, start: JaxArray | None) -> tuple[JaxArray, ...]:
        masses = _normalised(before, kept_before), _normalised(after, kept_after)
        result = exact_transport(*masses, cost, start=start)
        return result.cost, result.potentials[1], result.result == TransportStatus.optimal

    smallest_gain = SMALLEST_GAIN * jnp.max(jnp.where(before.live[:, None] & after.live[None], cost, 0))

    def remove_best(state: _State) -> _State:
        removable_before = _removable(state.kept_before, kinds in ("both", "disappeared"))
        removable_after = _removable(state.kept_after, kinds in ("both", "appeared"))
        removable = jnp.concatenate([removable_before, removable_after]) & state.improved
        # One trial a slot of either mixture; where there is nothing to remove, an empty problem, which costs nothing.
        kept = removable[:, None] & ~jnp.diag(removable)
        trials_before = state.kept_before[None] & kept[:, :slots_before]
        trials_after = state.kept_after[None] & kept[:, slots_before:]
        emds, potentials, valid = jax.vmap(distance, (0, 0, None))(trials_before, trials_after, state.potentials)
        emds = jnp.where(removable, emds, jnp.inf)
        best = jnp.argmin(emds)
        improved = emds[best] < state.emd - smallest_gain
        return _State(
            kept_before=jnp.where(improved, trials_before[best], state.kept_before),
            kept_after=jnp.where(improved, trials_after[best], state.kept_after),
            emd=jnp.where(improved, emds[best], state.emd),
            potentials=jnp.where(improved, potentials[best], state.potentials),
            improved=improved,
            valid=state.valid & jnp.all(valid | ~removable),
        )

    live_before, live_after = jnp.asarray(before.live), jnp.asarray(after.live)
    emd, potentials, valid = distance(live_before, live_after, None)
    start = varying_as(_State(live_before, live_after, emd, potentials, jnp.asarray(True), valid), before, after)
    end = jax.lax.while_loop(lambda state: state.improved & state.valid, remove_best, start)
    return Removals(live_before & ~end.kept_before, live_after & ~end.kept_after, end.emd, emd, end.valid)


def _normalised(mixture: GaussianMixture, kept: JaxArray) -> JaxArray:
    weights = jnp.where(kept, mixture.weights, 0)
    total = jnp.sum(weights)
    return weights / jnp.where(total > 0, total, 1)


def _removable(kept: JaxArray, wanted: bool) -> JaxArray:
    return kept & (jnp.sum(kept) > 1) & wanted
