import dataclasses

import jax
import jax.numpy as jnp
import pytest

from gmmjax import DetectionConfig, InputError, detect_changes
from gmmjax.scenes import random_scene
from gmmjax.tuning import joint_prior


def test_round_trip():
    config = DetectionConfig(method="transport", voxel_size=0.02, seed=7)
    assert DetectionConfig.from_dict(config.to_dict()) == config
    assert "noise_floor" not in config.to_dict()


def test_what_is_set_stands_over_what_was_derived():
    derived = joint_prior(0.003, 0.02)
    assert DetectionConfig().over(derived) == derived
    settings = dict(
        noise_floor=0.1,
        tolerance=0.2,
        concentration=-7.0,
        covariance_scale=0.3,
        degrees_of_freedom=4.0,
        noise_share=0.05,
    )
    prior = DetectionConfig(**settings).over(derived)
    assert (prior.noise_floor, prior.tolerance, prior.concentration) == (0.1, 0.2, -7.0)
    assert (prior.scale, prior.degrees_of_freedom, prior.noise_share) == (0.3, 4.0, 0.05)
    # The share is fixed: no number of points moves it.
    assert float(prior.noise_weight(jnp.asarray(5000.0), jnp.asarray(100.0))) == pytest.approx(0.05, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["joint", "greedy"])
def test_the_settings_of_the_prior_reach_the_fits(method):
    scene = random_scene(jax.random.key(11), appeared=1, disappeared=1, points=250)
    common = DetectionConfig(method=method, restarts=2)
    # Of which no Gaussian of 250 points may stay but the last.
    strict = dataclasses.replace(common, concentration=-400.0)
    few, many = (detect_changes(scene.before, scene.after, config=own).items for own in (strict, common))
    assert len(few) < len(many)


def as_users_have_it(settings):
    """The config without the tests' own type checks, which would be first to refuse."""
    config = object.__new__(DetectionConfig)
    for name, value in (dataclasses.asdict(DetectionConfig()) | settings).items():
        object.__setattr__(config, name, value)
    config.__post_init__()


def test_unknown_settings_are_named_with_the_known_ones():
    with pytest.raises(InputError, match=r"colour; known are .*voxel_size"):
        DetectionConfig.from_dict({"colour": "red"})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (dict(method="magic"), "method='magic'.*greedy, transport"),
        (dict(kinds="moved"), "kinds='moved'"),
        (dict(restarts=0), "restarts=0"),
        (dict(restarts=True), "restarts=True"),
        (dict(restarts="many"), "restarts='many'"),
        (dict(seed=-1), "seed=-1"),
        (dict(seed=10**30), "seed=10+ must be a whole number .* below 2"),
        (dict(restarts=10**400), "restarts=10+[.]{3}0+ must be"),
        (dict(seed=10**5000), "seed=a number of thousands of digits"),
        (dict(max_points=10), "max_points=10"),
        (dict(max_components=0), "max_components=0"),
        (dict(voxel_size=-0.1), "voxel_size=-0.1"),
        (dict(voxel_size="1 cm"), "voxel_size='1 cm'"),
        (dict(voxel_size=10**400), "voxel_size=10+[.]{3}0+ must be a positive number"),
        (dict(noise_floor=float("nan")), "noise_floor=nan"),
        (dict(crop=(0, 0, 0, 1, 1, 10**400)), "crop=.*six finite numbers"),
        (dict(crop=(0, 0, 0)), "crop=.*six finite numbers"),
        (dict(crop=(0, 0, 0, 1, 1, 0)), "lower corner must be below"),
        (dict(threshold=1.5), "threshold=1.5"),
        (dict(evidence=1), "evidence=1"),
        (dict(recognise_stations="no"), "recognise_stations='no'"),
        (dict(concentration=1.0), "concentration=1.0.*below 1"),
        (dict(concentration="low"), "concentration='low'"),
        (dict(noise_share=-0.1), "noise_share=-0.1"),
        (dict(noise_share=float("nan")), "noise_share=nan"),
        (dict(covariance_scale=0.1), "go together"),
        (dict(covariance_scale=0.1, degrees_of_freedom=0.0), "degrees_of_freedom=0.0"),
    ],
)
def test_bad_settings_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        as_users_have_it(settings)
