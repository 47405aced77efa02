"""Start of a fit: distinct points as means, one spherical covariance."""

import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Float, PRNGKeyArray

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.weighted_points import WeightedPoints


def initial_mixture(points: WeightedPoints, components: int, prior: Prior, key: PRNGKeyArray) -> GaussianMixture:
    """The start of FJ02 on k-means++ seeds: equal weights, and the covariance of (2.16) and (2.17) for all.

    With fewer distinct points than components the slots left over are dead.

    Args:
        points: the points and their masses.
        components: how many slots.
        prior: its noise floor is added to the covariances.
        key: random key of the seeds.
    """
    means, live = distinct_seeds(points, components, key)
    weights = live.astype(means.dtype) / jnp.sum(live, dtype=means.dtype)
    dimension = means.shape[1]
    covariance = spherical_variance(points) * jnp.eye(dimension, dtype=means.dtype)
    covariances = prior.widened(jnp.broadcast_to(covariance[None], (components, dimension, dimension)))
    return GaussianMixture.masked(weights, means, covariances, live)


@in_full_precision
def spherical_variance(points: WeightedPoints) -> Float[Array, ""]:
    r"""$\sigma^2$ of (2.17): a tenth of the mean variance along the axes."""
    coordinates, mass = jnp.asarray(points.points), jnp.asarray(points.mass)
    mean = mass @ coordinates / jnp.sum(mass)
    return mass @ jnp.mean((coordinates - mean[None]) ** 2, axis=1) / jnp.sum(mass) / 10


def distinct_seeds(points: WeightedPoints, count: int, key: PRNGKeyArray) -> tuple[Float[Array, "k d"], JaxArray]:
    """k-means++ seeds (Arthur and Vassilvitskii 2007): each new seed with probability mass * squared distance.

    Returns:
        The seeds [k, d], and which of them are distinct points [k].
    """
    coordinates, mass = jnp.asarray(points.points), jnp.asarray(points.mass)
    uniform = jax.random.uniform(key, (count,), mass.dtype)

    def add_seed(
        index: int | JaxArray, state: tuple[JaxArray, JaxArray, JaxArray]
    ) -> tuple[JaxArray, JaxArray, JaxArray]:
        seeds, distinct, squared_distances = state
        odds = mass * squared_distances
        # By the inverse of the cumulative odds: one number a seed, so that padding does not change the draw.
        cumulative = jnp.cumsum(odds)
        chosen = jnp.searchsorted(cumulative, uniform[index] * cumulative[-1], side="right")
        seed = coordinates[chosen]
        to_seed = jnp.sum((coordinates - seed[None]) ** 2, axis=1)
        nearest = jnp.where(index == 0, to_seed, jnp.minimum(squared_distances, to_seed))
        return seeds.at[index].set(seed), distinct.at[index].set(jnp.any(odds > 0)), nearest

    state = (jnp.zeros((count, coordinates.shape[1]), coordinates.dtype), jnp.zeros(count, bool), jnp.ones_like(mass))
    state = varying_as(state, coordinates, mass, uniform)
    seeds, distinct, _ = jax.lax.fori_loop(0, count, add_seed, state)
    return seeds, distinct
