import dataclasses
import inspect

import jax
import numpy as np
import pytest

from gmmjax import ComputationError, FitSettings, FitStatus, InputError, Prior, fit_mixture
from gmmjax.scenes import random_scene
from tests.mixtures.examples import random_rotation

KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def points(scene_points):
    return scene_points


@pytest.fixture(scope="module")
def fit(points):
    return fit_mixture(points, key=KEY, restarts=2)


def test_finds_the_gaussians_of_a_scene(points, fit):
    scene = random_scene(jax.random.key(5), appeared=0, points=200)
    assert fit.result == FitStatus.converged
    found = fit.mixture.live_part()
    distances = np.linalg.norm(found.means[:, None] - scene.mixture_before.means, axis=2)
    assert len(found.weights) == 5
    assert distances.min(axis=0).max() < 0.15
    assert found.means.dtype == np.float64 and isinstance(found.means, np.ndarray)


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_survey_coordinates_and_another_unit_change_only_the_scale(points, fit, precision):
    offset = np.array([1e6, -2e6, 3e5])
    moved = fit_mixture(1000 * points + offset, key=KEY, restarts=2, precision=precision)
    tolerance = 1e-6 if precision == "float64" else 2e-3
    assert moved.mixture.count == fit.mixture.count
    expected = fit.mixture.rescaled(1000.0, offset).live_part()
    found = moved.mixture.live_part()
    # In float32 other slots may win: components are compared in the order of their first coordinate.
    expected, found = (jax.tree.map(lambda leaf, m=m: leaf[np.argsort(m.means[:, 0])], m) for m in (expected, found))
    np.testing.assert_allclose(found.means - offset, expected.means - offset, atol=1000 * 3 * tolerance)
    np.testing.assert_allclose(found.weights, expected.weights, atol=tolerance)
    log_volume = 3 * len(points) * np.log(1000)
    expected_length = fit.message_length + log_volume
    np.testing.assert_allclose(moved.message_length, expected_length, atol=1e-4 if precision == "float64" else 10)
    labels = np.asarray(moved.mixture.labels(1000 * points + offset))
    same = np.asarray(fit.mixture.labels(points))
    assert len(set(zip(labels, same, strict=True))) <= 7  # five pairs, but for a point on a border


def test_rotating_the_cloud_rotates_the_mixture(points, fit):
    """k-means++ draws by distances, so that the same points are the seeds."""
    rotation = random_rotation()
    rotated = fit_mixture(points @ rotation.T, key=KEY, restarts=2)
    np.testing.assert_allclose(rotated.mixture.weights, fit.mixture.weights, atol=1e-6)
    np.testing.assert_allclose(rotated.mixture.means, fit.mixture.means @ rotation.T, atol=1e-5)


def test_points_without_mass_are_padding(points, fit):
    padded = np.concatenate([points, np.full((80, 3), 1.0)])
    mass = np.concatenate([np.ones(len(points)), np.zeros(80)])
    again = fit_mixture(padded, key=KEY, restarts=2, mass=mass)
    np.testing.assert_allclose(again.message_length, fit.message_length, atol=1e-6)


@pytest.mark.slow
def test_host_call_equals_the_traced_call(points):
    host = fit_mixture(points, key=KEY, max_components=12)
    with jax.enable_x64(True):
        traced = jax.jit(lambda points: fit_mixture(points, key=KEY, max_components=12))(points)
    np.testing.assert_allclose(traced.message_length, host.message_length, atol=1e-6)


def test_vmap_over_clouds_and_keys(points):
    clouds = np.stack([points, points[::-1]]).astype(np.float32)
    keys = jax.random.split(KEY, 2)
    fits = jax.jit(jax.vmap(lambda points, key: fit_mixture(points, key=key, max_components=12)))(clouds, keys)
    assert fits.mixture.means.shape == (2, 12, 3)
    np.testing.assert_array_equal(fits.mixture.count, 5)


def test_changes_no_jax_setting(points):
    fit_mixture(points, key=KEY, max_components=12)
    assert not jax.config.jax_enable_x64


@pytest.mark.parametrize("scale", [[1, 1, 0], [1, 0, 0]], ids=["plane", "line"])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_planes_and_lines_are_fitted(points, scale, precision):
    """Floors are planes."""
    flat = points * np.array(scale) + np.array([0, 0, 2.0])
    fit = fit_mixture(flat, key=KEY, precision=precision)
    assert fit.result != FitStatus.not_finite
    assert np.isfinite(fit.mixture.log_density(flat)).all()


def test_the_default_noise_floor_follows_the_unit(points):
    """Across a plane a Gaussian is as thick as the noise floor: a thousandth of the spread."""
    flat = points * np.array([1, 1, 0])
    spread = np.sqrt(flat.var(axis=0).mean())
    for unit in (1.0, 1000.0):
        covariances = fit_mixture(unit * flat, key=KEY).mixture.live_part().covariances
        np.testing.assert_allclose(np.sqrt(covariances[:, 2, 2]), 1e-3 * spread * unit, rtol=1e-6)


def test_noise_floor_is_in_the_unit_of_the_points(points):
    fit = fit_mixture(points, key=KEY, prior=Prior.figueiredo_jain(3, noise_floor=0.5))
    assert np.linalg.eigvalsh(fit.mixture.live_part().covariances).min() >= 0.25


@pytest.mark.slow
def test_position_and_colour(float64):
    """Six dimensions: two Gaussians in one place, told apart by their colour."""
    random = np.random.default_rng(0)
    points = np.concatenate([random.normal(0, 0.3, (400, 3)), random.normal(0, 0.05, (400, 3))], axis=1)
    points[200:, 3:] += np.array([0.8, 0.0, 0.4])
    fit = fit_mixture(points, key=KEY, max_components=8)
    assert fit.mixture.count == 2
    labels = np.asarray(fit.mixture.labels(points))
    assert len(set(labels[:200])) == 1 and len(set(labels[200:])) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(points=np.zeros((50, 3))), "all points are equal"),
        (dict(points=np.ones((5, 3))), "9 parameters"),
        (dict(points=np.zeros(30)), r"shape \[n, d\]"),
        (dict(points=np.where(np.arange(150).reshape(50, 3) == 7, np.nan, 1.0)), "1 rows with NaN"),
        (dict(mass=np.ones(3)), "one value a point"),
        (dict(mass=-np.ones(1000)), "not negative"),
        (dict(max_components=1001), "max_components=1001.*1000"),
        (dict(max_components=0), "max_components=0"),
        (dict(restarts=0), "restarts=0"),
        (dict(method="magic"), "method='magic'.*grid"),
        (dict(precision="float16"), "precision='float16'"),
    ],
)
def test_bad_input_is_named(points, change, message):
    unchecked = inspect.unwrap(fit_mixture)  # as users have it, without the tests' type checks
    with pytest.raises(InputError, match=message):
        unchecked(**{"points": points, "key": KEY, **change})


def test_failure_is_raised_once_or_returned(points):
    flat = points * np.array([1, 1, 0])
    arguments = dict(key=KEY, prior=Prior.figueiredo_jain(3, 0.0), restarts=2)
    with pytest.raises(ComputationError, match=r"none of 2 restarts.*noise_floor"):
        fit_mixture(flat, **arguments)
    fit = fit_mixture(flat, **arguments, throw=False)
    assert fit.result == FitStatus.not_finite


def test_covariance_types(points):
    diagonal = fit_mixture(points, key=KEY, max_components=12, settings=FitSettings(covariance_type="diagonal"))
    covariances = diagonal.mixture.live_part().covariances
    assert (covariances[:, ~np.eye(3, dtype=bool)] == 0).all()


@pytest.mark.parametrize(
    ("leaf", "value"),
    [
        ("noise_floor", -0.1),
        ("tolerance", np.nan),
        ("degrees_of_freedom", -1.0),
        ("concentration", np.inf),
        ("noise_share", 1.0),
        ("mean", np.zeros(2)),
    ],
)
def test_a_prior_outside_of_its_domain_is_named(leaf, value):
    prior = dataclasses.replace(Prior.figueiredo_jain(3, 0.1), **{leaf: value})
    with pytest.raises(InputError, match=f"prior.{leaf}="):
        fit_mixture(np.random.default_rng(0).normal(size=(100, 3)), key=jax.random.key(0), prior=prior)
