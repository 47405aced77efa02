"""What is believed of a mixture before the points are seen."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._typing import Array, Scalar
from gmmjax.mixtures.covariance_type import CovarianceType, parameters_per_component


class Prior(eqx.Module):
    r"""Prior of a Gaussian mixture. Every leaf can be differentiated.

    Attributes:
        concentration: the Dirichlet concentration $\alpha$ of the mixing weights,
            $p(w) \propto \prod_k w_k^{\alpha-1}$. $1 - T/2$ is Figueiredo and Jain's, equation (2.19), under which weak
            components die; 1 is maximum likelihood.
        noise_floor: standard deviation of the sensor's noise, in the unit of the points; its square is added to every
            covariance, which keeps planes, lines and repeated points from becoming singular.
    """

    concentration: Scalar
    noise_floor: Scalar

    @classmethod
    def figueiredo_jain(cls, dimension: int, noise_floor: float, covariance_type: CovarianceType = "full") -> "Prior":
        """The prior of FJ02, equation (2.19), on the weights of components with T parameters."""
        return cls(1 - parameters_per_component(dimension, covariance_type) / 2, noise_floor)

    @classmethod
    def maximum_likelihood(cls, noise_floor: float) -> "Prior":
        """No belief about the weights: the maximum likelihood estimate."""
        return cls(1.0, noise_floor)

    def unnormalised_weights(self, mass: Float[Array, " k"]) -> Float[Array, " k"]:
        r"""$\max(0, n_k + \alpha - 1)$, the numerator of (2.20); 0 says that the component's support is too weak."""
        return jnp.maximum(mass + self.concentration - 1, 0)

    def covariances(self, covariances: Float[Array, "k d d"]) -> Float[Array, "k d d"]:
        """The estimated covariances with the sensor's noise added."""
        return covariances + self.noise_floor**2 * jnp.eye(covariances.shape[-1], dtype=covariances.dtype)[None]

    def rescaled(self, scale: Scalar) -> "Prior":
        """The same belief for points multiplied by `scale`."""
        return Prior(self.concentration, self.noise_floor * scale)
