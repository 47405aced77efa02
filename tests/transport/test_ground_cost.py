import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from gmmjax import InputError, transport
from gmmjax.transport import euclidean
from tests.differences import along, assert_derivatives

pytestmark = pytest.mark.usefixtures("float64")
# One program a shape, where operation by operation would compile some fifty.
bures_wasserstein = jax.jit(transport.bures_wasserstein)


def covariances(count, condition, seed=0, dimension=3):
    """Random orientations, extents from 1 down to 1 / condition."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, dimension, dimension)))[0]
    extents = condition ** -rng.random((count, dimension))
    extents[:, 0], extents[:, -1] = 1, 1 / condition
    return (axes * extents[:, None]) @ np.swapaxes(axes, 1, 2)


def by_matrix_roots(mean_before, before, mean_after, after):
    root = scipy.linalg.sqrtm(before)
    squared = np.trace(before + after - 2 * scipy.linalg.sqrtm(root @ after @ root).real)
    return np.sqrt(((mean_before - mean_after) ** 2).sum() + squared)


def test_euclidean_distances_and_their_gradient_where_means_coincide():
    means = np.array([[0.0, 0, 0], [3, 4, 0]])
    np.testing.assert_allclose(euclidean(means, means), [[0, 5], [5, 0]])
    gradient = jax.grad(lambda before: euclidean(before, means).sum())(jnp.asarray(means))
    np.testing.assert_allclose(gradient, [[-0.6, -0.8, 0], [0.6, 0.8, 0]])


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_bures_wasserstein_equals_matrix_square_roots(dimension):
    rng = np.random.default_rng(1)
    before, after = covariances(4, 50, 2, dimension), covariances(5, 50, 3, dimension)
    means = rng.normal(size=(4, dimension)), rng.normal(size=(5, dimension))
    expected = [
        [by_matrix_roots(*left, *right) for right in zip(means[1], after, strict=True)]
        for left in zip(means[0], before, strict=True)
    ]
    found = bures_wasserstein(means[0], before, means[1], after)
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    np.testing.assert_allclose(bures_wasserstein(means[1], after, means[0], before).T, found, rtol=1e-12)


def test_bures_wasserstein_of_commuting_covariances_compares_standard_deviations():
    axes = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    before, after = np.array([1.0, 0.3, 1e-3]), np.array([2.0, 1e-3, 0.5])
    found = bures_wasserstein(
        np.zeros((1, 3)), ((axes * before**2) @ axes.T)[None], np.zeros((1, 3)), ((axes * after**2) @ axes.T)[None]
    )
    assert found[0, 0] == pytest.approx(np.linalg.norm(before - after), rel=1e-9)


@pytest.mark.parametrize("condition", [1e2, 1e4, 1e6])
def test_bures_wasserstein_of_thin_gaussians_follows_the_optimal_map(condition):
    """A positive definite map carries one Gaussian optimally onto another: the distance is how far points move."""
    before, maps = covariances(6, condition, 5), covariances(6, 30, 6)
    after = maps @ before @ maps
    expected = np.linalg.norm((np.eye(3) - maps) @ np.linalg.cholesky(before), axis=(1, 2))
    found = bures_wasserstein(np.zeros((6, 3)), before, np.zeros((6, 3)), after)
    np.testing.assert_allclose(np.diagonal(found), expected, rtol=1e-10)


@pytest.mark.parametrize("condition", [1e2, 1e4, 1e6])
def test_bures_wasserstein_gradients_equal_central_differences(condition):
    before, after = covariances(4, condition, 7), covariances(5, condition, 8)
    rng = np.random.default_rng(9)
    means = rng.normal(size=(4, 3)) * 0.1, rng.normal(size=(5, 3)) * 0.1
    factors, noise = np.linalg.cholesky(before), rng.normal(size=(4, 3, 3))
    # Relative to the Gaussian, so that the step keeps thin ones positive definite.
    stretch = factors @ (noise + np.swapaxes(noise, 1, 2)) @ np.swapaxes(factors, 1, 2)
    weights = rng.random((4, 5))

    def total(covariance, mean):
        return (weights * bures_wasserstein(mean, covariance, means[1], after)).sum()

    by_covariance, by_mean = jax.jit(jax.grad(total, argnums=(0, 1)))(jnp.asarray(before), jnp.asarray(means[0]))
    shift = rng.normal(size=(4, 3))
    found = (by_covariance * stretch).sum() + (by_mean * shift).sum()
    expected = along(lambda moved: total(*moved), (before, means[0]), (stretch, shift), 1e-4)
    assert_derivatives(found, expected)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_equal_gaussians_have_no_distance_and_finite_gradients(dtype):
    means = jnp.asarray(np.random.default_rng(10).normal(size=(6, 3)), dtype)
    same = jnp.asarray(np.concatenate([covariances(5, 1e3, 11), np.eye(3)[None]]), dtype)
    found = bures_wasserstein(means, same, means, same)
    assert np.abs(np.diagonal(found)).max() <= 1e-7
    gradients = jax.jit(jax.grad(lambda *both: bures_wasserstein(*both, *both).sum(), argnums=(0, 1)))(means, same)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


def test_distances_do_not_depend_on_the_frame_of_reference():
    rng = np.random.default_rng(12)
    means, shapes = rng.normal(size=(8, 3)), covariances(8, 1e3, 13)
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    moved_means, moved_shapes = means @ turn.T + shift, turn @ shapes @ turn.T
    np.testing.assert_allclose(
        bures_wasserstein(moved_means[:3], moved_shapes[:3], moved_means[3:], moved_shapes[3:]),
        bures_wasserstein(means[:3], shapes[:3], means[3:], shapes[3:]),
        rtol=1e-10,
    )
    np.testing.assert_allclose(euclidean(moved_means[:3], moved_means[3:]), euclidean(means[:3], means[3:]), rtol=1e-12)


def test_second_derivatives_of_the_bures_wasserstein_distance_are_an_error():
    random = np.random.default_rng(0)
    shapes = [covariances(3, 4, seed) for seed in (0, 1)]
    means = random.normal(size=(2, 3, 3))

    def total(scale):
        return bures_wasserstein(means[0], scale * shapes[0], means[1], shapes[1]).sum()

    expected = (total(1.3 + 1e-6) - total(1.3 - 1e-6)) / 2e-6
    np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(total)))(np.array([1.3])), [expected], rtol=1e-6)
    for second in (jax.grad(jax.grad(total)), jax.jacfwd(jax.jacfwd(total))):
        with pytest.raises(InputError, match="bures_wasserstein has no second derivatives"):
            second(1.3)
