"""The mixture model of two clouds, and its fit by EM with annihilation."""

import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array, Scalar
from gmmjax.comparison.joint_mixture import JointMixture
from gmmjax.mixtures import (
    AbstractMixtureModel,
    Annihilated,
    CovarianceType,
    FeatureChunks,
    FitSettings,
    GaussianMixture,
    Moments,
    Prior,
    StandardisedMixture,
    WeightedPoints,
    distinct_seeds,
    fit_model,
    log_uniform_density,
    parameters_per_component,
    split_feature_sums,
)

# Half an observation of either cloud in each component (Jeffreys' prior) keeps the logarithms of the shares finite.
SHARE_PRIOR = 0.5
# The noise component is expected, but hardly believed in: it can shrink to nothing and come back.
NOISE_SHARE, NOISE_STRENGTH = 0.02, 0.5


class LabelledPoints(eqx.Module):
    """The points of both clouds.

    Attributes:
        points: coordinates and masses; mass 0 is padding.
        after: 1 where the point is of the after cloud, 0 where it is of the before cloud.
    """

    points: WeightedPoints
    after: Float[Array, " n"]

    def padded(self) -> "LabelledPoints":
        """Pad the points on the host, as `WeightedPoints.padded` does."""
        padded = self.points.padded()
        return LabelledPoints(padded, np.pad(self.after, (0, len(padded.mass) - len(self.after))))


class StandardisedJointMixture(eqx.Module):
    """A joint mixture relative to a reference, see `StandardisedMixture`; shares and noise weight as they are."""

    mixture: StandardisedMixture
    share_after: Float[Array, " k"]
    noise_weight: Float[Array, ""]


class JointMixtureModel(AbstractMixtureModel[JointMixture, StandardisedJointMixture]):
    """The model of two clouds: every component has its share of "after" as a parameter more.

    Attributes:
        chunks: features and masses of the points, with the source as last feature.
        prior: belief about weights, covariances and noise.
        log_noise: logarithm of the noise component's density, of a point and its source.
        covariance_type: full.
        min_components: of this number of components none dies.
    """

    own_parameters: ClassVar[int] = 1
    chunks: FeatureChunks
    prior: Prior
    log_noise: Float[Array, ""]
    covariance_type: CovarianceType = eqx.field(static=True)
    min_components: int = eqx.field(static=True)

    @classmethod
    def of(cls, points: LabelledPoints, prior: Prior, settings: FitSettings) -> "JointMixtureModel":
        """The model of these points."""
        return cls(
            chunks=joint_chunks(points),
            prior=prior,
            log_noise=_log_noise(points.points),
            covariance_type="full",
            min_components=settings.min_components,
        )

    def gaussians(self, mixture: JointMixture) -> GaussianMixture:
        """Those that both clouds share."""
        return mixture.mixture

    def coefficients(self, mixture: JointMixture) -> Float[Array, "rows f"]:
        """See `JointMixture.coefficients`."""
        return mixture.coefficients()

    def moments(self, sums: Float[Array, "rows f"]) -> Moments:
        """Those of both clouds together."""
        moments = split_feature_sums(sums[:-1, :-1], self.chunks.dimension)
        return Moments(*moments, None if self.prior.noise_share is None else sums[-1, 0])

    def assembled(
        self, gaussians: GaussianMixture, noise_weight: Float[Array, ""], sums: Float[Array, "rows f"]
    ) -> JointMixture:
        """The Gaussians with their shares of "after", the mean of the source."""
        shares = (sums[:-1, -1] + SHARE_PRIOR) / (sums[:-1, 0] + 2 * SHARE_PRIOR)
        return JointMixture(gaussians, jnp.where(gaussians.live, shares, 0.5), noise_weight, self.log_noise)

    def restricted(self, mixture: JointMixture, live: Bool[Array, " k"]) -> JointMixture:
        """The weights of the others go to these and to the noise component in proportion."""
        gaussians = mixture.mixture
        weights = jnp.where(live, gaussians.weights, 0)
        total = jnp.sum(weights) + mixture.noise_weight
        gaussians = GaussianMixture.masked(weights / total, gaussians.means, gaussians.covariances, live)
        shares = jnp.where(live, mixture.share_after, 0.5)
        return JointMixture(gaussians, shares, mixture.noise_weight / total, mixture.log_noise)

    def standardised(self, mixture: JointMixture, reference: JointMixture) -> StandardisedJointMixture:
        """The Gaussians in the units of the reference's."""
        own = StandardisedMixture.of(mixture.mixture, reference.mixture)
        return StandardisedJointMixture(own, mixture.share_after, mixture.noise_weight)

    def from_standardised(self, parameters: StandardisedJointMixture, reference: JointMixture) -> JointMixture:
        """The joint mixture itself; dead slots have their constants."""
        mixture = parameters.mixture.mixture(reference.mixture)
        shares = jnp.where(mixture.live, parameters.share_after, 0.5)
        return JointMixture(mixture, shares, parameters.noise_weight, self.log_noise)

    def updated(self, mixture: JointMixture, sums: Float[Array, "rows f"]) -> JointMixture:
        """By the joint M-step."""
        return self.annihilating_maximisation(mixture, sums)


def joint_prior(noise_floor: Scalar, tolerance: Scalar, dimension: int = 3) -> Prior:
    r"""Figueiredo and Jain's prior (2.19) for components that have the share as a parameter more.

    Args:
        noise_floor: standard deviation of the sensor's noise.
        tolerance: the registration tolerance $\tau$.
        dimension: of the points.
    """
    return Prior(
        concentration=1 - (parameters_per_component(dimension) + JointMixtureModel.own_parameters) / 2,
        noise_floor=noise_floor,
        tolerance=tolerance,
        noise_share=NOISE_SHARE,
        noise_strength=NOISE_STRENGTH,
    )


def joint_chunks(points: LabelledPoints) -> FeatureChunks:
    """The features of the points, with the source as one more."""
    chunks = FeatureChunks.of(points.points)
    padding = chunks.mass.size - len(points.after)
    after = jnp.pad(jnp.asarray(points.after), (0, padding)).reshape(chunks.mass.shape)
    features = jnp.concatenate([chunks.features, after[:, None]], axis=1)
    return FeatureChunks(features, chunks.mass, chunks.dimension)


@in_full_precision
def initial_joint_mixture(
    points: LabelledPoints, slots: int, prior: Prior, key: PRNGKeyArray, components: int | Int[Array, ""] | None = None
) -> JointMixture:
    """k-means++ seeds on both clouds, as wide as the points are from their seeds, with equal weights and shares.

    Args:
        points: both clouds.
        slots: of the mixture.
        prior: its noise floor and tolerance are added to the covariances.
        key: random key of the seeds.
        components: how many slots are live, the first; None: all.
    """
    coordinates, mass = jnp.asarray(points.points.points), jnp.asarray(points.points.mass)
    seeds, live = distinct_seeds(WeightedPoints(coordinates, mass), slots, key)
    live = live if components is None else live & (jnp.arange(slots, dtype=jnp.int32) < components)
    dimension, dtype = coordinates.shape[1], coordinates.dtype
    squared = jnp.sum(coordinates**2, axis=1)[:, None] - 2 * coordinates @ seeds.T + jnp.sum(seeds**2, axis=1)[None]
    nearest = jnp.maximum(jnp.min(jnp.where(live[None], squared, jnp.inf), axis=1), 0)
    variance = mass @ nearest / jnp.sum(mass) / dimension
    covariance = prior.widened(variance * jnp.eye(dimension, dtype=dtype)[None])
    noise_weight = jnp.asarray(0.0 if prior.noise_share is None else prior.noise_share, dtype)
    weights = (1 - noise_weight) * live.astype(dtype) / jnp.sum(live, dtype=dtype)
    covariances = jnp.broadcast_to(covariance, (slots, dimension, dimension))
    mixture = GaussianMixture.masked(weights, seeds, covariances, live)
    return JointMixture(mixture, jnp.full(slots, 0.5, dtype), noise_weight, _log_noise(points.points))


def fit_joint_mixture(
    points: LabelledPoints, start: JointMixture, prior: Prior, settings: FitSettings = FitSettings()
) -> Annihilated[JointMixture]:
    """Fits one mixture to both clouds by EM with annihilation, from the components of `start` down.

    A pure function of arrays, as `fit_by_annihilation`.

    Args:
        points: both clouds, in a scale of order 1 about an origin near the points.
        start: such as `initial_joint_mixture`.
        prior: tolerance and noise.
        settings: how EM runs; covariances are full.
    """
    return fit_model(JointMixtureModel.of(points, prior, settings), start, settings)


def fit_joint_mixture_from_seeds(
    points: LabelledPoints,
    slots: int,
    prior: Prior,
    key: PRNGKeyArray,
    settings: FitSettings,
    components: int | Int[Array, ""] | None = None,
) -> Annihilated[JointMixture]:
    """`fit_joint_mixture` from `initial_joint_mixture`, through which nothing is differentiated."""
    held, prior_held = jax.lax.stop_gradient((points, prior))
    start = initial_joint_mixture(held, slots, prior_held, key, components)
    return fit_joint_mixture(points, start, prior, settings)


def _log_noise(points: WeightedPoints) -> Float[Array, ""]:
    """The uniform density; half of it for each source."""
    return log_uniform_density(points) - math.log(2)
