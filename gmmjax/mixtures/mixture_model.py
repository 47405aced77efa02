"""The abstract mixture model: what EM with annihilation, and the polish, ask of every kind of mixture."""

import abc
from typing import Generic, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Bool, Float

from gmmjax._typing import Array, Scalar
from gmmjax.mixtures.covariance_type import CovarianceType
from gmmjax.mixtures.criteria import message_length
from gmmjax.mixtures.expectation_maximisation import (
    FeatureChunks,
    Moments,
    feature_sums,
    m_step,
    survivors,
    waiting_weights,
    weakest,
)
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior

Mixture = TypeVar("Mixture")
Standardised = TypeVar("Standardised")


class AbstractMixtureModel(eqx.Module, Generic[Mixture, Standardised]):
    r"""Points and prior of one kind of mixture, and the steps of EM on its parameters.

    `Mixture` is the record of the parameters, a pytree that holds a `GaussianMixture`; `Standardised` is the same in
    the units of a reference. The log joint density of a component and a point is linear in the features of the point,
    $\theta_k \cdot \phi(x)$, whatever the kind. So E-step, M-step, annihilation and message length are written here,
    once; a kind says what $\theta$ is (`coefficients`), and what else its components have beside weight, mean and
    covariance (`assembled`).

    The leaves, which are the points and the prior, can be differentiated; everything else is static.

    Attributes:
        chunks: features and masses of the points.
        prior: belief about weights, covariances and noise.
        covariance_type: constraint on the covariances.
        min_components: of this number of components none dies.
        own_parameters: free parameters that a component has beside weight, mean and covariance.
    """

    chunks: eqx.AbstractVar[FeatureChunks]
    prior: eqx.AbstractVar[Prior]
    covariance_type: eqx.AbstractVar[CovarianceType]
    min_components: eqx.AbstractVar[int]
    own_parameters: eqx.AbstractClassVar[int]

    @abc.abstractmethod
    def gaussians(self, mixture: Mixture) -> GaussianMixture:
        """The Gaussians of the mixture; their weights leave to the noise component what they lack to 1."""

    @abc.abstractmethod
    def coefficients(self, mixture: Mixture) -> Float[Array, "rows f"]:
        r"""Rows $\theta_k$, one a slot and one for the noise component where there is one, in the points' features."""

    @abc.abstractmethod
    def moments(self, sums: Float[Array, "rows f"]) -> Moments:
        """Mass, mean and covariance that the points give to each component, from the E-step's sums."""

    @abc.abstractmethod
    def assembled(
        self, gaussians: GaussianMixture, noise_weight: Float[Array, ""], sums: Float[Array, "rows f"]
    ) -> Mixture:
        """The mixture after an M-step.

        Args:
            gaussians: the updated Gaussians.
            noise_weight: the updated weight of the noise component; 0 where there is none.
            sums: of the E-step, for what else the components have.
        """

    @abc.abstractmethod
    def restricted(self, mixture: Mixture, live: Bool[Array, " k"]) -> Mixture:
        """The mixture of these components alone, whose weights grow in proportion."""

    @abc.abstractmethod
    def standardised(self, mixture: Mixture, reference: Mixture) -> Standardised:
        """The parameters in the units of a reference that has the same live components."""

    @abc.abstractmethod
    def from_standardised(self, parameters: Standardised, reference: Mixture) -> Mixture:
        """The mixture that has these parameters in the units of the reference."""

    @abc.abstractmethod
    def updated(self, mixture: Mixture, sums: Float[Array, "rows f"]) -> Mixture:
        """The next mixture of annihilation, in which at the most the weakest component dies.

        Args:
            mixture: the current mixture.
            sums: of the features, by the E-step of this mixture.
        """

    def expectation(self, mixture: Mixture) -> tuple[Float[Array, "rows f"], Float[Array, ""]]:
        """E-step (2.6): responsibility-weighted sums of the features, and the log likelihood (nats)."""
        return feature_sums(self.coefficients(mixture), self.chunks)

    def annihilating_maximisation(self, mixture: Mixture, sums: Float[Array, "rows f"]) -> Mixture:
        """M-step (2.20) for all components at once, in which at the most the weakest dies; others wait."""
        moments = self.moments(sums)
        live = survivors(moments.mass, self.gaussians(mixture).live, self.prior, self.min_components)
        return self._m_step(moments, live, sums)

    def frozen_maximisation(self, mixture: Mixture, sums: Float[Array, "rows f"]) -> Mixture:
        """M-step (2.20) in which no component dies: those that are too weak wait at a small weight."""
        return self._m_step(self.moments(sums), self.gaussians(mixture).live, sums)

    def without_weakest(self, mixture: Mixture) -> Mixture:
        """The mixture without its live component of the smallest weight."""
        gaussians = self.gaussians(mixture)
        return self.restricted(mixture, gaussians.live & ~weakest(gaussians.weights, gaussians.live))

    def message_length(self, mixture: Mixture, log_likelihood: Scalar, observations: Scalar) -> Float[Array, ""]:
        """FJ02's message length, nats; see `gmmjax.mixtures.message_length`."""
        gaussians = self.gaussians(mixture)
        return message_length(gaussians, log_likelihood, observations, self.covariance_type, self.own_parameters)

    def _m_step(self, moments: Moments, live: Bool[Array, " k"], sums: Float[Array, "rows f"]) -> Mixture:
        weights = waiting_weights(moments.mass, live, self.prior)
        gaussians, noise_weight = m_step(moments, weights, self.prior, self.covariance_type)
        return self.assembled(gaussians, noise_weight, sums)

    @property
    def observations(self) -> Float[Array, ""]:
        """The total mass of the points."""
        return jnp.sum(self.chunks.mass)
