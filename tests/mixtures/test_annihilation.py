import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.mixtures import FitSettings, FitStatus, Prior, WeightedPoints, fit_by_annihilation, initial_mixture
from gmmjax.scenes import fixed_scene, random_scene
from tests.mixtures.examples import assert_mixtures_close, weighted

PRIOR = Prior.figueiredo_jain(3, 1e-3)


@functools.partial(jax.jit, static_argnames="settings")
def fit(points, key, prior=PRIOR, settings=FitSettings()):
    return fit_by_annihilation(points, initial_mixture(points, 25, prior, key), prior, settings)


def scene_points(scene):
    points = scene.after
    return weighted((points - points.mean(axis=0)) / points.std())


@pytest.mark.parametrize("seed", range(3))
def test_finds_the_number_of_gaussians(float64, seed):
    """Five random Gaussians, of which some overlap, and the seven of the thesis's fixed scene; as many points."""
    random = random_scene(jax.random.key(seed), appeared=0, overlap="medium", points=700)
    assert fit(scene_points(random), jax.random.key(seed)).mixture.count == 5
    fixed = fixed_scene(jax.random.key(seed), points=500)
    assert fit(scene_points(fixed), jax.random.key(seed)).mixture.count == 7


@pytest.mark.slow
def test_joint_step_equals_the_component_wise_sweep_on_overlapping_scenes(float64):
    """The same number of components and the message length within 0.1, where Gaussians lie in one another."""
    for seed in range(4):
        scene = random_scene(jax.random.key(100 + seed), start=6, overlap="medium", points=250)
        points = scene_points(scene)
        best = {}
        for step in ("joint", "component-wise"):
            fits = [fit(points, jax.random.key(restart), settings=FitSettings(step=step)) for restart in range(2)]
            best[step] = min(fits, key=lambda fit: float(fit.message_length))
        joint, component_wise = best["joint"], best["component-wise"]
        assert joint.mixture.count == component_wise.mixture.count
        assert abs(joint.message_length - component_wise.message_length) < 0.1


@pytest.mark.slow
def test_vmap_over_keys_and_clouds_equals_a_loop(float64):
    clouds = [scene_points(random_scene(jax.random.key(seed), appeared=0, points=100)) for seed in range(2)]
    keys = jax.random.split(jax.random.key(0), 2)
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *clouds)
    batch = jax.vmap(lambda points: jax.vmap(lambda key: fit(points, key))(keys))(stacked)
    for i, points in enumerate(clouds):
        for j, key in enumerate(keys):
            single = fit(points, key)
            assert_mixtures_close(jax.tree.map(lambda leaf, i=i, j=j: leaf[i, j], batch.mixture), single.mixture)
            np.testing.assert_allclose(batch.message_length[i, j], single.message_length, atol=1e-6)
            assert jax.tree.map(lambda leaf, i=i, j=j: leaf[i, j], batch.result) == single.result


def test_padding_changes_nothing(float64):
    points = scene_points(random_scene(jax.random.key(0), appeared=0, points=100))
    padded = WeightedPoints(
        np.concatenate([points.points, np.full((100, 3), 7.0)]), np.concatenate([points.mass, np.zeros(100)])
    )
    bare, of_padded = fit(points, jax.random.key(1)), fit(padded, jax.random.key(1))
    assert_mixtures_close(of_padded.mixture, bare.mixture)
    assert of_padded.steps == bare.steps


@pytest.mark.slow
def test_mixture_is_at_rest_where_it_says_so(float64):
    """Another EM step gains no more than the tolerance; the weights sum to 1; dead slots hold their constants."""
    points = scene_points(random_scene(jax.random.key(0), appeared=0, points=100))
    result = fit(points, jax.random.key(0))
    assert result.result == FitStatus.converged
    log_likelihood = points.mass @ np.asarray(result.mixture.log_density(points.points))
    np.testing.assert_allclose(result.log_likelihood, log_likelihood, rtol=1e-9)
    dead = ~result.mixture.live
    np.testing.assert_allclose(result.mixture.weights.sum(), 1)
    assert (result.mixture.means[dead] == 0).all() and (result.mixture.weights[dead] == 0).all()
    assert (result.mixture.covariances[dead] == jnp.eye(3)[None]).all()


@pytest.mark.slow
def test_settings_are_kept(float64):
    points = scene_points(random_scene(jax.random.key(0), appeared=0, points=100))
    for step in ("joint", "component-wise"):
        settings = FitSettings(min_components=9, step=step)
        assert fit(points, jax.random.key(0), settings=settings).mixture.count == 9
    hurried = fit(points, jax.random.key(0), settings=FitSettings(max_steps=1))
    assert hurried.result == FitStatus.step_limit
    patient = fit(points, jax.random.key(0))
    impatient = fit(points, jax.random.key(0), settings=FitSettings(patience=20.0 / len(points.mass)))
    assert impatient.steps < patient.steps
    assert_mixtures_close(impatient.mixture, patient.mixture)


def test_singular_covariances_are_a_status_for_each_lane(float64):
    """On a plane without a noise floor the likelihood has no maximum; the lane beside it is not touched."""
    points = scene_points(random_scene(jax.random.key(0), appeared=0, points=100))
    flat = WeightedPoints(points.points * np.array([[1, 1, 0]]), points.mass)
    prior = Prior.figueiredo_jain(3, 0.0)
    batch = jax.vmap(lambda points: fit(points, jax.random.key(0), prior))(
        jax.tree.map(lambda *leaves: np.stack(leaves), flat, points)
    )
    np.testing.assert_array_equal(batch.result == FitStatus.not_finite, [True, False])
    np.testing.assert_array_equal(np.isnan(batch.mixture.means).all(axis=(1, 2)), [True, False])
    assert np.isfinite(batch.mixture.means[1]).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (dict(step="component-wise", covariance_type="tied"), "tied.*joint"),
        (dict(min_components=0), "min_components=0"),
        (dict(max_steps=0), "max_steps=0"),
        (dict(tolerance=-1.0), "tolerance=-1"),
        (dict(patience=float("nan")), "patience=nan"),
    ],
)
def test_bad_settings_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        FitSettings(**settings)
