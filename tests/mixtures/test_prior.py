"""The prior's most probable parameters, and fits under it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st

from gmmjax import Prior, fit_mixture
from gmmjax.mixtures import expectation, maximisation
from gmmjax.mixtures.expectation_maximisation import FeatureChunks
from tests.mixtures.examples import assert_mixtures_close, cloud, random_mixture, weighted

KEY = jax.random.key(1)


def moments_of(seed, components=3, dimension=3):
    """Masses, means and covariances as the points might give them."""
    random = np.random.default_rng(seed)
    factors = random.standard_normal((components, dimension, dimension))
    covariances = factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(dimension)
    return random.uniform(0.5, 40, components), random.standard_normal((components, dimension)), covariances


def log_posterior(parameters, mass, mean, covariance, prior):
    """Of one component's mean and the rows of its Cholesky factor, under the normal-inverse-Wishart prior, (nats)."""
    dimension = len(mean)
    centre, factor = parameters[:dimension], np.zeros((dimension, dimension))
    factor[np.tril_indices(dimension)] = parameters[dimension:]
    if (np.diag(factor) <= 0).any():
        return -np.inf
    precision = np.linalg.inv(factor @ factor.T)
    log_determinant = 2 * np.log(np.diag(factor)).sum()

    def quadratic(offset):
        return offset @ precision @ offset

    likelihood = -mass / 2 * (log_determinant + np.trace(precision @ covariance) + quadratic(mean - centre))
    wishart = -prior.degrees_of_freedom / 2 * (log_determinant + prior.scale**2 * np.trace(precision))
    return likelihood + wishart - prior.mean_strength / 2 * quadratic(centre - prior.mean)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_parameters_are_the_maximum_of_the_posterior(float64, dimension):
    """A maximum found by a general optimiser, which knows no closed form."""
    prior = Prior(1.0, 0.0, 0.7, 4.0, np.linspace(1, 2, dimension), 3.0)
    mass, means, covariances = moments_of(dimension, dimension=dimension)
    ours = np.asarray(prior.means(mass, means)), np.asarray(prior.covariances(mass, means, covariances))
    for component in range(3):
        own = mass[component], means[component], covariances[component]
        start = np.concatenate([means[component], np.eye(dimension)[np.tril_indices(dimension)]])
        best = scipy.optimize.minimize(
            lambda parameters, own=own: min(-log_posterior(parameters, *own, prior), 1e9),
            start,
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-13, "maxiter": 20_000, "maxfev": 20_000, "adaptive": True},
        )
        factor = np.linalg.cholesky(ours[1][component])
        closed = np.concatenate([ours[0][component], factor[np.tril_indices(dimension)]])
        np.testing.assert_allclose(closed, best.x, atol=1e-4)
        assert log_posterior(closed, *own, prior) >= -best.fun - 1e-9


def test_parameters_in_one_dimension_by_hand(float64):
    """n = 6, mean 2, variance 3; kappa = 2, m = -2; nu = 4, s = 0.5; floor 0.3, tolerance 0.4."""
    prior = Prior(1.0, 0.3, 0.5, 4.0, -2.0, 2.0, tolerance=0.4)
    mass, means, covariances = np.array([6.0]), np.array([[2.0]]), np.array([[[3.0]]])
    np.testing.assert_allclose(prior.means(mass, means), [[(6 * 2 - 2 * 2) / 8]])
    expected = (6 * 3 + 6 * 2 / 8 * 16 + 4 * 0.25) / 10 + 0.09 + 0.16
    np.testing.assert_allclose(prior.covariances(mass, means, covariances), [[[expected]]])


@given(seed=st.integers(0, 10**6), scale=st.floats(0.01, 5), mean=st.floats(-5, 5))
def test_strong_beliefs_win_and_weak_ones_say_nothing(seed, scale, mean):
    with jax.enable_x64(True):
        mass, means, covariances = moments_of(seed)
        strong = Prior(1.0, 0.0, scale, 1e9, mean, 1e9)
        np.testing.assert_allclose(strong.means(mass, means), np.full((3, 3), mean), atol=1e-6)
        np.testing.assert_allclose(
            Prior(1.0, 0.0, scale, 1e9).covariances(mass, means, covariances),
            np.tile(scale**2 * np.eye(3), (3, 1, 1)),
            atol=1e-5,
        )
        silent = Prior(1.0, 0.1, scale, 0.0, mean, 0.0)
        np.testing.assert_array_equal(silent.means(mass, means), means)
        np.testing.assert_allclose(
            silent.covariances(mass, means, covariances), covariances + 0.01 * np.eye(3)[None], rtol=1e-14
        )


@pytest.mark.slow
def test_components_without_mass_have_the_prior_parameters(float64):
    """And without a belief parameters that are finite."""
    mass, means, covariances = np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2, 2))
    prior = Prior(1.0, 0.0, 0.5, 3.0, np.array([1.0, -2]), 2.0)
    np.testing.assert_allclose(prior.means(mass, means), [[1.0, -2]])
    np.testing.assert_allclose(prior.covariances(mass, means, covariances), 0.25 * np.eye(2)[None])
    silent = Prior(1.0, 0.1)
    np.testing.assert_allclose(silent.covariances(mass, means, covariances), 0.01 * np.eye(2)[None])
    slopes = jax.grad(lambda mass: jnp.sum(silent.covariances(mass, means, covariances)))(jnp.zeros(1))
    assert np.isfinite(slopes).all()


def test_weights_and_noise_weight(float64):
    prior = Prior(-3.5, 0.0, noise_share=0.1, noise_strength=20.0)
    np.testing.assert_array_equal(prior.unnormalised_weights(np.array([10.0, 4.5, 1.0])), [5.5, 0, 0])
    # The maximum of (m + s h) log w + (c + s (1 - h)) log (1 - w), for m = 8 and c = 72.
    weights = np.linspace(0.001, 0.999, 99_801)
    score = (8 + 2) * np.log(weights) + (72 + 18) * np.log(1 - weights)
    weight = prior.noise_weight(jnp.asarray(8.0), jnp.asarray(72.0))
    np.testing.assert_allclose(weight, weights[score.argmax()], atol=1e-5)
    fixed = dataclasses.replace(prior, noise_strength=1e9)
    np.testing.assert_allclose(fixed.noise_weight(jnp.asarray(8.0), jnp.asarray(72.0)), 0.1, atol=1e-6)


@given(seed=st.integers(0, 10**6), scale=st.floats(0.1, 10), shift=st.floats(-5, 5))
def test_rescaled_is_the_belief_about_the_rescaled_points(seed, scale, shift):
    with jax.enable_x64(True):
        offset = shift * np.array([1.0, -1, 0.5])
        prior = Prior(-3.5, 0.1, 0.5, 3.0, np.array([0.2, -0.4, 0.1]), 2.0, 0.05, 0.1, 5.0)
        mass, means, covariances = moments_of(seed)
        rescaled = prior.rescaled(scale, offset)
        moved = scale * means + offset[None]
        np.testing.assert_allclose(
            rescaled.means(mass, moved), scale * prior.means(mass, means) + offset[None], atol=1e-12 * (1 + scale)
        )
        np.testing.assert_allclose(
            rescaled.covariances(mass, moved, scale**2 * covariances),
            scale**2 * prior.covariances(mass, means, covariances),
            rtol=1e-9,
            atol=1e-12 * scale**2,
        )
        for name in ("concentration", "degrees_of_freedom", "mean_strength", "noise_share", "noise_strength"):
            assert getattr(rescaled, name) == getattr(prior, name)


@pytest.fixture(scope="module")
def points():
    return cloud(points=100)


def test_the_fit_of_rescaled_points_is_the_rescaled_fit(points):
    prior = Prior(-3.5, 0.02, 0.5, 20.0, np.array([1.0, -1, 0.5]), 10.0, noise_share=0.02)
    fit = fit_mixture(points, key=KEY, max_components=8, prior=prior)
    scale, shift = 250.0, np.array([1e4, -2e4, 300.0])
    moved = fit_mixture(scale * points + shift, key=KEY, max_components=8, prior=prior.rescaled(scale, shift))
    assert moved.mixture.count == fit.mixture.count
    expected = fit.mixture.rescaled(scale, shift)
    np.testing.assert_allclose(moved.mixture.means, expected.means, atol=1e-6 * scale)
    np.testing.assert_allclose(moved.mixture.covariances, expected.covariances, atol=1e-6 * scale**2)
    np.testing.assert_allclose(moved.noise_share, fit.noise_share, atol=1e-8)
    # The belief is felt: in the unit of the points it is another one.
    other = fit_mixture(scale * points + shift, key=KEY, max_components=8, prior=prior.rescaled(scale))
    assert np.abs(other.mixture.means - moved.mixture.means).max() > 0.01 * scale


def test_strong_beliefs_pull_fits(points):
    """All covariances near the sphere that is believed in; all means near the point."""
    spheres = fit_mixture(points, key=KEY, max_components=8, prior=Prior(-3.5, 1e-3, 0.3, 1e7))
    live = spheres.mixture.live_part()
    np.testing.assert_allclose(live.covariances, np.tile(0.09 * np.eye(3), (len(live.weights), 1, 1)), atol=1e-3)
    one_place = np.array([0.5, 0.2, -0.3])
    together = fit_mixture(points, key=KEY, max_components=8, prior=Prior(-3.5, 1e-3, 0.0, 0.0, one_place, 1e7))
    live = together.mixture.live_part()
    np.testing.assert_allclose(live.means, np.tile(one_place, (len(live.weights), 1)), atol=1e-2)


@pytest.mark.slow
def test_defaults_change_nothing(float64, points):
    """A prior that states no strength gives the M-step of one that states nothing."""
    moments, _ = expectation(random_mixture(), FeatureChunks.of(weighted(points)))
    expected = maximisation(moments, Prior.figueiredo_jain(3, 0.1))
    stated = maximisation(moments, Prior(-3.5, 0.1, 5.0, 0.0, 7.0, 0.0))
    assert_mixtures_close(stated, expected, atol=0)
    np.testing.assert_allclose(expected.means, moments.means, atol=1e-15)
    np.testing.assert_allclose(expected.covariances, moments.covariances + 0.01 * np.eye(3)[None], atol=1e-15)
