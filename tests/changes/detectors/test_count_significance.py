import jax
import numpy as np
import pytest

from gmmjax import GaussianMixture
from gmmjax.changes.detectors.count_significance import count_significance
from gmmjax.mixtures import WeightedPoints


def cloud(*counts, seed=0, apart=10.0):
    """So many points of each of some unit Gaussians in a row."""
    random = np.random.default_rng(seed)
    parts = [random.normal(size=(count, 3)) + np.array([apart * place, 0, 0]) for place, count in enumerate(counts)]
    points = np.concatenate(parts)
    return WeightedPoints(points, np.ones(len(points)))


def mixtures(count, apart=10.0):
    """One restart, with a dead slot at the end."""
    live = np.arange(count + 1) < count
    means = np.where(live, apart * np.arange(count + 1), 0.0)[:, None] * np.eye(3)[:1]
    one = GaussianMixture(live / count, means, np.tile(np.eye(3), (count + 1, 1, 1)), live)
    return jax.tree.map(lambda leaf: leaf[None], one)


def test_equal_clouds_have_no_excess():
    points = cloud(200, 300, 400)
    np.testing.assert_array_equal(count_significance(mixtures(3), points, points), np.zeros((1, 4)))


def test_two_samples_of_one_scene_have_none_that_counts():
    for seed in range(1, 20):
        excess = count_significance(mixtures(3), cloud(200, 300, 400), cloud(200, 300, 400, seed=seed))
        assert np.abs(excess).max() < 4


@pytest.mark.parametrize("density", [1, 4])
def test_what_is_missing_is_significant_at_any_density(density):
    excess = count_significance(mixtures(3), cloud(200, 300, 400), cloud(0, density * 300, density * 400, seed=1))
    # 180 points against none, in the wider ellipsoid.
    assert 12 < excess[0, 0] < 14
    assert np.abs(excess[0, 1:]).max() < 4 and excess[0, 3] == 0


def test_a_displaced_gaussian_is_seen_by_the_narrow_ellipsoid():
    moved = cloud(200, 300, 400, seed=1)
    displaced = WeightedPoints(moved.points + np.where(moved.points[:, :1] < 5, [2.0, 0, 0], 0.0), moved.mass)
    assert count_significance(mixtures(3), cloud(200, 300, 400), displaced)[0, 0] > 5


def test_masses_count():
    points = cloud(200, 300)
    double = WeightedPoints(points.points, 2 * points.mass)
    once, twice = (count_significance(mixtures(2), own, cloud(100, 300, seed=2)) for own in (points, double))
    assert twice[0, 0] > once[0, 0] > 4


def test_nothing_in_common_is_all_excess():
    excess = count_significance(mixtures(2), cloud(200, 300), WeightedPoints(np.full((50, 3), 1e3), np.ones(50)))
    assert (excess[0, :2] > 10).all()
