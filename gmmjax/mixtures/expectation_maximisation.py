"""One step of expectation-maximisation for a masked Gaussian mixture (thesis 2.2.2), and its repetition."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.mixtures.covariance_type import CovarianceType, constrained
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.noise import noise_coefficients
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.quadratic import coefficients, quadratic_features, split_feature_sums
from gmmjax.mixtures.weighted_points import WeightedPoints
from gmmjax.native import kernel_or

# Points of a matrix product: XLA computes products so small by one thread, without waiting for others.
POINTS_OF_PRODUCT = 512
# The weight, in observations, of a component that is too weak but may not die yet.
WAITING_WEIGHT = 0.5


class Moments(eqx.Module):
    """Moments of the points in each component: mass (2.7), mean (2.9) and covariance (2.10) about that mean.

    `noise_mass` is what they give to the uniform component for stray points; None where there is none.
    """

    mass: Float[Array, " k"]
    means: Float[Array, "k d"]
    covariances: Float[Array, "k d d"]
    noise_mass: Float[Array, ""] | None = None


class FeatureChunks(eqx.Module):
    """The quadratic features and masses of the points, in c chunks of b points: computed once for all steps."""

    features: Float[Array, "c f b"]
    mass: Float[Array, "c b"]
    dimension: int = eqx.field(static=True)

    @classmethod
    def of(cls, points: WeightedPoints) -> "FeatureChunks":
        """Chunks of at most `POINTS_OF_PRODUCT` points; the last is filled up with mass 0."""
        size, dimension = points.points.shape
        chunks = -(-size // POINTS_OF_PRODUCT)
        padding = chunks * min(size, POINTS_OF_PRODUCT) - size
        coordinates = jnp.pad(jnp.asarray(points.points), ((0, padding), (0, 0)))
        mass = jnp.pad(jnp.asarray(points.mass), (0, padding)).reshape(chunks, -1)
        features = jax.vmap(quadratic_features)(coordinates.reshape(chunks, -1, dimension))
        if points.scatter is not None:
            # The features of many observations are the mean of theirs: E[x x'] = mean mean' + scatter.
            rows, columns = np.triu_indices(dimension)
            scatter = jnp.pad(jnp.asarray(points.scatter)[:, rows, columns], ((0, padding), (0, 0)))
            scatter = scatter.reshape(chunks, -1, len(rows)).swapaxes(1, 2)
            features = features.at[:, 1 + dimension :].add(scatter)
        return cls(features, mass, dimension)


def expectation(
    mixture: GaussianMixture, chunks: FeatureChunks, log_noise: Float[Array, ""] | None = None
) -> tuple[Moments, Float[Array, ""]]:
    r"""E-step, equation (2.6): $r_{nk} = w_k N(x_n; \mu_k, \Sigma_k) / \sum_j w_j N(x_n; \mu_j, \Sigma_j)$.

    Dead components get no responsibility, padded points (mass 0) give none. The [n, k] responsibilities are never
    stored: each chunk adds to the components' sums.

    Args:
        mixture: the current mixture, k slots in d dimensions.
        chunks: the points' features and masses.
        log_noise: logarithm of the density of the noise component, see `log_uniform_density`; what the mixture's
            weights lack to 1 is its weight. None: there is none.

    Returns:
        The components' moments, and the log likelihood (nats) of the observations, (2.11).
    """
    sums, log_likelihood = feature_sums(noisy_coefficients(mixture, log_noise), chunks)
    return noisy_moments(sums, chunks.dimension, noise=log_noise is not None), log_likelihood


def noisy_coefficients(mixture: GaussianMixture, log_noise: Float[Array, ""] | None) -> Float[Array, "rows f"]:
    """`coefficients` of the mixture, and as last row those of the noise component where there is one."""
    rows = coefficients(mixture)
    if log_noise is None:
        return rows
    noise = noise_coefficients(1 - jnp.sum(mixture.weights), log_noise, rows.shape[1])
    return jnp.concatenate([rows, noise])


def noisy_moments(sums: Float[Array, "rows f"], dimension: int, *, noise: bool) -> Moments:
    """The components' moments from the sums of their features; the last row is the noise's, where there is one."""
    if not noise:
        return Moments(*split_feature_sums(sums, dimension))
    return Moments(*split_feature_sums(sums[:-1], dimension), sums[-1, 0])


def feature_sums(
    parameters: Float[Array, "k f"], chunks: FeatureChunks
) -> tuple[Float[Array, "k f"], Float[Array, ""]]:
    r"""Responsibility-weighted sums of the features, where $\theta_k \cdot \phi$ is the log joint of component k.

    Returns:
        For each component the sums of all features, and the log likelihood (nats) of the observations.
    """
    dtype = jnp.result_type(parameters, chunks.features, chunks.mass)
    return _feature_sums(*(array.astype(dtype) for array in (parameters, chunks.features, chunks.mass)))


@eqx.filter_custom_jvp
def _feature_sums(parameters: JaxArray, features: JaxArray, mass: JaxArray) -> tuple[JaxArray, JaxArray]:
    shapes = (jax.ShapeDtypeStruct(parameters.shape, parameters.dtype), jax.ShapeDtypeStruct((), parameters.dtype))
    solved = kernel_or("gmmjax_feature_sums", _plain_feature_sums, shapes, parameters, features, mass)
    sums, log_likelihood = varying_as(solved, parameters, features, mass)
    return sums, log_likelihood


@_feature_sums.def_jvp
@in_full_precision
def _feature_sums_jvp(
    primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[tuple[JaxArray, JaxArray], tuple[JaxArray, JaxArray]]:
    r"""Values by the kernel, which has no derivatives of its own, and tangents.

    With $r_n$ the softmax of $\theta \phi_n$, those of the sums $\sum_n m_n r_n \phi_n^T$ are $\sum_n (\dot m_n r_n +
    m_n \dot r_n) \phi_n^T + m_n r_n \dot\phi_n^T$, and those of the likelihood $\sum_n \dot m_n l_n + m_n \dot l_n$, of
    which the parameters' share is the product with the sums. Only what has a tangent is computed: the loops of an
    implicit derivative move the parameters alone.
    """
    values = _feature_sums(*primals)
    parameters, features, mass = primals
    moved_parameters, moved_features, moved_mass = tangents
    # Products of chunks, as in `_plain_feature_sums`, but side by side: derivatives keep them all in any case.
    log_joint = _each(parameters, features) @ features
    shares = jax.nn.softmax(log_joint, axis=1)
    sums, log_likelihoods = [], []
    if moved_parameters is not None:
        sums.append(_moved_by_parameters(parameters, features, mass, moved_parameters))
        log_likelihoods.append(jnp.sum(values[0] * moved_parameters))
    if moved_features is not None:
        moved = _each(parameters, features) @ moved_features
        log_likelihoods.append(jnp.sum(mass[:, None] * shares * moved))
        sums.append(jnp.sum((shares * mass[:, None]) @ jnp.swapaxes(moved_features, 1, 2), axis=0))
        sums.append(_moved_by_log_joints(shares, moved, features, mass))
    if moved_mass is not None:
        log_likelihoods.append(jnp.sum(moved_mass * jax.nn.logsumexp(log_joint, axis=1)))
        sums.append(jnp.sum(shares @ jnp.swapaxes(features * moved_mass[:, None], 1, 2), axis=0))
    return values, (sum(sums[1:], sums[0]), jnp.sum(jnp.stack(log_likelihoods)))


def _moved_by_parameters(parameters: JaxArray, features: JaxArray, mass: JaxArray, moved: JaxArray) -> JaxArray:
    """The sums' tangent by that of the parameters, a symmetric map: the second derivative of the log likelihood."""
    arguments = parameters, features, mass
    shapes = (jax.ShapeDtypeStruct(parameters.shape, parameters.dtype),)
    moved = varying_as(moved, *arguments, linear=True)
    (sums,) = kernel_or("gmmjax_feature_sums_tangent", _plain_moved_by_parameters, shapes, *arguments, moved)
    found: JaxArray = varying_as(sums, *arguments, linear=True)
    return found


@in_full_precision
def _plain_moved_by_parameters(
    parameters: JaxArray, features: JaxArray, mass: JaxArray, moved: JaxArray
) -> tuple[JaxArray, ...]:
    shares = jax.nn.softmax(_each(parameters, features) @ features, axis=1)
    return (_moved_by_log_joints(shares, _each(moved, features) @ features, features, mass),)


def _moved_by_log_joints(shares: JaxArray, moved: JaxArray, features: JaxArray, mass: JaxArray) -> JaxArray:
    """The sums' tangent by that of the log joints, `moved`."""
    deviations = moved - jnp.sum(shares * moved, axis=1, keepdims=True)
    return jnp.sum((shares * deviations) @ jnp.swapaxes(features * mass[:, None], 1, 2), axis=0)


def _each(parameters: JaxArray, features: JaxArray) -> JaxArray:
    """The parameters, once for each chunk of features."""
    return jnp.broadcast_to(parameters[None], (len(features), *parameters.shape))


@in_full_precision
def _plain_feature_sums(parameters: JaxArray, features: JaxArray, mass: JaxArray) -> tuple[JaxArray, JaxArray]:

    def add_chunk(
        totals: tuple[JaxArray, JaxArray], chunk: tuple[JaxArray, JaxArray]
    ) -> tuple[tuple[JaxArray, JaxArray], None]:
        features, mass = chunk
        log_joint = parameters @ features
        highest = jnp.max(log_joint, axis=0)
        joint = jnp.exp(log_joint - highest[None])
        density = jnp.sum(joint, axis=0)
        # The division is by [b] values on the features' side, not on the [k, b] side.
        sums = joint @ (features * (mass / density)[None]).T
        log_likelihood = mass @ (highest + jnp.log(density))
        return (totals[0] + sums, totals[1] + log_likelihood), None

    zeros = varying_as((jnp.zeros_like(parameters), jnp.zeros((), parameters.dtype)), parameters, features, mass)
    (sums, log_likelihood), _ = jax.lax.scan(add_chunk, zeros, (features, mass))
    return sums, log_likelihood


def maximisation(moments: Moments, prior: Prior, covariance_type: CovarianceType = "full") -> GaussianMixture:
    """M-step, equations (2.7) to (2.10) and (2.20): every component whose support is too weak dies.

    With `Prior.figueiredo_jain` several may die at once; `annihilation` lets only the weakest.
    """
    return m_step(moments, prior.unnormalised_weights(moments.mass), prior, covariance_type)[0]


def survivors(
    mass: Float[Array, " k"], live: Bool[Array, " k"], prior: Prior, min_components: int
) -> Bool[Array, " k"]:
    """The live components, without the weakest where its support is too weak and `min_components` remain.

    FJ02 go component by component because in one joint step all weak components would die, where the death of one
    would have saved its neighbours. Here the others wait at a small weight instead.
    """
    too_weak = prior.unnormalised_weights(mass) <= 0
    return live & ~(weakest(mass, live) & too_weak & (jnp.sum(live) > min_components))


def weakest(weights: Float[Array, " k"], live: Bool[Array, " k"]) -> Bool[Array, " k"]:
    """True at the live component of the smallest weight."""
    return jnp.arange(len(weights)) == jnp.argmin(jnp.where(live, weights, jnp.inf))


def waiting_weights(mass: Float[Array, " k"], live: Bool[Array, " k"], prior: Prior) -> Float[Array, " k"]:
    """Unnormalised weights (2.20) of the live components, in which those that are too weak wait at a small weight."""
    return jnp.where(live, jnp.maximum(prior.unnormalised_weights(mass), WAITING_WEIGHT), 0)


def m_step(
    moments: Moments, weights: Float[Array, " k"], prior: Prior, covariance_type: CovarianceType
) -> tuple[GaussianMixture, Float[Array, ""]]:
    """The M-step of every kind of mixture, equations (2.7) to (2.10), given the unnormalised weights.

    Args:
        moments: of the E-step.
        weights: unnormalised; components of weight 0 die.
        prior: belief about covariances, means and noise.
        covariance_type: constraint on the covariances.

    Returns:
        The Gaussians, and the weight of the noise component (0 without), which is what their weights lack to 1.
    """
    live, total = weights > 0, jnp.sum(weights)
    # Where all components die this is 0 / 0, which `masked` leaves out.
    weights = weights / total
    noise_weight = jnp.zeros_like(total)
    if moments.noise_mass is not None:
        noise_weight = prior.noise_weight(moments.noise_mass, total)
        weights = weights * (1 - noise_weight)
    covariances = prior.covariances(moments.mass, moments.means, moments.covariances)
    covariances = constrained(covariances, moments.mass, covariance_type)
    means = prior.means(moments.mass, moments.means)
    return GaussianMixture.masked(weights, means, covariances, live), noise_weight


class Convergence(NamedTuple):
    """Result of `expectation_maximisation`: the mixture, its log likelihood, and how it ended."""

    mixture: GaussianMixture
    log_likelihood: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def expectation_maximisation(
    points: WeightedPoints,
    start: GaussianMixture,
    prior: Prior,
    *,
    covariance_type: CovarianceType = "full",
    tolerance: float = 1e-5,
    max_steps: int = 100,
) -> Convergence:
    """EM on the live components of `start` until the log likelihood gains less than `tolerance` an observation.

    Args:
        points: the points and their masses.
        start: the mixture to start from.
        prior: belief about weights and noise; `Prior.maximum_likelihood` gives plain EM.
        covariance_type: constraint on the covariances.
        tolerance: nats an observation.
        max_steps: M-steps at the most; reached, `converged` is false.
    """
    chunks = FeatureChunks.of(points)
    observations = jnp.sum(jnp.asarray(points.mass))

    def step(
        state: tuple[GaussianMixture, JaxArray, JaxArray, JaxArray],
    ) -> tuple[GaussianMixture, JaxArray, JaxArray, JaxArray]:
        mixture, previous, steps, _ = state
        moments, log_likelihood = expectation(mixture, chunks)
        converged = jnp.abs(log_likelihood - previous) < tolerance * observations
        updated = maximisation(moments, prior, covariance_type)
        mixture = jax.tree.map(lambda old, new: jnp.where(converged, old, new), mixture, updated)
        return mixture, log_likelihood, jnp.where(converged, steps, steps + 1), converged

    def unfinished(state: tuple[GaussianMixture, JaxArray, JaxArray, JaxArray]) -> JaxArray:
        return ~state[3] & (state[2] < max_steps) & ~jnp.isnan(state[1])

    infinity = jnp.asarray(-jnp.inf, chunks.mass.dtype)
    initial = (jax.tree.map(jnp.asarray, start), infinity, jnp.asarray(0, jnp.int32), jnp.asarray(False))
    initial = varying_as(initial, chunks, prior)
    mixture, _, steps, converged = jax.lax.while_loop(unfinished, step, initial)
    # Stopped at the limit, the last M-step came after the last E-step: score the mixture that is returned.
    return Convergence(mixture, expectation(mixture, chunks)[1], steps, converged)
