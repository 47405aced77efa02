"""A mixture in the units of a reference: the parameters of the fixed-point iteration, all of order 1."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax.mixtures.mixture import GaussianMixture, whitenings


class StandardisedMixture(eqx.Module):
    """A mixture relative to a reference: each component in the units of the reference's, so all is of order 1.

    Attributes:
        weights: by the reference's weights.
        means: from the reference's means, in its standard deviations along its axes (its Cholesky factor).
        covariances: in the same axes; the identity for the reference itself.
    """

    weights: Float[Array, " k"]
    means: Float[Array, "k d"]
    covariances: Float[Array, "k d d"]

    @classmethod
    @in_full_precision
    def of(cls, mixture: GaussianMixture, reference: GaussianMixture) -> "StandardisedMixture":
        """The mixture in the units of the reference, which has the same live components."""
        whitening = whitenings(reference.covariances)
        return cls(
            weights=mixture.weights / jnp.where(reference.live, reference.weights, 1),
            means=jnp.einsum("kij,kj->ki", whitening, mixture.means - reference.means),
            covariances=jnp.einsum("kij,kjl,kml->kim", whitening, mixture.covariances, whitening),
        )

    @in_full_precision
    def mixture(self, reference: GaussianMixture) -> GaussianMixture:
        """The mixture itself; dead slots have their constants, whatever stands in them here."""
        factors = jnp.linalg.cholesky(reference.covariances)
        return GaussianMixture.masked(
            weights=self.weights * reference.weights,
            means=reference.means + jnp.einsum("kij,kj->ki", factors, self.means),
            covariances=jnp.einsum("kij,kjl,kml->kim", factors, self.covariances, factors),
            live=reference.live,
        )
