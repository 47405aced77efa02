import dataclasses

import pytest

from gmmjax import DetectionConfig, InputError


def test_round_trip():
    config = DetectionConfig(method="transport", voxel_size=0.02, seed=7)
    assert DetectionConfig.from_dict(config.to_dict()) == config
    assert "noise_floor" not in config.to_dict()


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
        (dict(max_points=10), "max_points=10"),
        (dict(max_components=0), "max_components=0"),
        (dict(voxel_size=-0.1), "voxel_size=-0.1"),
        (dict(voxel_size="1 cm"), "voxel_size='1 cm'"),
        (dict(noise_floor=float("nan")), "noise_floor=nan"),
        (dict(crop=(0, 0, 0)), "crop=.*six numbers"),
        (dict(crop=(0, 0, 0, 1, 1, 0)), "lower corner must be below"),
        (dict(threshold=1.5), "threshold=1.5"),
        (dict(evidence=1), "evidence=1"),
    ],
)
def test_bad_settings_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        as_users_have_it(settings)
