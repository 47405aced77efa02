r"""Gaussians as linear functions of quadratic features: what makes the E-step two matrix products.

In the features $\phi(x) = (1, x_i, x_i x_j)_{i \le j}$ every $\log w_k N(x; \mu_k, \Sigma_k)$ is linear, and the
responsibility-weighted sums of $\phi$ hold every component's mass, mean and covariance.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax.mixtures.mixture import GaussianMixture, whitenings

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


@jax.custom_jvp
@in_full_precision
def density_coefficients(means: Float[Array, "k d"], covariances: Float[Array, "k d d"]) -> Float[Array, "k f"]:
    r"""The rows $\theta_k$ with $\theta_k \cdot \phi(x) = \log N(x; \mu_k, \Sigma_k)$, equation (2.2)."""
    dimension = means.shape[1]
    whitening = whitenings(covariances)
    precisions = jnp.swapaxes(whitening, 1, 2) @ whitening
    log_normalisation = jnp.sum(jnp.log(jnp.diagonal(whitening, axis1=1, axis2=2)), axis=1)
    log_normalisation -= dimension / 2 * jnp.log(2 * jnp.pi)
    constants = log_normalisation.astype(means.dtype) - jnp.sum((whitening @ means[..., None]) ** 2, axis=(1, 2)) / 2
    return _packed(constants, (precisions @ means[..., None])[..., 0], precisions)


@density_coefficients.defjvp
@in_full_precision
def _density_coefficients_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    r"""By $\mathrm{d}\Sigma^{-1} = -\Sigma^{-1} \, \mathrm{d}\Sigma \, \Sigma^{-1}$: small products, no factors."""
    means, covariances = primals
    dimension = means.shape[1]
    moved_means, moved_covariances = tangents
    moved_covariances = (moved_covariances + jnp.swapaxes(moved_covariances, 1, 2)) / 2
    rows = density_coefficients(means, covariances)
    _, linear, quadratic = jnp.split(rows, [1, 1 + dimension], axis=1)
    precisions = _symmetric(-quadratic / _multiplicity(dimension, rows.dtype), dimension)
    moved_precisions = -precisions @ moved_covariances @ precisions
    moved_linear = (moved_precisions @ means[..., None] + precisions @ moved_means[..., None])[..., 0]
    constants = -jnp.sum(precisions * moved_covariances, axis=(1, 2)) / 2
    constants -= jnp.sum(linear * moved_means + means * moved_linear, axis=1) / 2
    return rows, _packed(constants, moved_linear, moved_precisions)


def _packed(
    constants: Float[Array, " k"], linear: Float[Array, "k d"], precisions: Float[Array, "k d d"]
) -> Float[Array, "k f"]:
    """Coefficients of the features 1, x_i and x_i x_j."""
    rows, columns = np.triu_indices(linear.shape[1])
    quadratic = -_multiplicity(linear.shape[1], linear.dtype) * precisions[:, rows, columns]
    return jnp.concatenate([constants[:, None], linear, quadratic], axis=1)


def _multiplicity(dimension: int, dtype: Any) -> Float[Array, "1 t"]:
    """A mixed product x_i x_j stands once among the features and twice in the quadratic form."""
    rows, columns = np.triu_indices(dimension)
    return jnp.where(rows == columns, 0.5, 1.0).astype(dtype)[None]


def _symmetric(upper: Float[Array, "k t"], dimension: int) -> Float[Array, "k d d"]:
    """Symmetric matrices, from their entries on and above the diagonal."""
    rows, columns = np.triu_indices(dimension)
    places = np.zeros((dimension, dimension), int)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return upper[:, places]


def split_feature_sums(
    sums: Float[Array, "k f"], dimension: int
) -> tuple[Float[Array, " k"], Float[Array, "k d"], Float[Array, "k d d"]]:
    """Mass, mean and covariance about that mean, (2.7), (2.9) and (2.10), from weighted sums of the features.

    Where there is no mass, mean and covariance are 0.
    """
    mass = sums[:, 0]
    averages = sums / jnp.where(mass > 0, mass, 1)[:, None]
    means = averages[:, 1 : 1 + dimension]
    second = _symmetric(averages[:, 1 + dimension :], dimension)
    return mass, means, second - means[:, :, None] * means[:, None, :]
