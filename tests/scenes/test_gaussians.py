import jax
import numpy as np
import pytest
import scipy.stats

from gmmjax import InputError
from gmmjax.scenes import fixed_scene, random_scene, replaced_scene

KEY = jax.random.key(3)


def test_the_fixed_scene_is_four_and_three_gaussians():
    scene = fixed_scene(KEY)
    assert scene.before.shape == (4000, 3) and scene.after.shape == (7000, 3)
    assert (scene.truth_before == -1).all()
    np.testing.assert_array_equal(
        np.unique(scene.truth_after, return_counts=True), [[-1, 0, 1, 2], [4000, 1000, 1000, 1000]]
    )


def test_two_of_the_added_gaussians_intersect_and_one_stands_apart():
    """Of the points nearest to an added Gaussian, by Mahalanobis distance below 2, some are of the first four."""
    scene = fixed_scene(KEY)
    old = scene.after[scene.truth_after == -1]
    inside = []
    for component in (4, 5, 6):
        deviations = old - scene.mixture_after.means[component]
        precision = np.linalg.inv(scene.mixture_after.covariances[component])
        inside.append((np.einsum("ni,ij,nj->n", deviations, precision, deviations) < 4).sum())
    assert inside[0] > 50 and inside[1] > 50 and inside[2] == 0


@pytest.mark.parametrize(("appeared", "disappeared"), [(0, 0), (2, 0), (0, 2), (1, 1), (3, 5)])
def test_random_scenes_hold_what_was_asked_for(appeared, disappeared):
    scene = random_scene(KEY, appeared=appeared, disappeared=disappeared, points=20)
    assert len(scene.before) == 5 * 20 and len(scene.after) == (5 - disappeared + appeared) * 20
    gone, new = set(scene.truth_before) - {-1}, set(scene.truth_after) - {-1}
    assert gone == set(range(disappeared)) and new == set(range(disappeared, disappeared + appeared))
    assert (np.bincount(scene.truth_before + 1, minlength=1)[1:] == 20).all()


def test_points_are_drawn_from_the_true_mixture():
    scene = random_scene(KEY, points=4000, overlap="medium")
    for component in range(5):
        own = scene.before[component * 4000 : (component + 1) * 4000]
        true_mean, true_covariance = scene.mixture_before.means[component], scene.mixture_before.covariances[component]
        np.testing.assert_allclose(own.mean(axis=0), true_mean, atol=0.03)
        whitened = np.linalg.solve(np.linalg.cholesky(true_covariance), (own - true_mean).T)
        assert scipy.stats.kstest((whitened**2).sum(axis=0), scipy.stats.chi2(3).cdf).pvalue > 1e-3


@pytest.mark.parametrize(("overlap", "half_width"), [("low", 4), ("medium", 2)])
def test_means_and_variances_lie_in_the_ranges_of_the_thesis(overlap, half_width):
    scenes = [random_scene(jax.random.key(seed), overlap=overlap, points=1) for seed in range(20)]
    means = np.concatenate([scene.mixture_after.means for scene in scenes])
    assert half_width / 2 < np.abs(means).max() <= half_width
    variances = np.linalg.eigvalsh(np.concatenate([scene.mixture_after.covariances for scene in scenes]))
    assert variances.min() >= 0.01 - 1e-12 and variances.max() <= 0.1 + 1e-12


def test_every_point_knows_its_gaussian():
    scene = random_scene(KEY, appeared=2, disappeared=1, points=30, density=2.0)
    assert np.bincount(scene.gaussians_before).tolist() == [30] * 5
    assert np.bincount(scene.gaussians_after).tolist() == [0] + [60] * 6
    np.testing.assert_array_equal(scene.gaussians_before == 0, scene.truth_before == 0)
    np.testing.assert_array_equal(scene.gaussians_after >= 5, scene.truth_after >= 1)


def test_a_scene_is_its_key():
    first, again = random_scene(KEY, points=5), random_scene(KEY, points=5)
    np.testing.assert_array_equal(first.after, again.after)
    assert (random_scene(jax.random.key(4), points=5).after != first.after).any()


def test_gaussians_that_stay_are_drawn_anew():
    scene = random_scene(KEY, points=5)
    assert not np.isin(scene.before, scene.after).any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(start=0), "start"),
        (dict(points=0), "points"),
        (dict(appeared=-1), "appeared"),
        (dict(disappeared=6), "disappeared=6"),
        (dict(disappeared=5, appeared=0), "no Gaussian"),
        (dict(density=0.0), "density=0.0"),
        (dict(shift=-0.1), "shift=-0.1"),
    ],
)
def test_scenes_that_cannot_be_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        random_scene(KEY, **arguments)


def test_a_new_gaussian_stands_near_the_place_of_the_one_that_is_gone():
    scenes = [replaced_scene(jax.random.key(seed), separation=0.5, points=20) for seed in range(5)]
    steps = []
    for scene in scenes:
        gone, new = scene.mixture_before.means[0], scene.mixture_after.means[-1]
        deviation = np.sqrt(np.trace(scene.mixture_before.covariances[0]) / 3)
        assert np.linalg.norm(new - gone) == pytest.approx(0.5 * deviation)
        assert not np.allclose(scene.mixture_after.covariances[-1], scene.mixture_before.covariances[0])
        np.testing.assert_array_equal(scene.mixture_before.means[1:], scene.mixture_after.means[:-1])
        assert set(scene.truth_before) == {-1, 0} and set(scene.truth_after) == {-1, 1}
        assert len(scene.before) == len(scene.after) == 100
        steps.append((new - gone) / np.linalg.norm(new - gone))
    assert np.linalg.matrix_rank(steps) == 3


@pytest.mark.parametrize("make", [random_scene, lambda key, **more: replaced_scene(key, separation=2.0, **more)])
def test_the_after_cloud_can_be_sparser_and_displaced(make):
    plain, sparse, shifted = (make(KEY, points=50, **more) for more in ({}, {"density": 0.4}, {"shift": 0.1}))
    assert len(sparse.before) == len(plain.before)
    assert len(sparse.after) == len(sparse.truth_after) == round(0.4 * len(plain.after))
    displacement = shifted.after[0] - plain.after[0]
    np.testing.assert_allclose(shifted.after, plain.after + displacement)
    np.testing.assert_allclose(shifted.mixture_after.means, plain.mixture_after.means + displacement)
    np.testing.assert_array_equal(shifted.before, plain.before)
    assert 0 < np.linalg.norm(displacement) < 0.5


def test_a_gaussian_cannot_be_replaced_at_no_distance():
    with pytest.raises(InputError, match=r"separation=-1\.0"):
        replaced_scene(KEY, separation=-1.0)
