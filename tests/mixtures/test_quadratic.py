"""Derivatives of Gaussians as functions of quadratic features."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.test_util import check_grads

from gmmjax.mixtures import WeightedPoints
from gmmjax.mixtures.expectation_maximisation import FeatureChunks, feature_sums
from gmmjax.mixtures.quadratic import density_coefficients


def test_derivatives_of_coefficients_equal_differences(float64):
    """First and second ones, in both modes, also along covariances that are not symmetric."""
    random = np.random.default_rng(0)
    means, roots = random.normal(size=(4, 3)), random.normal(size=(4, 3, 3))
    covariances = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(3)
    check_grads(jax.jit(density_coefficients), (means, covariances), order=2, rtol=1e-5)
    along = jax.jit(lambda moved: jax.jvp(density_coefficients, (means, covariances), (0 * means, moved))[1])
    tangent, symmetric = along(roots), along((roots + roots.swapaxes(1, 2)) / 2)
    np.testing.assert_allclose(tangent, symmetric, rtol=1e-9, atol=1e-9)


def test_derivatives_of_the_expectation_equal_differences(float64):
    """First and second ones, in both modes, by coefficients, features and masses, together and each alone."""
    random = np.random.default_rng(1)
    points = WeightedPoints(random.normal(size=(600, 2)), random.uniform(0.5, 2, 600))
    chunks = FeatureChunks.of(points)
    rows = jnp.asarray(random.normal(size=(3, 6)) / 3)

    def of_masses(rows, scale, mass):
        sums, log_likelihood = feature_sums(rows, FeatureChunks(scale * chunks.features, mass, 2))
        return sums / 600, log_likelihood / 600

    moved = (rows, jnp.asarray(1.1), chunks.mass)
    check_grads(jax.jit(of_masses), moved, order=2, rtol=1e-5)
    for place in range(3):
        alone = jax.jit(lambda own, place=place: of_masses(*moved[:place], own, *moved[place + 1 :]))
        check_grads(alone, (moved[place],), order=1, rtol=1e-5)
