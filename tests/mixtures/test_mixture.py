import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.mixtures import GaussianMixture
from tests.mixtures.examples import cloud, pad, random_mixture, random_rotation, scipy_log_joint


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3, 6])
def test_densities_equal_scipy(float64, dimension):
    mixture, points = random_mixture(dimension=dimension, slots=6), cloud(dimension)
    expected = scipy_log_joint(mixture, points)
    np.testing.assert_allclose(mixture.log_joint(points)[:, :4], expected, rtol=1e-10)
    np.testing.assert_allclose(mixture.log_density(points), scipy.special.logsumexp(expected, axis=1), rtol=1e-10)
    np.testing.assert_allclose(
        mixture.responsibilities(points)[:, :4], scipy.special.softmax(expected, axis=1), atol=1e-12
    )
    np.testing.assert_array_equal(mixture.labels(points), expected.argmax(axis=1))


@pytest.mark.slow
@given(seed=st.integers(0, 10**6))
def test_dead_slots_have_no_influence(seed):
    with jax.enable_x64(True):
        mixture, points = random_mixture(seed=seed), cloud(seed=seed)
        padded = pad(mixture, 6)
        np.testing.assert_allclose(padded.log_density(points), mixture.log_density(points), rtol=1e-12)
        responsibilities = np.asarray(padded.responsibilities(points))
        assert (responsibilities[:, 4:] == 0).all()
        np.testing.assert_allclose(responsibilities.sum(axis=1), 1, rtol=1e-12)


@given(seed=st.integers(0, 10**6))
def test_permuting_components_permutes_labels(seed):
    with jax.enable_x64(True):
        mixture, points = random_mixture(seed=seed), cloud(seed=seed)
        order = np.random.default_rng(seed).permutation(4)
        permuted = jax.tree.map(lambda leaf: leaf[order], mixture)
        np.testing.assert_array_equal(order[permuted.labels(points)], mixture.labels(points))


@given(seed=st.integers(0, 10**6), scale=st.floats(1e-3, 1e3))
def test_densities_follow_a_change_of_unit_and_origin(seed, scale):
    with jax.enable_x64(True):
        mixture, points = random_mixture(seed=seed, slots=6), cloud(seed=seed)
        shift = np.array([1.0, -2.0, 3.0])
        moved = mixture.rescaled(scale, shift)
        expected = mixture.log_density(points) - 3 * np.log(scale)
        np.testing.assert_allclose(moved.log_density(scale * points + shift), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("scale", [1e-40, 1e-9, 1e40])
def test_a_change_of_unit_keeps_the_digits_of_the_covariances(float64, scale):
    mixture = jax.tree.map(np.asarray, random_mixture(slots=5))
    moved = mixture.rescaled(scale, np.zeros(3))
    live = mixture.live
    np.testing.assert_allclose(moved.covariances[live], scale**2 * mixture.covariances[live], rtol=1e-12)
    np.testing.assert_array_equal(moved.covariances[~live], mixture.covariances[~live])


def test_rotating_points_and_mixture_changes_no_density(float64):
    mixture, points, rotation = random_mixture(), cloud(), random_rotation()
    rotated = GaussianMixture(
        mixture.weights, mixture.means @ rotation.T, rotation @ mixture.covariances @ rotation.T, mixture.live
    )
    np.testing.assert_allclose(rotated.log_density(points @ rotation.T), mixture.log_density(points), rtol=1e-10)


@pytest.mark.slow
def test_methods_of_what_the_host_returns_compute_in_float64():
    """JAX's default is float32 here. Survey coordinates keep their digits; points may be JAX's."""
    mixture, points, offset = random_mixture(slots=6), cloud(), np.array([1e6, -2e6, 3e6])
    expected = scipy.special.logsumexp(scipy_log_joint(mixture, points), axis=1)
    np.testing.assert_allclose(mixture.log_density(points), expected, rtol=1e-12)
    far = mixture.rescaled(1.0, offset).log_density(points + offset)
    np.testing.assert_allclose(far, expected, rtol=0, atol=1e-7)
    answers = mixture.log_joint(points), mixture.responsibilities(points), mixture.log_density(jnp.asarray(points))
    answers += mixture.sample(jax.random.key(0), 3), mixture.compacted(4).covariances
    assert {(type(answer), answer.dtype) for answer in answers} == {(np.ndarray, np.dtype(np.float64))}


def test_traced_points_are_computed_with_in_their_own_precision():
    """By a mixture of the host that traced code closes over, too."""
    mixture, points = random_mixture(), cloud()
    density = jax.jit(lambda own: mixture.log_density(own))(jnp.asarray(points))
    assert density.dtype == np.float32
    np.testing.assert_allclose(density, mixture.log_density(points), rtol=5e-4, atol=5e-4)


@pytest.mark.slow
def test_sample_has_the_moments_of_the_mixture(float64):
    mixture = random_mixture(slots=6)
    points = np.asarray(mixture.sample(jax.random.key(0), 200_000))
    mean = mixture.weights @ mixture.means
    deviations = mixture.means - mean
    covariance = np.einsum("k,kij->ij", mixture.weights, mixture.covariances)
    covariance += np.einsum("k,ki,kj->ij", mixture.weights, deviations, deviations)
    np.testing.assert_allclose(points.mean(axis=0), mean, atol=0.03)
    np.testing.assert_allclose(np.cov(points.T), covariance, atol=0.06)


@pytest.mark.slow
def test_compacting_keeps_the_mixture(float64):
    mixture, points = random_mixture(components=4, slots=9), cloud()
    shuffled = jax.tree.map(lambda leaf: leaf[np.array([5, 0, 7, 1, 8, 2, 3, 4, 6])], mixture)
    compacted = shuffled.compacted(5)
    assert compacted.means.shape == (5, 3) and int(compacted.count) == 4
    np.testing.assert_allclose(compacted.log_density(points), mixture.log_density(points), rtol=1e-12)
    assert shuffled.live_part().means.shape == (4, 3)
