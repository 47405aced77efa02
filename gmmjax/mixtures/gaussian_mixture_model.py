"""The mixture model of one cloud, and its fit by annihilation (FJ02; thesis 2.2.2)."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from gmmjax._typing import Array
from gmmjax.errors import InputError
from gmmjax.mixtures.annihilation import Fit, FitSettings, Step, bits_of, fit_model
from gmmjax.mixtures.component_wise import component_wise_sweep
from gmmjax.mixtures.covariance_type import CovarianceType
from gmmjax.mixtures.expectation_maximisation import FeatureChunks, Moments, noisy_coefficients, noisy_moments
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.mixture_model import AbstractMixtureModel
from gmmjax.mixtures.noise import log_uniform_density
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.standardised_mixture import StandardisedMixture
from gmmjax.mixtures.weighted_points import WeightedPoints


class GaussianMixtureModel(AbstractMixtureModel[GaussianMixture, StandardisedMixture]):
    """The model of one cloud: Gaussians, and a noise component whose weight is what theirs lack to 1.

    Attributes:
        chunks: features and masses of the points.
        prior: belief about weights, covariances and noise.
        log_noise: logarithm of the noise component's density; None: there is no such component.
        covariance_type: constraint on the covariances.
        min_components: of this number of components none dies.
        step: "joint" or "component-wise", as in `FitSettings`; the polish is joint.
    """

    own_parameters: ClassVar[int] = 0
    chunks: FeatureChunks
    prior: Prior
    log_noise: Float[Array, ""] | None
    covariance_type: CovarianceType = eqx.field(static=True)
    min_components: int = eqx.field(static=True)
    step: Step = eqx.field(static=True)

    @classmethod
    def of(cls, points: WeightedPoints, prior: Prior, settings: FitSettings) -> "GaussianMixtureModel":
        """The model of these points; it has a noise component if the prior expects one."""
        return cls(
            chunks=FeatureChunks.of(points),
            prior=prior,
            log_noise=None if prior.noise_share is None else log_uniform_density(points),
            covariance_type=settings.covariance_type,
            min_components=settings.min_components,
            step=settings.step,
        )

    def gaussians(self, mixture: GaussianMixture) -> GaussianMixture:
        """The mixture itself."""
        return mixture

    def coefficients(self, mixture: GaussianMixture) -> Float[Array, "rows f"]:
        """Those of the quadratic features."""
        return noisy_coefficients(mixture, self.log_noise)

    def moments(self, sums: Float[Array, "rows f"]) -> Moments:
        """See `AbstractMixtureModel.moments`."""
        return noisy_moments(sums, self.chunks.dimension, noise=self.log_noise is not None)

    def assembled(
        self, gaussians: GaussianMixture, noise_weight: Float[Array, ""], sums: Float[Array, "rows f"]
    ) -> GaussianMixture:
        """The Gaussians, which are all there is."""
        return gaussians

    def restricted(self, mixture: GaussianMixture, live: Bool[Array, " k"]) -> GaussianMixture:
        """The weights of the others go to these in proportion; the noise component keeps its own."""
        weights = jnp.where(live, mixture.weights, 0)
        total = jnp.sum(weights)
        weights = weights * jnp.sum(mixture.weights) / jnp.where(total > 0, total, 1)
        return GaussianMixture.masked(weights, mixture.means, mixture.covariances, live)

    def standardised(self, mixture: GaussianMixture, reference: GaussianMixture) -> StandardisedMixture:
        """See `StandardisedMixture`."""
        return StandardisedMixture.of(mixture, reference)

    def from_standardised(self, parameters: StandardisedMixture, reference: GaussianMixture) -> GaussianMixture:
        """See `StandardisedMixture.mixture`."""
        return parameters.mixture(reference)

    def updated(self, mixture: GaussianMixture, sums: Float[Array, "rows f"]) -> GaussianMixture:
        """The joint M-step, or the component-wise sweep, which computes its own E-steps."""
        if self.step == "joint":
            return self.annihilating_maximisation(mixture, sums)
        return component_wise_sweep(mixture, self.chunks, self.prior, self.covariance_type, self.min_components)


def fit_by_annihilation(
    points: WeightedPoints, start: GaussianMixture, prior: Prior, settings: FitSettings = FitSettings()
) -> Fit:
    """Fits one mixture to one cloud, from the components of `start` down (FJ02, figure 2).

    EM runs to convergence; the mixture is scored by its message length; the weakest component is annihilated and EM
    goes on, until `min_components` are left. Within EM the prior annihilates components too weak to pay for themselves.

    A pure function of arrays: `jit`, and `vmap` over points, starts and priors. Failure is a status in the result. With
    `settings.polish` it has derivatives, `jax.grad` and `jax.jacfwd`, with respect to points, masses and prior; they
    hold while no component lives or dies, and are NaN where the parameters did not come to rest.

    Args:
        points: the points and their masses, n in d dimensions, in a scale of order 1 about an origin near the points.
        start: the mixture to start from, such as `initial_mixture`.
        prior: `Prior.figueiredo_jain` for the published algorithm.
        settings: frozen and hashable: a static argument under `jit`.

    Raises:
        InputError: a noise component for the component-wise step; differentiated without `settings.polish`.
    """
    if settings.step == "component-wise" and prior.noise_share is not None:
        raise InputError("noise_share is for step='joint'; the published sweep has no noise component")
    model = GaussianMixtureModel.of(points, prior, settings)
    fit = fit_model(model, _with_noise(jax.tree.map(jnp.asarray, start), prior), settings)
    length = fit.message_length
    noise_share = jnp.zeros_like(length) if model.log_noise is None else 1 - jnp.sum(fit.mixture.weights)
    weights = fit.mixture.weights / (1 - noise_share)
    mixture = eqx.tree_at(lambda mixture: mixture.weights, fit.mixture, weights)
    return Fit(mixture, length, fit.log_likelihood, fit.steps, fit.result, bits_of(length), noise_share)


def _with_noise(mixture: GaussianMixture, prior: Prior) -> GaussianMixture:
    """The mixture whose weights leave to the noise component what the prior expects."""
    if prior.noise_share is None:
        return mixture
    return eqx.tree_at(lambda own: own.weights, mixture, mixture.weights * (1 - prior.noise_share))
