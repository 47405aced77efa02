"""The four covariance types of the grid search (thesis 3.1.7): full, diagonal, spherical, tied."""

from typing import Literal, get_args

import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array

CovarianceType = Literal["full", "diagonal", "spherical", "tied"]
COVARIANCE_TYPES: tuple[CovarianceType, ...] = get_args(CovarianceType)


@in_full_precision
def constrained(
    covariances: Float[Array, "k d d"], mass: Float[Array, " k"], covariance_type: CovarianceType
) -> Float[Array, "k d d"]:
    """The maximum likelihood covariances of one type, given the unconstrained ones.

    Args:
        covariances: each component's own covariance about its mean.
        mass: the mass that each component explains; the tied covariance is the mean weighted with it.
        covariance_type: full (as given), diagonal, spherical (one variance a component) or tied (one for all).
    """
    dimension = covariances.shape[-1]
    identity = jnp.eye(dimension, dtype=covariances.dtype)
    match covariance_type:
        case "full":
            return covariances
        case "diagonal":
            return covariances * identity[None]
        case "spherical":
            return jnp.trace(covariances, axis1=1, axis2=2)[:, None, None] / dimension * identity[None]
        case "tied":
            tied = jnp.einsum("k,kij->ij", mass, covariances) / jnp.sum(mass)
            return jnp.broadcast_to(tied, covariances.shape)


def parameters_per_component(dimension: int, covariance_type: CovarianceType = "full") -> int:
    """T of FJ02: the free parameters of one component, mean and covariance without the weight; 9 for full in 3-D.

    A tied covariance belongs to no single component: T counts the mean alone, `shared_parameters` the rest.
    """
    per_covariance = {"full": dimension * (dimension + 1) // 2, "diagonal": dimension, "spherical": 1, "tied": 0}
    return dimension + per_covariance[covariance_type]


def shared_parameters(dimension: int, covariance_type: CovarianceType = "full") -> int:
    """The free parameters that all components share: those of the tied covariance, else none."""
    return dimension * (dimension + 1) // 2 if covariance_type == "tied" else 0
