"""A third kind of mixture: a subclass of the abstract model is all that EM with annihilation asks for."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.mixtures import FeatureChunks, FitSettings, GaussianMixture, Prior, parameters_per_component
from gmmjax.mixtures.annihilation import fit_model
from gmmjax.mixtures.expectation_maximisation import Moments
from gmmjax.mixtures.gaussian_mixture_model import GaussianMixtureModel
from gmmjax.mixtures.mixture_model import AbstractMixtureModel
from gmmjax.mixtures.quadratic import coefficients, split_feature_sums
from gmmjax.mixtures.standardised_mixture import StandardisedMixture
from tests.mixtures.examples import start, weighted


class ColouredMixture(eqx.Module):
    """Gaussians whose points have a colour, normally distributed about the component's with variance 1."""

    mixture: GaussianMixture
    colour: jax.Array


class ColouredModel(AbstractMixtureModel[ColouredMixture, ColouredMixture]):
    """The colour is one more feature; what is the same for all components is left out."""

    own_parameters: ClassVar[int] = 1
    chunks: FeatureChunks
    prior: Prior
    covariance_type: str = eqx.field(static=True)
    min_components: int = eqx.field(static=True)

    def gaussians(self, mixture):
        return mixture.mixture

    def coefficients(self, mixture):
        rows = coefficients(mixture.mixture)
        return jnp.concatenate([rows.at[:, 0].add(-(mixture.colour**2) / 2), mixture.colour[:, None]], axis=1)

    def moments(self, sums):
        return Moments(*split_feature_sums(sums[:, :-1], self.chunks.dimension))

    def assembled(self, gaussians, noise_weight, sums):
        return ColouredMixture(gaussians, jnp.where(gaussians.live, sums[:, -1] / jnp.maximum(sums[:, 0], 1), 0))

    def restricted(self, mixture, live):
        own = mixture.mixture
        weights = jnp.where(live, own.weights, 0)
        kept = GaussianMixture.masked(weights / jnp.sum(weights), own.means, own.covariances, live)
        return ColouredMixture(kept, jnp.where(live, mixture.colour, 0))

    def standardised(self, mixture, reference):
        return ColouredMixture(StandardisedMixture.of(mixture.mixture, reference.mixture), mixture.colour)

    def from_standardised(self, parameters, reference):
        return ColouredMixture(parameters.mixture.mixture(reference.mixture), parameters.colour)

    def updated(self, mixture, sums):
        return self.annihilating_maximisation(mixture, sums)


def two_colours():
    """One Gaussian in space whose points have either of two colours, and a start of six components."""
    random = np.random.default_rng(0)
    points = random.normal(size=(256, 2))
    colour = np.where(np.arange(256) < 100, -4.0, 4.0) + random.normal(size=256)
    first = jax.tree.map(jnp.asarray, start(points))
    return weighted(points), colour, ColouredMixture(first, jnp.asarray(random.choice(colour, 6)))


@pytest.fixture(scope="module")
def coloured():
    """The fit, polished."""

    @jax.jit
    def fitted(points, colour, first):
        chunks = FeatureChunks.of(points)
        features = jnp.concatenate([chunks.features, colour.reshape(1, 1, -1)], axis=1)
        chunks = FeatureChunks(features, chunks.mass, chunks.dimension)
        model = ColouredModel(chunks, Prior(1 - (parameters_per_component(2) + 1) / 2, 1e-2), "full", 1)
        return fit_model(model, first, FitSettings(polish=True))

    with jax.enable_x64(True):
        return fitted(*two_colours())


def test_a_further_kind_of_mixture_is_fitted_by_what_sets_it_apart(float64, coloured):
    mixture = coloured.mixture
    live = np.asarray(mixture.mixture.live)
    assert live.sum() == 2
    order = np.argsort(np.asarray(mixture.colour)[live])
    np.testing.assert_allclose(np.asarray(mixture.colour)[live][order], [-4, 4], atol=0.4)
    # (2.20) with T = 6, the colour among them: half of that is taken off each component's mass.
    np.testing.assert_allclose(np.asarray(mixture.mixture.weights)[live][order], [97 / 250, 153 / 250], atol=1e-3)


def test_message_length_counts_what_else_a_component_has(float64, coloured):
    """One parameter more for each of two components: its share of the weights' and of the size's part."""
    mixture, observations = coloured.mixture.mixture, 256.0
    plain = GaussianMixtureModel.of(two_colours()[0], Prior(1.0, 1e-2), FitSettings())
    more = sum(np.log(observations * np.asarray(mixture.weights)[np.asarray(mixture.live)])) / 2
    shorter = plain.message_length(mixture, coloured.log_likelihood, observations)
    np.testing.assert_allclose(coloured.message_length, shorter + more)


def test_weights_of_the_weakest_go_to_the_others_in_proportion(float64):
    points, _, first = two_colours()
    weights = np.array([0.3, 0.2, 0.05, 0.25, 0.1, 0.0])
    mixture = dataclasses.replace(first.mixture, weights=jnp.asarray(weights), live=jnp.asarray(weights > 0))
    model = GaussianMixtureModel.of(points, Prior(1.0, 1e-2), FitSettings())
    left = model.without_weakest(mixture)
    np.testing.assert_allclose(left.weights, np.where(weights > 0.05, weights * 0.9 / 0.85, 0))
    assert int(left.count) == 4
