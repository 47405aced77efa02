import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.comparison import unmatched_shares
from gmmjax.comparison.unmatched_mass import default_penalty, matched_density_ratio
from gmmjax.scenes import random_scene
from tests.mixtures.examples import pad


@jax.jit
def shares(before, after, points_before, points_after):
    return unmatched_shares(before, after, points_before, points_after)


def mixtures(seed=1, **changes):
    scene = random_scene(jax.random.key(seed), points=1, **changes)
    return pad(scene.mixture_before, 8), pad(scene.mixture_after, 8)


def test_appearances_and_disappearances_are_found_together(float64):
    before, after = mixtures(appeared=2, disappeared=1)
    result = shares(before, after, 5000.0, 6000.0)
    np.testing.assert_allclose(result.share_before, [1, 0, 0, 0, 0, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(result.share_after, [0, 0, 0, 0, 1, 1, 0, 0], atol=1e-9)
    assert result.valid


def test_equal_clouds_have_no_unmatched_mass(float64):
    before, _ = mixtures(appeared=0)
    result = shares(before, before, 5000.0, 5000.0)
    np.testing.assert_allclose(result.share_before, 0, atol=1e-9)


def test_different_densities_of_sampling_are_no_change(float64):
    """The after cloud has 0.4 times the points everywhere."""
    before, after = mixtures(appeared=1)
    result = shares(before, after, 5000.0, 0.4 * 6000.0)
    np.testing.assert_allclose(result.density_ratio, 0.4, rtol=1e-9)
    np.testing.assert_allclose(result.share_after, [0, 0, 0, 0, 0, 1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(result.share_before, 0, atol=1e-9)


def test_a_gaussian_of_another_shape_in_the_same_place_is_no_counterpart(float64):
    before, _ = mixtures(appeared=0)
    stretched = jax.tree.map(np.copy, before)
    stretched.covariances[2] *= 16
    result = shares(before, stretched, 5000.0, 5000.0)
    np.testing.assert_array_equal(np.asarray(result.share_after) > 0.5, np.arange(8) == 2)
    np.testing.assert_array_equal(np.asarray(result.share_before) > 0.5, np.arange(8) == 2)


def test_unit_of_length_does_not_matter(float64):
    before, after = mixtures(appeared=1, disappeared=1)
    millimetres = [mixture.rescaled(1000.0, np.zeros(3)) for mixture in (before, after)]
    metres = shares(before, after, 5000.0, 5000.0)
    np.testing.assert_allclose(shares(*millimetres, 5000.0, 5000.0).share_after, metres.share_after, atol=1e-9)
    np.testing.assert_allclose(default_penalty(*millimetres), 1000 * default_penalty(before, after))


def test_density_ratio_without_a_pair_is_one(float64):
    assert matched_density_ratio(np.zeros(3), np.array([1.0, 2.0, 0.0]), np.ones((3, 3))) == 1


@pytest.mark.slow
def test_smooth_shares_can_be_differentiated_by_the_penalty_alone(float64):
    before, after = mixtures(appeared=1, disappeared=1)

    @jax.jit
    def appeared(penalty):
        smooth = unmatched_shares(before, after, 5000.0, 5000.0, penalty, temperature=0.3)
        return jnp.sum(smooth.share_after**2)

    central = (appeared(0.501) - appeared(0.499)) / 0.002
    np.testing.assert_allclose(jax.grad(appeared)(0.5), central, rtol=1e-4)
