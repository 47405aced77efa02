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
from gmmjax._typing import Array, Scalar
from gmmjax._varying import varying_as
from gmmjax.comparison.choices import Kinds
from gmmjax.comparison.pruned_distance import PrunedDistance
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport import GroundCost, TransportStatus, distance_of_means

# An improvement counts from this share of the ground cost on: less is rounding, not change.
SMALLEST_GAIN = 1e-9


class Removals(eqx.Module):
    """Gaussians removed from the two mixtures.

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

    The distances have derivatives; which Gaussians are removed is a hard decision and has none (`removal_odds` is the
    soft one).

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
    live = jnp.asarray(before.live), jnp.asarray(after.live)
    distance = PrunedDistance.between(before, after, ground_cost)
    kept_before, kept_after, valid = kept_by_removal(distance, *live, kinds)
    whole, left = distance(*live), distance(kept_before, kept_after)
    solved = (whole.result == TransportStatus.optimal) & (left.result == TransportStatus.optimal)
    return Removals(live[0] & ~kept_before, live[1] & ~kept_after, left.cost, whole.cost, valid & solved)


def kept_by_removal(
    distance: PrunedDistance, live_before: Bool[JaxArray, " k0"], live_after: Bool[JaxArray, " k1"], kinds: Kinds
) -> tuple[Bool[JaxArray, " k0"], Bool[JaxArray, " k1"], Bool[JaxArray, ""]]:
    """The components of either mixture that Algorithm 1 keeps, and whether all transport problems were solved.

    Args:
        distance: the earth mover's distance.
        live_before: the slots of the before mixture that hold a component.
        live_after: the same of the after mixture.
        kinds: what is removed.
    """
    remove = functools.partial(_kept, kinds=kinds)
    one_by_one = native.used() and distance.epsilon is None
    # A hard decision: there is nothing to differentiate.
    kept: tuple[JaxArray, JaxArray, JaxArray] = (sequential_vmap(remove) if one_by_one else remove)(
        jax.lax.stop_gradient(distance), live_before, live_after
    )
    return kept


def _kept(
    distance: PrunedDistance, live_before: JaxArray, live_after: JaxArray, kinds: Kinds
) -> tuple[JaxArray, JaxArray, JaxArray]:

    def emd(kept_before: JaxArray, kept_after: JaxArray, start: JaxArray | None) -> tuple[JaxArray, ...]:
        result = distance(kept_before, kept_after, start)
        return result.cost, result.potentials[1], result.result == TransportStatus.optimal

    smallest_gain = SMALLEST_GAIN * jnp.max(jnp.where(live_before[:, None] & live_after[None], distance.cost, 0))

    def remove_best(state: _State) -> _State:
        trials_before, trials_after, removable = _trials(state.kept_before, state.kept_after, kinds, state.improved)
        emds, potentials, valid = jax.vmap(emd, (0, 0, None))(trials_before, trials_after, state.potentials)
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

    whole, potentials, valid = emd(live_before, live_after, None)
    start = _State(live_before, live_after, whole, potentials, jnp.asarray(True), valid)
    start = varying_as(start, distance, live_before, live_after)
    end = jax.lax.while_loop(lambda state: state.improved & state.valid, remove_best, start)
    return end.kept_before, end.kept_after, end.valid


def _trials(
    kept_before: JaxArray, kept_after: JaxArray, kinds: Kinds, wanted: JaxArray | bool = True
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Components kept in the trial of each slot of either mixture, and the mask of the slots that can be removed.

    Where there is nothing to remove the trial is an empty problem, which costs nothing to solve.
    """
    removable = jnp.concatenate(
        [_removable(kept_before, kinds != "appeared"), _removable(kept_after, kinds != "disappeared")]
    )
    removable &= wanted
    kept = removable[:, None] & ~jnp.diag(removable)
    slots = len(kept_before)
    return kept_before[None] & kept[:, :slots], kept_after[None] & kept[:, slots:], removable


def _removable(kept: JaxArray, wanted: bool) -> JaxArray:
    return kept & (jnp.sum(kept) > 1) & wanted


def removal_odds(
    distance: PrunedDistance,
    kept: tuple[Bool[JaxArray, " k0"], Bool[JaxArray, " k1"]],
    live: tuple[Bool[JaxArray, " k0"], Bool[JaxArray, " k1"]],
    kinds: Kinds,
    temperature: Scalar,
) -> tuple[Float[JaxArray, " k0"], Float[JaxArray, " k1"]]:
    r"""Smooth relaxation of Algorithm 1's decision for each component, 0 to 1.

    $\sigma(g_k / T)$, where the gain $g_k$ is by how much the distance is smaller without component k than with it,
    everything else as it was decided. A component without which nothing would be left has 0.

    Args:
        distance: the earth mover's distance.
        kept: the components of either mixture that are kept.
        live: the slots of either mixture that hold a component.
        kinds: what is removed.
        temperature: $T$, in the unit of the distance; as it falls the odds go to 0 and 1.
    """
    trials_before, trials_after, removable = _trials(*kept, kinds)
    removed = jnp.concatenate(live) & ~jnp.concatenate(kept)
    # Without what is kept, or with what was removed.
    own = jnp.eye(len(removed), dtype=bool) & removed[:, None]
    slots = len(kept[0])
    trials_before = jnp.where(removed[:, None], kept[0][None] | own[:, :slots], trials_before)
    trials_after = jnp.where(removed[:, None], kept[1][None] | own[:, slots:], trials_after)
    tried = removable | removed
    # An empty problem has an infinite distance, whose derivatives would be no numbers.
    trials_before = jnp.where(tried[:, None], trials_before, kept[0][None])
    trials_after = jnp.where(tried[:, None], trials_after, kept[1][None])
    others = jax.vmap(distance)(trials_before, trials_after).cost
    emd = distance(*kept).cost
    gains = jnp.where(removed, others - emd, emd - others)
    odds = jnp.where(tried, jax.nn.sigmoid(gains / temperature), 0)
    return odds[:slots], odds[slots:]
