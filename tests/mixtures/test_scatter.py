"""Points that stand for many: with the scatter about them the moments are those of the observations."""

import jax
import numpy as np
import pytest

from gmmjax import InputError, fit_mixture
from gmmjax.clouds import voxel_grid, voxel_size_for
from gmmjax.mixtures import FeatureChunks, GaussianMixture, WeightedPoints, expectation, message_length


@pytest.fixture(scope="module")
def cloud():
    """Two Gaussians and a thin board."""
    random = np.random.default_rng(0)
    blobs = random.normal(size=(6000, 3)) * [0.3, 0.2, 0.4] + random.integers(0, 2, (6000, 1)) * [[2.5, 0, 0]]
    board = random.uniform(-1, 1, (3000, 3)) * [1, 1, 0.01] + [1, 0, -3]
    return np.concatenate([blobs, board])


@jax.jit
def expected(mixture, points):
    return expectation(mixture, FeatureChunks.of(points))


def equal_weights(*means):
    """Gaussians of unit covariance at these places."""
    count = len(means)
    covariances = np.tile(np.eye(3), (count, 1, 1))
    return GaussianMixture(np.full(count, 1 / count), np.array(means, float), covariances, np.ones(count, bool))


SINGLE = equal_weights([0, 0, 0])


def test_moments_are_those_of_the_observations(cloud):
    """One component takes all: its mass, mean and covariance must be exactly the cloud's."""
    grid = voxel_grid(cloud, 0.5)
    with jax.enable_x64(True):
        moments, _ = expected(SINGLE, WeightedPoints(grid.points, grid.mass, grid.scatter(cloud)))
    assert len(grid.mass) < 300
    np.testing.assert_allclose(moments.mass, [len(cloud)])
    np.testing.assert_allclose(moments.means[0], cloud.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(moments.covariances[0], np.cov(cloud.T, bias=True), atol=1e-12)


def test_likelihood_is_a_lower_bound_that_is_sharp_for_one_component(cloud):
    grid = voxel_grid(cloud, 0.5)
    with jax.enable_x64(True):
        two = equal_weights([0, 0, 0], [2, 0, -1])
        reduced = WeightedPoints(grid.points, grid.mass, grid.scatter(cloud))
        whole = WeightedPoints(cloud, np.ones(len(cloud)))
        assert float(expected(SINGLE, reduced)[1]) == pytest.approx(float(expected(SINGLE, whole)[1]))
        assert float(expected(two, reduced)[1]) < float(expected(two, whole)[1])


def fit_of_voxels(cloud, voxels):
    size = voxel_size_for(cloud, voxels)
    grid = voxel_grid(cloud, size)
    return size, fit_mixture(
        grid.points, mass=grid.mass, scatter=grid.scatter(cloud), key=jax.random.key(0), max_components=10, restarts=2
    )


@pytest.mark.slow
def test_a_fit_of_voxels_is_as_good_as_one_of_all_points(cloud):
    blobs = cloud[:6000]
    _, reduced = fit_of_voxels(blobs, 1000)
    whole = fit_mixture(blobs, key=jax.random.key(0), max_components=10, restarts=2)

    def length(fit):
        with jax.enable_x64(True):
            likelihood = fit.mixture.log_density(blobs).sum()
            return float(message_length(fit.mixture, likelihood, float(len(blobs))))

    assert int(reduced.mixture.count) == int(whole.mixture.count) == 2
    assert length(reduced) == pytest.approx(length(whole), rel=1e-3)


def test_a_board_thinner_than_a_voxel_stays_thin(cloud):
    size, fit = fit_of_voxels(cloud, 1000)
    thinnest = np.sqrt(np.linalg.eigvalsh(fit.mixture.live_part().covariances).min())
    assert thinnest < size / 5


def test_another_unit_changes_only_the_scale(cloud):
    grid = voxel_grid(cloud, 0.4)
    scatter = grid.scatter(cloud)
    metres, millimetres = (
        fit_mixture(
            unit * grid.points, mass=grid.mass, scatter=unit**2 * scatter, key=jax.random.key(1), max_components=6
        )
        for unit in (1.0, 1000.0)
    )
    np.testing.assert_allclose(millimetres.mixture.means, 1000 * metres.mixture.means, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("scatter", "message"),
    [
        (np.zeros((99, 3, 3)), r"scatter must have one covariance a point, \[100, 3, 3\], not \[99, 3, 3\]"),
        (np.full((100, 3, 3), np.nan), "scatter must be covariances"),
        (-np.ones((100, 3, 3)), "none of its variances negative"),
    ],
)
def test_bad_scatter_is_named(scatter, message):
    points = np.random.default_rng(0).normal(size=(100, 3))
    with pytest.raises(InputError, match=message):
        fit_mixture(points, scatter=scatter, key=jax.random.key(0))
    with pytest.raises(InputError, match="scatter is not for method='grid'"):
        fit_mixture(points, scatter=np.zeros((100, 3, 3)), method="grid", key=jax.random.key(0))
