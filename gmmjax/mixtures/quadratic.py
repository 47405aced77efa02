r"""Gaussians as linear functions of quadratic features: what makes the E-step two matrix products.

In the features $\phi(x) = (1, x_i, x_i x_j)_{i \le j}$ every $\log w_k N(x; \mu_k, \Sigma_k)$ is linear, and the
responsibility-weighted sums of $\phi$ hold every component's mass, mean and covariance.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax.mixtures.mixture import GaussianMixture

# Finite, where minus infinity would turn 0 * log weight into NaN in a matrix product.
LOG_OF_DEAD = -1e30


def quadratic_features(points: Float[Array, "n d"]) -> Float[Array, "f n"]:
    """The features 1, x_i and x_i x_j (i <= j) of each point, one feature a row: f = 1 + d + d (d + 1) / 2."""
    rows, columns = np.triu_indices(points.shape[1])
    ones = jnp.ones((len(points), 1), points.dtype)
    return jnp.concatenate([ones, points, points[:, rows] * points[:, columns]], axis=1).T


def coefficients(mixture: GaussianMixture) -> Float[Array, "k f"]:
    r"""Rows $\theta_k$ with $\theta_k \cdot \phi(x) = \log w_k N(x; \mu_k, \Sigma_k)$; `LOG_OF_DEAD` in dead slots."""
    log_weights = jnp.log(jnp.where(mixture.live, mixture.weights, 1))
    rows = density_coefficients(mixture.means, mixture.covariances)
    rows = rows.at[:, 0].add(log_weights)
    dead = jnp.zeros_like(rows).at[:, 0].set(LOG_OF_DEAD)
    return jnp.where(mixture.live[:, None], rows, dead)


def density_coefficients(means: Float[Array, "k d"], covariances: Float[Array, "k d d"]) -> Float[Array, "k f"]:
    r"""The rows $\theta_k$ with $\theta_k \cdot \phi(x) = \log N(x; \mu_k, \Sigma_k)$, equation (2.2)."""
    return jax.vmap(_density_coefficients)(means, covariances)


@in_full_precision
def _density_coefficients(mean: Float[Array, " d"], covariance: Float[Array, "d d"]) -> Float[Array, " f"]:
    dimension = len(mean)
    factor = jnp.linalg.cholesky(covariance)
    whitening = jax.scipy.linalg.solve_triangular(factor, jnp.eye(dimension, dtype=mean.dtype), lower=True)
    precision = whitening.T @ whitening
    log_normalisation = jnp.sum(jnp.log(jnp.diagonal(whitening))) - dimension / 2 * jnp.log(2 * jnp.pi)
    constant = log_normalisation.astype(mean.dtype) - jnp.sum((whitening @ mean) ** 2) / 2
    rows, columns = np.triu_indices(dimension)
    # A mixed product x_i x_j stands once among the features and twice in the quadratic form.
    multiplicity = jnp.where(rows == columns, 0.5, 1.0).astype(mean.dtype)
    return jnp.concatenate([constant[None], precision @ mean, -multiplicity * precision[rows, columns]])


def split_feature_sums(
    sums: Float[Array, "k f"], dimension: int
) -> tuple[Float[Array, " k"], Float[Array, "k d"], Float[Array, "k d d"]]:
    """Mass, mean and covariance about that mean, (2.7), (2.9) and (2.10), from weighted sums of the features.

    Where there is no mass, mean and covariance are 0.
    """
    mass = sums[:, 0]
    averages = sums / jnp.where(mass > 0, mass, 1)[:, None]
    means = averages[:, 1 : 1 + dimension]
    rows, columns = np.triu_indices(dimension)
    upper = jnp.zeros((len(mass), dimension, dimension), sums.dtype)
    second = upper.at[:, rows, columns].set(averages[:, 1 + dimension :])
    second = second.at[:, columns, rows].set(averages[:, 1 + dimension :])
    return mass, means, second - means[:, :, None] * means[:, None, :]
