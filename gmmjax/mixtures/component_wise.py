"""The component-wise sweep of Figueiredo and Jain (FJ02, section 5 and figure 2)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray

from gmmjax._matrix_products import in_full_precision
from gmmjax._varying import varying_as
from gmmjax.mixtures.covariance_type import CovarianceType, constrained
from gmmjax.mixtures.expectation_maximisation import WAITING_WEIGHT, FeatureChunks
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.quadratic import density_coefficients, split_feature_sums

# Keeps exp() finite for a component that moves onto points where every density was negligible.
HIGHEST_LOG_RATIO = 80.0


@in_full_precision
def component_wise_sweep(
    mixture: GaussianMixture,
    chunks: FeatureChunks,
    prior: Prior,
    covariance_type: CovarianceType = "full",
    min_components: int = 1,
) -> GaussianMixture:
    """One sweep: each component in turn gets its E- and M-step, its weight by (2.20), and may die.

    After each update all weights are renormalised, so that the support of a component that died goes to its neighbours
    before they are tested. This is FJ02's algorithm, and the oracle for the faster joint step.

    Args:
        mixture: the current mixture.
        chunks: the points' features and masses.
        prior: its concentration decides what is too weak.
        covariance_type: full, diagonal or spherical; a tied covariance belongs to no component.
        min_components: at this number none dies.
    """
    features = jnp.moveaxis(chunks.features, 1, 0).reshape(chunks.features.shape[1], -1)
    mass = chunks.mass.reshape(-1)
    log_densities = density_coefficients(mixture.means, mixture.covariances) @ features
    highest = jnp.max(jnp.where(mixture.live[:, None], log_densities, -jnp.inf), axis=0)

    def relative_density(log_density: JaxArray) -> JaxArray:
        return jnp.exp(jnp.minimum(log_density - highest[None], HIGHEST_LOG_RATIO))

    slots = jnp.arange(len(mixture.weights))

    def next_live(live: JaxArray, after: int | JaxArray) -> JaxArray:
        return jnp.min(jnp.where(live & (slots > after), slots, len(slots)))

    def update(state: tuple[JaxArray, GaussianMixture, JaxArray]) -> tuple[JaxArray, GaussianMixture, JaxArray]:
        index, mixture, densities = state
        density = jnp.maximum(mixture.weights @ densities, jnp.finfo(mass.dtype).tiny)
        responsibilities = mass * mixture.weights[index] * densities[index] / density
        moments = split_feature_sums((features @ responsibilities)[None], chunks.dimension)
        component_mass, means, _ = moments
        covariances = constrained(prior.covariances(*moments), component_mass, covariance_type)
        support = prior.unnormalised_weights(component_mass)[0]
        protected = mixture.count <= min_components
        weight = jnp.where(protected, jnp.maximum(support, WAITING_WEIGHT), support) / jnp.sum(mass)
        means = prior.means(component_mass, means)
        mixture = _replaced(mixture, index, weight, means[0], covariances[0])
        updated = relative_density(density_coefficients(means, covariances) @ features)[0]
        densities = densities.at[index].set(jnp.where(weight > 0, updated, 0))
        return next_live(mixture.live, index), mixture, densities

    densities = jnp.where(mixture.live[:, None], relative_density(log_densities), 0)
    state = varying_as((next_live(mixture.live, -1), mixture, densities), chunks, prior)
    _, swept, _ = jax.lax.while_loop(lambda state: state[0] < len(slots), update, state)
    return swept


def _replaced(
    mixture: GaussianMixture, index: JaxArray, weight: JaxArray, mean: JaxArray, covariance: JaxArray
) -> GaussianMixture:
    """One component replaced and the weights renormalised; weight 0 kills it."""
    weights = mixture.weights.at[index].set(weight)
    return GaussianMixture.masked(
        weights=weights / jnp.sum(weights),
        means=mixture.means.at[index].set(mean),
        covariances=mixture.covariances.at[index].set(covariance),
        live=mixture.live.at[index].set(weight > 0),
    )
