"""The Gaussians that partial transport leaves unmatched."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax._host import float64_on_host
from gmmjax._typing import Array, Scalar
from gmmjax.mixtures import LOG_OF_DEAD, GaussianMixture, fixed_point
from gmmjax.transport import GroundCost, TransportStatus, bures_wasserstein_distance, partial_transport

# Of the logarithms of the smooth problem's scalings: the largest change at rest, and sweeps at the most.
REST = {"float64": 1e-12, "float32": 1e-5}
MAX_SWEEPS = 2000


class Unmatched(eqx.Module):
    """Mass of each Gaussian without a counterpart in the other mixture.

    Attributes:
        share_before: share of each Gaussian's mass that disappeared, 0 to 1; 0 in dead slots.
        share_after: share of each Gaussian's mass that appeared.
        density_ratio: points of the after cloud for one point of the before cloud where both saw the same.
        valid: whether the transport problem was solved.
    """

    share_before: Float[Array, " k0"]
    share_after: Float[Array, " k1"]
    density_ratio: Float[Array, ""]
    valid: Bool[Array, ""]


@float64_on_host
def unmatched_shares(
    before: GaussianMixture,
    after: GaussianMixture,
    points_before: Scalar,
    points_after: Scalar,
    penalty: Scalar | None = None,
    ground_cost: GroundCost = bures_wasserstein_distance,
    temperature: Scalar | None = None,
) -> Unmatched:
    """Matches the Gaussians' point counts at the least cost, where leaving a point unmatched costs `penalty`.

    Appearances and disappearances are found together and nothing is renormalised, which is what Algorithm 1 lacks. The
    ground cost is the Bures-Wasserstein distance, so a Gaussian of another shape in the same place is no counterpart.

    Args:
        before: mixture of the before cloud, k0 slots.
        after: mixture of the after cloud, k1 slots.
        points_before: observations in the before cloud.
        points_after: observations in the after cloud.
        penalty: in the unit of the means; mass is matched over at most twice this distance. None: 0.4 of the median
            standard deviation of the Gaussians.
        ground_cost: between the components; by default the Bures-Wasserstein distance.
        temperature: entropy of the plan, in the unit of the means, with which the shares change smoothly and have
            derivatives; None: the optimal plan itself, whose shares have none.

    Returns:
        The shares; of mixtures of NumPy arrays NumPy's, computed in float64.
    """
    # As arrays: a number would be a constant of the program.
    dtype = before.weights.dtype
    price = None if penalty is None else jnp.asarray(penalty, dtype)
    own, other = jnp.asarray(points_before, dtype), jnp.asarray(points_after, dtype)
    entropy = None if temperature is None else jnp.asarray(temperature, dtype)
    unmatched: Unmatched = _unmatched(before, after, own, other, price, entropy, ground_cost)
    return unmatched


@eqx.filter_jit
def _unmatched(
    before: GaussianMixture,
    after: GaussianMixture,
    points_before: Float[Array, ""],
    points_after: Float[Array, ""],
    penalty: Float[Array, ""] | None,
    temperature: Float[Array, ""] | None,
    ground_cost: GroundCost,
) -> Unmatched:
    cost = ground_cost(before, after)
    masses_before = jnp.asarray(before.weights) * points_before
    masses_after = jnp.asarray(after.weights) * points_after
    ratio = matched_density_ratio(masses_before, masses_after, cost)
    if penalty is None:
        penalty = default_penalty(before, after)
    if temperature is not None:
        return _smoothly_unmatched(masses_before * ratio, masses_after, cost, penalty, temperature, ratio)
    result = jax.lax.stop_gradient(partial_transport(masses_before * ratio, masses_after, cost, penalty))
    return Unmatched(
        share_before=_share(result.unmatched[0], masses_before * ratio),
        share_after=_share(result.unmatched[1], masses_after),
        density_ratio=ratio,
        valid=result.result == TransportStatus.optimal,
    )


class _Extended(NamedTuple):
    """The problem in units of the temperature, with a component more on either side for what is left behind."""

    log_supply: JaxArray
    log_demand: JaxArray
    cost: JaxArray


def _smoothly_unmatched(
    supply: JaxArray, demand: JaxArray, cost: JaxArray, penalty: JaxArray, temperature: JaxArray, ratio: JaxArray
) -> Unmatched:
    r"""The shares of the plan $a_i b_j e^{u_i + v_j - C_{ij} / T}$, the cheapest one with the entropy $T$."""
    totals = jnp.sum(supply), jnp.sum(demand)
    # Not by `jnp.pad`, which has no derivative by the padding alone.
    extended = jnp.full((len(cost) + 1, cost.shape[1] + 1), penalty).at[:-1, :-1].set(cost).at[-1, -1].set(0)
    problem = _Extended(
        _log_mass(jnp.append(supply, totals[1])), _log_mass(jnp.append(demand, totals[0])), extended / temperature
    )
    precision = str(extended.dtype)
    start = jnp.zeros_like(problem.log_demand)
    end = fixed_point(_sweep, start, problem, tolerance=REST[precision], max_steps=MAX_SWEEPS)
    of_rows, of_columns = _row_scaling(problem, end.parameters), end.parameters
    share_before = jnp.exp(problem.log_demand[-1] + of_columns[-1] + of_rows - problem.cost[:, -1])[:-1]
    share_after = jnp.exp(problem.log_supply[-1] + of_rows[-1] + of_columns - problem.cost[-1])[:-1]
    valid = end.converged & (temperature > 0) & (totals[0] > 0) & (totals[1] > 0)
    return Unmatched(jnp.where(supply > 0, share_before, 0), jnp.where(demand > 0, share_after, 0), ratio, valid)


def _log_mass(mass: JaxArray) -> JaxArray:
    return jnp.where(mass > 0, jnp.log(jnp.where(mass > 0, mass, 1)), LOG_OF_DEAD)


def _row_scaling(problem: _Extended, of_columns: JaxArray) -> JaxArray:
    return -jax.nn.logsumexp((problem.log_demand + of_columns)[None] - problem.cost, axis=1)


def _sweep(of_columns: JaxArray, problem: _Extended) -> JaxArray:
    """One sweep of Sinkhorn's; of the constant that u and v share, v takes what makes its last number 0."""
    of_rows = _row_scaling(problem, of_columns)
    swept = -jax.nn.logsumexp((problem.log_supply + of_rows)[:, None] - problem.cost, axis=0)
    return swept - swept[-1]


def default_penalty(before: GaussianMixture, after: GaussianMixture) -> Float[Array, ""]:
    """0.4 of the median over all live Gaussians of the root mean square standard deviation along the axes."""
    live = jnp.concatenate([jnp.asarray(before.live), jnp.asarray(after.live)])
    covariances = jnp.concatenate([jnp.asarray(before.covariances), jnp.asarray(after.covariances)])
    deviations = jnp.sqrt(jnp.trace(covariances, axis1=1, axis2=2) / covariances.shape[-1])
    return 0.4 * jnp.nanmedian(jnp.where(live, deviations, jnp.nan))


def matched_density_ratio(
    masses_before: Float[Array, " k0"], masses_after: Float[Array, " k1"], cost: Float[Array, "k0 k1"]
) -> Float[Array, ""]:
    """Weighted median of after to before masses over Gaussians that are each other's nearest; 1 where there are none.

    What changed is the smaller part, so that the median sees the difference in sampling alone.
    """
    pairs = (masses_before[:, None] > 0) & (masses_after[None, :] > 0)
    cost = jnp.where(pairs, cost, jnp.inf)
    mutual = pairs & (cost == cost.min(axis=0, keepdims=True)) & (cost == cost.min(axis=1, keepdims=True))
    safe = jnp.where(pairs, masses_after[None, :] / jnp.where(masses_before > 0, masses_before, 1)[:, None], 1)
    weights = jnp.where(mutual, jnp.minimum(masses_before[:, None], masses_after[None, :]), 0)
    return _weighted_median(safe.ravel(), weights.ravel())


def _weighted_median(values: JaxArray, weights: JaxArray) -> JaxArray:
    order = jnp.argsort(values)
    cumulative = jnp.cumsum(weights[order])
    middle = jnp.searchsorted(cumulative, cumulative[-1] / 2)
    return jnp.where(cumulative[-1] > 0, values[order][middle], 1)


def _share(unmatched: JaxArray, masses: JaxArray) -> JaxArray:
    return jnp.where(masses > 0, unmatched / jnp.where(masses > 0, masses, 1), 0)
