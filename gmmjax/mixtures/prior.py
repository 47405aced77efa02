"""Prior of a mixture: Dirichlet weights and inverse Wishart covariances."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gmmjax._typing import Array, Scalar
from gmmjax.errors import InputError
from gmmjax.mixtures.covariance_type import CovarianceType, parameters_per_component

NOT_NEGATIVE = ("noise_floor", "scale", "degrees_of_freedom", "mean_strength", "tolerance", "noise_strength")


class Prior(eqx.Module):
    r"""Prior of a Gaussian mixture. Every leaf can be differentiated (`FitSettings.polish`).

    The weights have a Dirichlet prior, each component's mean and covariance a normal-inverse-Wishart one
    (Fraley and Raftery 2007, section 2); covariances are widened by what is known of the sensor. At its defaults all
    but the concentration and the noise floor say nothing.

    Attributes:
        concentration: the Dirichlet concentration $\alpha$ of the mixing weights,
            $p(w) \propto \prod_k w_k^{\alpha-1}$. $1 - T/2$ is Figueiredo and Jain's, equation (2.19), under which weak
            components die; 1 is maximum likelihood.
        noise_floor: standard deviation of the sensor's noise, in the unit of the points; its square is added to every
            covariance, which keeps planes, lines and repeated points from becoming singular.
        scale: standard deviation $s$ that covariances are drawn towards, $s^2 I$, in the unit of the points: the scale
            of the inverse-Wishart prior.
        degrees_of_freedom: how many observations the belief in `scale` is worth, $\nu$: the degrees of freedom of the
            inverse-Wishart prior above those of the flat one.
        mean: position that means are drawn towards, in the unit of the points; one number for all axes, or one an axis.
        mean_strength: how many observations the belief in `mean` is worth, $\kappa$.
        tolerance: the registration tolerance $\tau$, standard deviation an axis in the unit of the points, by which
            covariances are widened as well; for mixtures of two clouds.
        noise_share: the share of observations that are expected to be stray: of no component, uniform over the points'
            bounding box. None: there is no such noise component.
        noise_strength: how many observations the belief in `noise_share` is worth; with a large number the share is
            fixed.
    """

    concentration: Scalar
    noise_floor: Scalar
    scale: Scalar = 0.0
    degrees_of_freedom: Scalar = 0.0
    mean: Scalar | Float[Array, " d"] = 0.0
    mean_strength: Scalar = 0.0
    tolerance: Scalar = 0.0
    noise_share: Scalar | None = None
    noise_strength: Scalar = 0.5

    @classmethod
    def figueiredo_jain(cls, dimension: int, noise_floor: Scalar, covariance_type: CovarianceType = "full") -> "Prior":
        """The prior of FJ02, equation (2.19), on the weights of components with T parameters."""
        return cls(1 - parameters_per_component(dimension, covariance_type) / 2, noise_floor)

    @classmethod
    def maximum_likelihood(cls, noise_floor: Scalar) -> "Prior":
        """No belief about the weights: the maximum likelihood estimate."""
        return cls(1.0, noise_floor)

    def unnormalised_weights(self, mass: Float[Array, " k"]) -> Float[Array, " k"]:
        r"""$\max(0, n_k + \alpha - 1)$, the numerator of (2.20); 0 says that the component's support is too weak."""
        return jnp.maximum(mass + self.concentration - 1, 0)

    def means(self, mass: Float[Array, " k"], means: Float[Array, "k d"]) -> Float[Array, "k d"]:
        r"""The most probable means, $(n_k \bar x_k + \kappa m) / (n_k + \kappa)$, given those of the points."""
        weight = (self.mean_strength / _positive(mass + self.mean_strength))[:, None]
        return means + weight * (self._mean(means) - means)

    def covariances(
        self, mass: Float[Array, " k"], means: Float[Array, "k d"], covariances: Float[Array, "k d d"]
    ) -> Float[Array, "k d d"]:
        r"""The most probable covariances, given the means and covariances of the points, widened.

        $(n_k S_k + n_k \kappa / (n_k + \kappa) (\bar x_k - m)(\bar x_k - m)^T + \nu s^2 I) / (n_k + \nu)$
        """
        offsets = means - self._mean(means)
        offset_mass = mass * self.mean_strength / _positive(mass + self.mean_strength)
        scatter = mass[:, None, None] * covariances
        scatter += offset_mass[:, None, None] * offsets[:, :, None] * offsets[:, None, :]
        scatter += self.degrees_of_freedom * self.scale**2 * _identity(covariances)
        return self.widened(scatter / _positive(mass + self.degrees_of_freedom)[:, None, None])

    def widened(self, covariances: Float[Array, "k d d"]) -> Float[Array, "k d d"]:
        """The covariances with the sensor's noise and the registration tolerance added."""
        return covariances + (self.noise_floor**2 + self.tolerance**2) * _identity(covariances)

    def noise_weight(self, mass: Float[Array, ""], of_components: Float[Array, ""]) -> Float[Array, ""]:
        """The most probable weight of the noise component, from its mass and the unnormalised weights' sum."""
        assert self.noise_share is not None
        expected = self.noise_strength * self.noise_share
        return (mass + expected) / (mass + of_components + self.noise_strength)

    def rescaled(self, scale: Scalar, shift: Float[Array, " d"] | float = 0.0) -> "Prior":
        """Prior for the points `scale * x + shift`."""
        return Prior(
            concentration=self.concentration,
            noise_floor=self.noise_floor * scale,
            scale=self.scale * scale,
            degrees_of_freedom=self.degrees_of_freedom,
            mean=self.mean * scale + shift,
            mean_strength=self.mean_strength,
            tolerance=self.tolerance * scale,
            noise_share=self.noise_share,
            noise_strength=self.noise_strength,
        )

    @property
    def in_domain(self) -> Bool[Array, ""]:
        """True if no strength is negative: `check_prior` for traced priors."""
        shares = () if self.noise_share is None else (self.noise_share, 1 - self.noise_share)
        numbers = (*(getattr(self, name) for name in NOT_NEGATIVE), *shares)
        return jnp.all(jnp.stack([jnp.asarray(number) >= 0 for number in numbers]))

    def _mean(self, means: Float[Array, "k d"]) -> Float[Array, "1 d"]:
        return jnp.broadcast_to(jnp.asarray(self.mean, means.dtype), means.shape[1:])[None]


def check_prior(prior: Prior, dimension: int) -> None:
    """Checks a prior on the host.

    Args:
        prior: with concrete leaves.
        dimension: of the points.

    Raises:
        InputError: a leaf outside of its domain, by name.
    """
    for name in NOT_NEGATIVE:
        value = float(getattr(prior, name))
        if not 0 <= value < float("inf"):
            raise InputError(f"prior.{name}={value:g} must be finite and not negative")
    if not np.isfinite(float(prior.concentration)):
        raise InputError(f"prior.concentration={float(prior.concentration):g} must be finite")
    if prior.noise_share is not None and not 0 <= float(prior.noise_share) < 1:
        raise InputError(f"prior.noise_share={float(prior.noise_share):g} must be at least 0 and below 1")
    if np.shape(prior.mean) not in ((), (dimension,)) or not np.isfinite(np.asarray(prior.mean)).all():
        raise InputError(
            f"prior.mean={np.asarray(prior.mean)} must be one finite number, or one for each of {dimension} axes"
        )


def _positive(mass: Float[Array, " k"]) -> Float[Array, " k"]:
    """The mass as a divisor: 1 where there is none."""
    return jnp.where(mass > 0, mass, 1)


def _identity(covariances: Float[Array, "k d d"]) -> Float[Array, "1 d d"]:
    return jnp.eye(covariances.shape[-1], dtype=covariances.dtype)[None]
