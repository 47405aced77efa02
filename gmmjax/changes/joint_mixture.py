r"""One mixture for both clouds: each component has its own share of "after".

$$p(x, s) = \sum_k w_k N(x; \mu_k, \Sigma_k + \tau^2 I) \theta_k^s (1 - \theta_k)^{1-s} + w_0 u(x) / 2$$

with s = 0 before and 1 after, the registration tolerance $\tau$, and a uniform density u for stray points. Separate
fits split the same wall in two ways; the one mixture splits it once, and what differs between the clouds is in the
shares.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, PRNGKeyArray

from gmmjax._typing import Array, Scalar
from gmmjax.mixtures import FeatureChunks, FitSettings, GaussianMixture, WeightedPoints, parameters_per_component
from gmmjax.mixtures.annihilation import Algorithm, Annihilated, annihilate, weakest
from gmmjax.mixtures.expectation_maximisation import WAITING_WEIGHT, feature_sums
from gmmjax.mixtures.quadratic import coefficients, quadratic_features, split_feature_sums
from gmmjax.mixtures.seeding import distinct_seeds

# Half an observation of either cloud in each component (Jeffreys' prior) keeps the logarithms of the shares finite.
SHARE_PRIOR = 0.5
FIRST_NOISE_WEIGHT = 0.02
# Observations that the noise never falls below, so that it can come back.
LEAST_NOISE = 0.01


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


class JointPrior(eqx.Module):
    r"""What is believed of a joint mixture before the points are seen.

    Attributes:
        noise_floor: standard deviation that every covariance is widened by: the sensor's noise.
        tolerance: the registration tolerance $\tau$, standard deviation an axis, by which they are widened as well.
        noise: whether there is a uniform component for stray points: 1, or 0 for none.
    """

    noise_floor: Scalar
    tolerance: Scalar
    noise: Scalar

    def covariances(self, covariances: Float[Array, "k d d"]) -> Float[Array, "k d d"]:
        """The estimated covariances, widened."""
        widening = self.noise_floor**2 + self.tolerance**2
        return covariances + widening * jnp.eye(covariances.shape[-1], dtype=covariances.dtype)[None]


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


def initial_joint_mixture(points: SourcedPoints, components: int, prior: JointPrior, key: PRNGKeyArray) -> JointMixture:
    """k-means++ seeds on both clouds, as wide as the points are from their seeds, with equal weights and shares."""
    coordinates, mass = jnp.asarray(points.points.points), jnp.asarray(points.points.mass)
    seeds, live = distinct_seeds(WeightedPoints(coordinates, mass), components, key)
    dimension, dtype = coordinates.shape[1], coordinates.dtype
    squared = jnp.sum(coordinates**2, axis=1)[:, None] - 2 * coordinates @ seeds.T + jnp.sum(seeds**2, axis=1)[None]
    nearest = jnp.maximum(jnp.min(jnp.where(live[None], squared, jnp.inf), axis=1), 0)
    variance = mass @ nearest / jnp.sum(mass) / dimension
    covariance = prior.covariances(variance * jnp.eye(dimension, dtype=dtype)[None])
    noise_weight = jnp.asarray(FIRST_NOISE_WEIGHT * prior.noise, dtype)
    weights = (1 - noise_weight) * live.astype(dtype) / jnp.sum(live, dtype=dtype)
    covariances = jnp.broadcast_to(covariance, (components, dimension, dimension))
    mixture = GaussianMixture.masked(weights, seeds, covariances, live)
    return JointMixture(mixture, jnp.full(components, 0.5, dtype), noise_weight, _log_noise(coordinates))


def fit_joint_mixture(
    points: SourcedPoints, start: JointMixture, prior: JointPrior, settings: FitSettings = FitSettings()
) -> Annihilated:
    """Fits one mixture to both clouds by EM with annihilation, from the components of `start` down.

    A pure function of arrays, as `fit_by_annihilation`; the `model` of the result is the `JointMixture`.

    Args:
        points: both clouds, in a scale of order 1 about an origin near the points.
        start: such as `initial_joint_mixture`.
        prior: tolerance and noise.
        settings: how EM runs; covariances are full.
    """
    chunks = joint_chunks(points)
    observations = jnp.sum(chunks.mass)

    def expectation(joint: JointMixture) -> tuple[JaxArray, JaxArray]:
        return feature_sums(joint.coefficients(), chunks)

    def update(joint: JointMixture, sums: JaxArray, at_rest: JaxArray) -> JointMixture:
        return joint_maximisation(joint, sums, prior, settings.min_components)

    algorithm = Algorithm(
        expectation=expectation,
        message_length=lambda joint, likelihood: joint_message_length(joint, likelihood, observations),
        update=update,
        without_weakest=_without_weakest,
        live_count=lambda joint: joint.mixture.count,
        observations=observations,
    )
    return annihilate(start, algorithm, settings)


def joint_maximisation(
    joint: JointMixture, sums: Float[Array, "rows features"], prior: JointPrior, min_components: int = 1
) -> JointMixture:
    """M-step for all components at once, in which at most the weakest dies (2.20, with the share as a parameter more).

    Args:
        joint: the current mixture.
        sums: of the features, from the E-step; the last row is the noise's.
        prior: tolerance and noise.
        min_components: of so many components none dies.
    """
    live, dimension = joint.mixture.live, joint.mixture.dimension
    mass, means, covariances = split_feature_sums(sums[:-1, :-1], dimension)
    support = mass - _parameters(dimension) / 2
    dies = weakest(mass, live) & (support <= 0) & (joint.mixture.count > min_components)
    kept = live & ~dies
    unnormalised = jnp.where(kept, jnp.maximum(support, WAITING_WEIGHT), 0)
    noise = prior.noise * jnp.maximum(sums[-1, 0], LEAST_NOISE)
    total = jnp.sum(unnormalised) + noise
    shares = (sums[:-1, -1] + SHARE_PRIOR) / (mass + 2 * SHARE_PRIOR)
    mixture = GaussianMixture.masked(unnormalised / total, means, prior.covariances(covariances), kept)
    return JointMixture(mixture, jnp.where(kept, shares, 0.5), noise / total, joint.log_noise)


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
    ones = jnp.full((1, len(points)), float(after), points.dtype)
    return jax.nn.softmax(joint.coefficients() @ jnp.concatenate([quadratic_features(points), ones]), axis=0)


def changed_share(joint: JointMixture, ratio: Scalar, after: bool) -> Float[Array, " k"]:
    r"""The share of each component's observations in one cloud that the other does not have.

    $\max(0, 1 - \rho (1 - \theta_k) / \theta_k)$ in the after cloud, $\max(0, 1 - \theta_k / (\rho (1 - \theta_k)))$
    in the before cloud; 0 in dead slots.
    """
    odds = joint.share_after / (1 - joint.share_after) / ratio
    return jnp.where(joint.mixture.live, jnp.maximum(0, 1 - (1 / odds if after else odds)), 0)


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


def _log_noise(coordinates: JaxArray) -> JaxArray:
    """One over the volume of the bounding box; half of it for each source."""
    extent = jnp.max(coordinates, axis=0) - jnp.min(coordinates, axis=0)
    return -jnp.sum(jnp.log(jnp.maximum(extent, 1e-6))) - jnp.log(2.0).astype(coordinates.dtype)
