"""Distances between the components of two mixtures: the ground costs of optimal transport.

A ground cost is a function of two mixtures, for `earth_movers_distance` and the detectors to take; `GROUND_COSTS` has
those that are known by a name.
"""

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._derivatives import without_derivatives
from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax.mixtures import GaussianMixture

SECOND = "bures_wasserstein has no second derivatives; differentiate once, or take the euclidean ground cost"
GroundCost = Callable[[GaussianMixture, GaussianMixture], Float[Array, "k0 k1"]]
"""From two mixtures to the cost [k0, k1] of a unit of mass between each two components; finite in dead slots, too."""


def distance_of_means(before: GaussianMixture, after: GaussianMixture) -> Float[Array, "k0 k1"]:
    """Distances between the means of two mixtures' components: the thesis's ground cost (2.2.3)."""
    return euclidean(jnp.asarray(before.means), jnp.asarray(after.means))


def bures_wasserstein_distance(before: GaussianMixture, after: GaussianMixture) -> Float[Array, "k0 k1"]:
    """Distances between two mixtures' components, shape included; see `bures_wasserstein`."""
    moments = (jnp.asarray(leaf) for own in (before, after) for leaf in (own.means, own.covariances))
    return bures_wasserstein(*moments)


GROUND_COSTS: Mapping[str, GroundCost] = {
    "euclidean": distance_of_means,
    "bures_wasserstein": bures_wasserstein_distance,
}


def euclidean(means_before: Float[Array, "k0 d"], means_after: Float[Array, "k1 d"]) -> Float[Array, "k0 k1"]:
    """Distances between means: the thesis's ground cost (2.2.3).

    Args:
        means_before: means, in any unit.
        means_after: means in the same unit.

    Returns:
        The distances, in that unit. Where two means coincide the derivative is 0, one of the subgradients.
    """
    return _root(_squared_distances(means_before, means_after), 0.0)


@in_full_precision
def bures_wasserstein(
    means_before: Float[Array, "k0 d"],
    covariances_before: Float[Array, "k0 d d"],
    means_after: Float[Array, "k1 d"],
    covariances_after: Float[Array, "k1 d d"],
) -> Float[Array, "k0 k1"]:
    r"""The 2-Wasserstein (Bures-Wasserstein) distances between Gaussians, shape included.

    Their squares are

    $|\mu_0 - \mu_1|^2 + \mathrm{tr}\,\Sigma_0 + \mathrm{tr}\,\Sigma_1
    - 2\,\mathrm{tr}(\Sigma_0^{1/2} \Sigma_1 \Sigma_0^{1/2})^{1/2}
    = |\mu_0 - \mu_1|^2 + \min_U |L_0 - L_1 U|_F^2$

    over orthogonal $U$, with Cholesky factors $L$. The left side subtracts nearly equal traces and loses half of the
    digits between similar Gaussians; the right side is a sum of squares and keeps them. Its derivative holds the best
    $U$ fixed (the envelope theorem), so that neither equal eigenvalues nor thin Gaussians upset it.

    Reference: Bhatia, Jain and Lim, "On the Bures-Wasserstein distance between positive definite matrices",
    Expositiones Mathematicae 37 (2019), theorem 1.

    Args:
        means_before: means, in any unit.
        covariances_before: positive definite covariances, in the square of that unit.
        means_after: means in the same unit.
        covariances_after: covariances in its square.

    Returns:
        The distances, in the unit of the means, 0 for equal Gaussians, where the derivative is 0 too; NaN for
        covariances that are not positive definite. Second derivatives are an error: they would miss how $U$ changes.
    """
    factors_before = jnp.linalg.cholesky(covariances_before)[:, None]
    factors_after = jnp.linalg.cholesky(covariances_after)[None]
    rotations = _best_rotations(factors_before, factors_after)
    shapes = jnp.sum((factors_before - factors_after @ rotations) ** 2, axis=(-2, -1))
    sizes = jnp.sum(factors_before**2, axis=(-2, -1)) + jnp.sum(factors_after**2, axis=(-2, -1))
    rounding = (32 * float(np.finfo(shapes.dtype).eps)) ** 2 * sizes
    return _root(_squared_distances(means_before, means_after) + shapes, rounding)


@jax.custom_jvp
def _best_rotations(factors_before: Float[Array, "... d d"], factors_after: Float[Array, "... d d"]) -> Array:
    """$U$ of `bures_wasserstein`, constant to the first derivative; to ask for second ones is an error."""
    left, _, right = jnp.linalg.svd(jnp.swapaxes(factors_after, -1, -2) @ factors_before)
    return left @ right


@_best_rotations.defjvp
def _constant(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    rotations = without_derivatives(_best_rotations(*primals), primals, SECOND)
    return rotations, jnp.zeros_like(rotations)


def _squared_distances(means_before: Float[Array, "k0 d"], means_after: Float[Array, "k1 d"]) -> Float[Array, "k0 k1"]:
    return jnp.sum((means_before[:, None] - means_after[None]) ** 2, axis=-1)


def _root(squares: Float[Array, "k0 k1"], rounding: Float[Array, "k0 k1"] | float) -> Float[Array, "k0 k1"]:
    """Square roots; 0, with derivative 0, where a square is no more than rounding."""
    # "not <=" lets NaN through, which ">" would turn into a distance of 0.
    positive = ~(squares <= rounding)
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, squares, 1)), 0)
