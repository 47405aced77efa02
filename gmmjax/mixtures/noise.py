"""The noise component: stray points, uniform over the bounding box (Banfield and Raftery 1993)."""

import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._typing import Array
from gmmjax.mixtures.weighted_points import WeightedPoints

# Keep logarithms finite: of a noise component without weight, and of a box without extent.
MIN_WEIGHT, MIN_EXTENT = 1e-30, 1e-6


def log_uniform_density(points: WeightedPoints) -> Float[Array, ""]:
    """Logarithm of one over the volume of the points' bounding box, without padding."""
    coordinates, used = jnp.asarray(points.points), (jnp.asarray(points.mass) > 0)[:, None]
    highest = jnp.max(jnp.where(used, coordinates, -jnp.inf), axis=0)
    lowest = jnp.min(jnp.where(used, coordinates, jnp.inf), axis=0)
    return -jnp.sum(jnp.log(jnp.maximum(highest - lowest, MIN_EXTENT)))


def noise_coefficients(weight: Float[Array, ""], log_density: Float[Array, ""], features: int) -> Float[Array, "1 f"]:
    """The noise component as a row of `coefficients`: its log joint is the same everywhere."""
    log_joint = jnp.log(jnp.maximum(weight, MIN_WEIGHT)) + log_density
    return jnp.zeros((1, features), log_joint.dtype).at[0, 0].set(log_joint)
