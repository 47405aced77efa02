import jax
import numpy as np
import pytest

from gmmjax.mixtures import Prior, WeightedPoints, initial_mixture
from gmmjax.mixtures.seeding import distinct_seeds, spherical_variance
from tests.mixtures.examples import cloud, weighted


def test_seeds_are_distinct_points_of_the_cloud(float64):
    points = cloud(points=50)
    seeds, distinct = distinct_seeds(weighted(points), 25, jax.random.key(0))
    assert distinct.all()
    assert len(np.unique(seeds, axis=0)) == 25
    assert (np.asarray(seeds)[:, None] == points).all(axis=2).any(axis=1).all()


def test_points_without_mass_are_never_seeds(float64):
    points = cloud(points=50)
    mass = np.where(np.arange(200) % 2, 1.0, 0.0)
    seeds, _ = distinct_seeds(weighted(points, mass), 25, jax.random.key(0))
    assert not (np.asarray(seeds)[:, None] == points[mass == 0]).all(axis=2).any()


@pytest.mark.slow
def test_fewer_distinct_points_than_components_leave_dead_slots(float64):
    points = np.repeat(cloud(points=1, components=4), 20, axis=0)
    start = initial_mixture(weighted(points), 25, Prior.figueiredo_jain(3, 1e-3), jax.random.key(0))
    assert start.count == 4
    np.testing.assert_allclose(start.weights.sum(), 1)


@pytest.mark.slow
def test_start_is_that_of_figueiredo_and_jain(float64):
    """Equations (2.16) and (2.17)."""
    points = cloud(points=50)
    np.testing.assert_allclose(spherical_variance(weighted(points)), points.var(axis=0).sum() / 3 / 10)
    start = initial_mixture(weighted(points), 7, Prior.figueiredo_jain(3, 0.0), jax.random.key(0))
    np.testing.assert_allclose(start.weights, 1 / 7)
    np.testing.assert_allclose(start.covariances[3], spherical_variance(weighted(points)) * np.eye(3))


def test_padding_does_not_change_the_draw(float64):
    points = cloud(points=50)
    padded = WeightedPoints(np.concatenate([points, points[:30]]), np.concatenate([np.ones(200), np.zeros(30)]))
    bare, _ = distinct_seeds(weighted(points), 25, jax.random.key(3))
    of_padded, _ = distinct_seeds(padded, 25, jax.random.key(3))
    np.testing.assert_array_equal(of_padded, bare)
