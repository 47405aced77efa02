import jax
import numpy as np
import pytest

from gmmjax.mixtures import (
    FeatureChunks,
    FitSettings,
    GaussianMixture,
    Prior,
    component_wise_sweep,
    fit_by_annihilation,
)
from tests.mixtures import plain_figueiredo_jain
from tests.mixtures.examples import assert_mixtures_close, cloud, pad, start, weighted

NOISE_FLOOR = 1e-3


@jax.jit
def sweep(mixture, points, prior):
    return component_wise_sweep(mixture, FeatureChunks.of(points), prior)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3, 6])
@pytest.mark.parametrize("slots", [12, 15])
def test_every_sweep_equals_the_plain_algorithm(float64, dimension, slots):
    """Parameters to 1e-8 after each of 15 sweeps, in which components die."""
    points = cloud(dimension)
    mass = np.random.default_rng(dimension).uniform(0.5, 1.5, len(points))
    first = start(points, 12, seed=dimension)
    ours, prior = pad(first, slots), Prior.figueiredo_jain(dimension, NOISE_FLOOR)
    theirs = first.weights, first.means, first.covariances
    for _ in range(15):
        ours = sweep(ours, weighted(points, mass), prior)
        theirs = plain_figueiredo_jain.sweep(points, mass, *theirs, NOISE_FLOOR)
        weights, means, covariances = theirs
        assert_mixtures_close(ours, pad(GaussianMixture.masked(weights, means, covariances, weights > 0), slots))
    assert 0 < ours.count < 12


def test_fit_equals_the_plain_algorithm(float64):
    points = cloud(points=60, components=3, seed=3)
    first = start(points, 8)
    length, (weights, means, covariances) = plain_figueiredo_jain.fit(
        points, np.ones(len(points)), first.weights, first.means, first.covariances, NOISE_FLOOR
    )
    fit = fit_by_annihilation(
        weighted(points), first, Prior.figueiredo_jain(3, NOISE_FLOOR), FitSettings(step="component-wise")
    )
    np.testing.assert_allclose(fit.message_length, length, atol=1e-7)
    assert_mixtures_close(fit.mixture, GaussianMixture.masked(weights, means, covariances, weights > 0), atol=1e-6)


def test_the_last_component_never_dies(float64):
    points = cloud(points=2, components=3)
    survivor = sweep(start(points, 1), weighted(points), Prior.figueiredo_jain(3, NOISE_FLOOR))
    assert survivor.count == 1 and survivor.weights[0] == 1
