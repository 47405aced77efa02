r"""One mixture for both clouds: each component has its own share of "after".

$$p(x, s) = \sum_k w_k N(x; \mu_k, \Sigma_k + \tau^2 I) \theta_k^s (1 - \theta_k)^{1-s} + w_0 u(x) / 2$$

with s = 0 before and 1 after, the registration tolerance $\tau$, and a uniform density u for stray points. Separate
fits split the same wall in two ways; the one mixture splits it once, and what differs between the clouds is in the
shares.
"""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from gmmjax._typing import Array, Scalar
from gmmjax.mixtures import FeatureChunks, FitSettings, GaussianMixture, Prior, WeightedPoints, parameters_per_component
from gmmjax.mixtures.annihilation import Algorithm, Annihilated, annihilate, at_rest, weakest, without_derivatives
from gmmjax.mixtures.expectation_maximisation import WAITING_WEIGHT, feature_sums
from gmmjax.mixtures.noise import log_uniform_density
from gmmjax.mixtures.polish import Kind, StandardisedMixture, polished
from gmmjax.mixtures.quadratic import coefficients, quadratic_features, split_feature_sums
from gmmjax.mixtures.seeding import distinct_seeds

# Half an observation of either cloud in each component (Jeffreys' prior) keeps the logarithms of the shares finite.
SHARE_PRIOR = 0.5
# The noise component is expected, but hardly believed in: it can shrink to nothing and come back.
NOISE_SHARE, NOISE_STRENGTH = 0.02, 0.5


class SourcedPoints(eqx.Module):
    """The points of both clouds.

    Attributes:
        points: coordinates and masses; mass 0 is padding.
        after: 1 where the point is of the after cloud, 0 where it is of the before cloud.
    """

    points: WeightedPoints
    after: Float[Array, " n"]

    def padded(self) -> "SourcedPoints":
        """The same points, padded on the host as `WeightedPoints.padded`."""
        padded = self.points.padded()
        return SourcedPoints(padded, np.pad(self.after, (0, len(padded.mass) - len(self.after))))


def joint_prior(noise_floor: Scalar, tolerance: Scalar, dimension: int = 3) -> Prior:
    r"""Figueiredo and Jain's prior (2.19) for components that have the share as a parameter more.

    Args:
        noise_floor: standard deviation of the sensor's noise.
        tolerance: the registration tolerance $\tau$.
        dimension: of the points.
    """
    return Prior(
        concentration=1 - (parameters_per_component(dimension) + 1) / 2,
        noise_floor=noise_floor,
        tolerance=tolerance,
        noise_share=NOISE_SHARE,
        noise_strength=NOISE_STRENGTH,
    )


class JointMixture(eqx.Module):
    """A mixture for both clouds.

    Attributes:
        mixture: the Gaussians, widened by noise and tolerance. Their weights and `noise_weight` sum to 1.
        share_after: the share of each component's observations that are of the after cloud; 0.5 in dead slots.
        noise_weight: weight of the uniform component.
        log_noise: logarithm of that component's density, of a point and its source.
    """

    mixture: GaussianMixture
    share_after: Float[Array, " k"]
    noise_weight: Float[Array, ""]
    log_noise: Float[Array, ""]

    def coefficients(self) -> Float[Array, "rows features"]:
        """The log joints as linear functions of the quadratic features and the source; the last row is the noise."""
        rows = coefficients(self.mixture)
        log_before, log_after = jnp.log1p(-self.share_after), jnp.log(self.share_after)
        rows = jnp.concatenate([rows.at[:, 0].add(log_before), (log_after - log_before)[:, None]], axis=1)
        noise = jnp.zeros_like(rows[:1]).at[0, 0].set(jnp.log(jnp.maximum(self.noise_weight, 1e-30)) + self.log_noise)
        return jnp.concatenate([rows, noise])


def joint_chunks(points: SourcedPoints) -> FeatureChunks:
    """The features of the points, with the source as one more."""
    chunks = FeatureChunks.of(points.points)
    padding = chunks.mass.size - len(points.after)
    after = jnp.pad(jnp.asarray(points.after), (0, padding)).reshape(chunks.mass.shape)
    features = jnp.concatenate([chunks.features, after[:, None]], axis=1)
    return FeatureChunks(features, chunks.mass, chunks.dimension)


def initial_joint_mixture(
    points: SourcedPoints, slots: int, prior: Prior, key: PRNGKeyArray, components: int | Int[Array, ""] | None = None
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
    points: SourcedPoints, start: JointMixture, prior: Prior, settings: FitSettings = FitSettings()
) -> Annihilated:
    """Fits one mixture to both clouds by EM with annihilation, from the components of `start` down.

    A pure function of arrays, as `fit_by_annihilation`; the `model` of the result is the `JointMixture`.

    Args:
        points: both clouds, in a scale of order 1 about an origin near the points.
        start: such as `initial_joint_mixture`.
        prior: tolerance and noise.
        settings: how EM runs; covariances are full.
    """
    given = joint_chunks(points), prior, _log_noise(points.points)
    # Which components win is discrete; what differs smoothly with the arguments is where they come to rest.
    held, start = jax.lax.stop_gradient((given, start))
    end = annihilate(start, _joint_algorithm(*held, settings), settings)
    if not settings.polish:
        return without_derivatives(end, given)
    rest = polished(joint_mixtures(settings.min_components), end.model, given, max_steps=settings.max_polish_steps)
    chunks = given[0]
    _, log_likelihood = feature_sums(rest.model.coefficients(), chunks)
    return at_rest(end, rest, joint_message_length(rest.model, log_likelihood, jnp.sum(chunks.mass)), log_likelihood)


def _joint_algorithm(chunks: FeatureChunks, prior: Prior, log_noise: JaxArray, settings: FitSettings) -> Algorithm:
    observations = jnp.sum(chunks.mass)

    def expectation(joint: JointMixture) -> tuple[JaxArray, JaxArray]:
        return feature_sums(joint.coefficients(), chunks)

    def update(joint: JointMixture, sums: JaxArray, at_rest: JaxArray) -> JointMixture:
        return joint_maximisation(joint, sums, prior, settings.min_components)

    return Algorithm(
        expectation=expectation,
        message_length=lambda joint, likelihood: joint_message_length(joint, likelihood, observations),
        update=update,
        without_weakest=_without_weakest,
        live_count=lambda joint: joint.mixture.count,
        observations=observations,
    )


def fit_joint_mixture_from_seeds(
    points: SourcedPoints,
    slots: int,
    prior: Prior,
    key: PRNGKeyArray,
    settings: FitSettings,
    components: int | Int[Array, ""] | None = None,
) -> Annihilated:
    """`fit_joint_mixture` from `initial_joint_mixture`, through which nothing is differentiated."""
    held, prior_held = jax.lax.stop_gradient((points, prior))
    start = initial_joint_mixture(held, slots, prior_held, key, components)
    return fit_joint_mixture(points, start, prior, settings)


def joint_maximisation(
    joint: JointMixture, sums: Float[Array, "rows features"], prior: Prior, min_components: int = 1
) -> JointMixture:
    """M-step for all components at once, in which at most the weakest dies (2.20, with the share as a parameter more).

    Args:
        joint: the current mixture.
        sums: of the features, from the E-step; the last row is the noise's.
        prior: tolerance and noise.
        min_components: of so many components none dies.
    """
    live, mass = joint.mixture.live, sums[:-1, 0]
    too_weak = prior.unnormalised_weights(mass) <= 0
    dies = weakest(mass, live) & too_weak & (joint.mixture.count > min_components)
    return _maximised(joint, sums, prior, live & ~dies)


def _maximised(
    joint: JointMixture, sums: Float[Array, "rows features"], prior: Prior, kept: Bool[Array, " k"]
) -> JointMixture:
    mass, means, covariances = split_feature_sums(sums[:-1, :-1], joint.mixture.dimension)
    unnormalised = jnp.where(kept, jnp.maximum(prior.unnormalised_weights(mass), WAITING_WEIGHT), 0)
    total = jnp.sum(unnormalised)
    noise_weight = prior.noise_weight(sums[-1, 0], total) if prior.noise_share is not None else jnp.zeros_like(total)
    shares = (sums[:-1, -1] + SHARE_PRIOR) / (mass + 2 * SHARE_PRIOR)
    mixture = GaussianMixture.masked(
        unnormalised / total * (1 - noise_weight),
        prior.means(mass, means),
        prior.covariances(mass, means, covariances),
        kept,
    )
    return JointMixture(mixture, jnp.where(kept, shares, 0.5), noise_weight, joint.log_noise)


class StandardisedJointMixture(eqx.Module):
    """A joint mixture relative to a reference, see `StandardisedMixture`; shares and noise weight as they are."""

    mixture: StandardisedMixture
    share_after: Float[Array, " k"]
    noise_weight: Float[Array, ""]


_Given = tuple[FeatureChunks, Prior, JaxArray]


@functools.cache
def joint_mixtures(min_components: int) -> Kind:
    """EM on `JointMixture`, given the features of the points, the prior, and the noise component's log density."""

    def step(joint: JointMixture, given: _Given) -> JointMixture:
        chunks, prior, _ = given
        return joint_maximisation(joint, feature_sums(joint.coefficients(), chunks)[0], prior, min_components)

    def frozen_step(joint: JointMixture, given: _Given) -> JointMixture:
        chunks, prior, _ = given
        return _maximised(joint, feature_sums(joint.coefficients(), chunks)[0], prior, joint.mixture.live)

    def standardised(joint: JointMixture, reference: JointMixture) -> StandardisedJointMixture:
        own = StandardisedMixture.of(joint.mixture, reference.mixture)
        return StandardisedJointMixture(own, joint.share_after, joint.noise_weight)

    def model(parameters: StandardisedJointMixture, reference: JointMixture, given: _Given) -> JointMixture:
        mixture = parameters.mixture.mixture(reference.mixture)
        shares = jnp.where(mixture.live, parameters.share_after, 0.5)
        return JointMixture(mixture, shares, parameters.noise_weight, given[2])

    return Kind(step, frozen_step, standardised, model, lambda joint: joint.mixture.live)


def joint_message_length(joint: JointMixture, log_likelihood: Scalar, observations: Scalar) -> Float[Array, ""]:
    """FJ02's message length with the share as one parameter more a component."""
    mixture = joint.mixture
    parameters = _parameters(mixture.dimension)
    log_weights = jnp.sum(jnp.log(jnp.where(mixture.live, mixture.weights, 1)))
    size = (parameters + 1) / 2 * mixture.count.astype(log_weights.dtype)
    return -log_likelihood + parameters / 2 * log_weights + size * jnp.log(observations)


def density_ratio(joint: JointMixture) -> Float[Array, ""]:
    """Observations of the after cloud for one of the before cloud, where both saw the same.

    The weighted median of the components' odds: what changed is the smaller part and does not move it.
    """
    shares = joint.share_after
    odds = shares / (1 - shares)
    weights = joint.mixture.weights * jnp.minimum(shares, 1 - shares)
    order = jnp.argsort(odds)
    cumulative = jnp.cumsum(weights[order])
    return odds[order][jnp.searchsorted(cumulative, cumulative[-1] / 2)]


def intensities(joint: JointMixture, points: Float[Array, "n d"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The expected density of observations of the before and of the after cloud at each point, noise included.

    The points must be near the origin in a scale of order 1, where the quadratic features keep their digits.
    """
    log_joint = coefficients(joint.mixture) @ quadratic_features(points)
    both = jnp.exp(log_joint)
    noise = joint.noise_weight * jnp.exp(joint.log_noise)
    return (1 - joint.share_after) @ both + noise, joint.share_after @ both + noise


def responsibilities(joint: JointMixture, points: Float[Array, "n d"], after: bool) -> Float[Array, "rows n"]:
    """Probability that each point of one cloud is of each component; the last row is the noise."""
    return jax.nn.softmax(log_joint(joint, points, after), axis=0)


def log_joint(joint: JointMixture, points: Float[Array, "n d"], after: bool) -> Float[Array, "rows n"]:
    """Logarithm of each component's joint density of a point and its cloud; the last row is the noise's."""
    source = jnp.full((1, len(points)), float(after), points.dtype)
    return joint.coefficients() @ jnp.concatenate([quadratic_features(points), source])


def changed_share(joint: JointMixture, ratio: Scalar, after: bool) -> Float[Array, " k"]:
    r"""The share of each component's observations in one cloud that the other does not have.

    $\max(0, 1 - \rho (1 - \theta_k) / \theta_k)$ in the after cloud, $\max(0, 1 - \theta_k / (\rho (1 - \theta_k)))$
    in the before cloud; 0 in dead slots.
    """
    odds = joint.share_after / (1 - joint.share_after) / ratio
    return jnp.where(joint.mixture.live, jnp.maximum(0, 1 - (1 / odds if after else odds)), 0)


def point_posterior(joint: JointMixture, ratio: Scalar, points: Float[Array, "n d"], after: bool) -> Float[Array, " n"]:
    r"""The posterior that a point is extra: $\max(0, 1 - \rho f_0 / f_1)$ in the after cloud.

    The intensities $f_0$ and $f_1$ of the two clouds are compared in a place, whatever Gaussians make them up: two that
    share a wall unevenly cancel out.

    Args:
        joint: the joint mixture.
        ratio: its `density_ratio` $\rho$.
        points: of one cloud, in the scale of the mixture.
        after: whether that is the after cloud; in the before cloud it is $\max(0, 1 - f_1 / (\rho f_0))$.
    """
    intensity_before, intensity_after = intensities(joint, points)
    scaled = intensity_before * ratio
    return jnp.clip(1 - (scaled / intensity_after if after else intensity_after / scaled), 0, 1)


def component_posterior(
    joint: JointMixture, ratio: Scalar, points: Float[Array, "n d"], after: bool
) -> Float[Array, "k n"]:
    """The posterior that a point is of a component, and extra there; their sum is that it is of one which changed.

    A Gaussian that is gone and one that came in the same place are told apart by their shapes, where `point_posterior`
    sees that the density is still the same. Arguments as there.
    """
    return changed_share(joint, ratio, after)[:, None] * responsibilities(joint, points, after)[:-1]


def _parameters(dimension: int) -> int:
    return parameters_per_component(dimension) + 1


def _without_weakest(joint: JointMixture) -> JointMixture:
    live = joint.mixture.live & ~weakest(joint.mixture.weights, joint.mixture.live)
    return with_live(joint, live)


def with_live(joint: JointMixture, live: Bool[Array, " k"]) -> JointMixture:
    """The joint mixture of these components alone, weights renormalised."""
    weights = jnp.where(live, joint.mixture.weights, 0)
    total = jnp.sum(weights) + joint.noise_weight
    mixture = GaussianMixture.masked(weights / total, joint.mixture.means, joint.mixture.covariances, live)
    return JointMixture(mixture, jnp.where(live, joint.share_after, 0.5), joint.noise_weight / total, joint.log_noise)


def _log_noise(points: WeightedPoints) -> JaxArray:
    """The uniform density; half of it for each source."""
    return log_uniform_density(points) - math.log(2)
