"""The uniform component for stray points."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import FitSettings, InputError, Prior, fit_mixture
from gmmjax.mixtures import WeightedPoints, expectation, fit_by_annihilation
from gmmjax.mixtures.expectation_maximisation import FeatureChunks
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.noise import log_uniform_density, noise_coefficients
from tests.mixtures.examples import cloud, pad, random_mixture, scipy_log_joint, start, weighted

GAUSSIANS, SHARE, SIZE = 3, 0.05, 1200
MEANS = np.array([[-2.0, 0, 0], [2, 0, 1], [0, 2.5, -1]])
COVARIANCES = np.stack([np.diag([0.04, 0.09, 0.02]), np.diag([0.05, 0.02, 0.05]), 0.04 * np.eye(3)])


@pytest.fixture(scope="module")
def stray_points():
    """Three Gaussians, and 5 % of all points anywhere in a box of 10."""
    random = np.random.default_rng(3)
    stray = int(SHARE * SIZE)
    parts = [
        random.multivariate_normal(mean, covariance, (SIZE - stray) // GAUSSIANS)
        for mean, covariance in zip(MEANS, COVARIANCES, strict=True)
    ]
    return np.concatenate([*parts, random.uniform(-5, 5, (stray, 3))])


@functools.cache
def fit(precision="float64", noise_share=SHARE, noise_strength=0.5):
    """Of as many components as there are Gaussians, from near them."""
    prior = Prior(-3.5, 0.01, noise_share=noise_share, noise_strength=noise_strength)
    first = GaussianMixture(np.full(3, 1 / 3), MEANS + 0.2, np.tile(0.2 * np.eye(3), (3, 1, 1)), np.ones(3, bool))
    return lambda points: fit_mixture(
        points,
        key=jax.random.key(0),
        start=first,
        prior=prior,
        settings=FitSettings(min_components=3),
        precision=precision,
    )


def worst_covariance(fit):
    """The largest ratio of a fitted standard deviation and the true one, over axes and components."""
    deviations = np.sqrt(np.diagonal(fit.mixture.covariances, axis1=1, axis2=2))
    return (deviations / np.sqrt(np.diagonal(COVARIANCES, axis1=1, axis2=2))).max()


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_stray_points_do_not_widen_the_gaussians(stray_points, precision):
    """With the noise component covariances are right, and the share is that of the stray points."""
    found = fit(precision)(stray_points)
    assert worst_covariance(found) < 1.15
    np.testing.assert_allclose(found.mixture.means, MEANS, atol=0.05)
    np.testing.assert_allclose(found.mixture.weights, np.full(3, 1 / 3), atol=0.02)
    np.testing.assert_allclose(found.noise_share, SHARE, atol=0.01)
    np.testing.assert_allclose(found.mixture.weights.sum(), 1)


def test_without_it_they_do(stray_points):
    without = fit(noise_share=None)(stray_points)
    assert worst_covariance(without) > 2
    assert without.noise_share == 0


def test_float32_agrees_with_float64(stray_points):
    double, single = fit()(stray_points), fit("float32")(stray_points)
    np.testing.assert_allclose(single.noise_share, double.noise_share, atol=1e-3)
    np.testing.assert_allclose(single.mixture.covariances, double.mixture.covariances, atol=2e-3)
    np.testing.assert_allclose(single.log_likelihood, double.log_likelihood, atol=0.1)


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_a_strong_belief_fixes_the_share(stray_points, share):
    found = fit(noise_share=share, noise_strength=1e8)(stray_points)
    np.testing.assert_allclose(found.noise_share, share, atol=1e-5)


def test_scores_are_those_of_mixture_and_noise(stray_points):
    """The log likelihood in the unit of the points, against SciPy's densities and the volume of the box."""
    scale = 20.0
    prior = Prior(-3.5, 0.2, noise_share=SHARE)
    found = fit_mixture(scale * stray_points, key=jax.random.key(0), prior=prior, max_components=6)
    density = np.exp(np.logaddexp.reduce(scipy_log_joint(found.mixture, scale * stray_points), axis=1))
    volume = np.prod(scale * np.ptp(stray_points, axis=0))
    expected = np.log((1 - found.noise_share) * density + found.noise_share / volume).sum()
    np.testing.assert_allclose(found.log_likelihood, expected, rtol=1e-6)


@pytest.mark.slow
def test_expectation_against_plain_numpy(float64):
    """Masses of components and noise, with dead slots, masses and padding; the mixture's weights lack a tenth to 1."""
    points, mixture = cloud(points=50), random_mixture()
    whole = GaussianMixture(0.9 * mixture.weights, mixture.means, mixture.covariances, mixture.live)
    mass = np.random.default_rng(0).uniform(0.5, 2, len(points))
    log_noise = -np.log(np.prod(np.ptp(points, axis=0)))
    densities = np.exp(np.c_[scipy_log_joint(whole, points), np.full(len(points), np.log(0.1) + log_noise)])
    responsibilities = mass[:, None] * densities / densities.sum(axis=1)[:, None]
    padded = WeightedPoints(np.concatenate([points, np.full((20, 3), 9.0)]), np.pad(mass, (0, 20)))
    log_density = log_uniform_density(padded)
    np.testing.assert_allclose(log_density, log_noise)
    moments, log_likelihood = expectation(pad(whole, 6), FeatureChunks.of(padded), log_density)
    np.testing.assert_allclose(moments.mass, np.pad(responsibilities[:, :4].sum(axis=0), (0, 2)), atol=1e-9)
    np.testing.assert_allclose(moments.noise_mass, responsibilities[:, 4].sum(), rtol=1e-9)
    np.testing.assert_allclose(log_likelihood, mass @ np.log(densities.sum(axis=1)), rtol=1e-10)
    means = responsibilities[:, :4].T @ points / responsibilities[:, :4].sum(axis=0)[:, None]
    np.testing.assert_allclose(moments.means[:4], means, atol=1e-9)


def test_logarithms_stay_finite(float64):
    """Of the volume of a plane, and of a noise component without weight."""
    points = cloud(points=50) * np.array([1, 1, 0])
    assert np.isfinite(log_uniform_density(weighted(points)))
    assert np.isfinite(noise_coefficients(jnp.asarray(0.0), jnp.asarray(-2.0), 10)).all()


def test_the_component_wise_step_has_none(float64):
    points = cloud(points=50)
    with pytest.raises(InputError, match=r"noise_share.*joint"):
        fit_by_annihilation(
            weighted(points), start(points), Prior(-3.5, 0.01, noise_share=0.05), FitSettings(step="component-wise")
        )
