import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.evaluation import family_sources
from gmmjax.scenes import family_scene


def test_every_family_and_seed_is_a_source():
    sources = family_sources(["rooms", "kitchens"], [3, 4], poses="unknown")
    assert [(source.condition, source.name) for source in sources] == [
        ("rooms", "seed 3"), ("rooms", "seed 4"), ("kitchens", "seed 3"), ("kitchens", "seed 4"),
    ]  # fmt: skip
    assert {source.group for source in sources} == {"poses unknown"}


@pytest.mark.parametrize("poses", ["given", "unknown"])
def test_a_pair_is_its_scene(poses):
    pair, scene = family_sources(["rooms"], [2], poses=poses)[0].load(), family_scene("rooms", 2)
    for cloud, points, truth, unseen, uncounted in zip(
        (pair.before, pair.after), scene.clouds, scene.truth, scene.unseen, scene.uncounted, strict=True
    ):
        np.testing.assert_array_equal(cloud.points, points)
        np.testing.assert_array_equal(cloud.truth, truth)
        np.testing.assert_array_equal(cloud.unseen, unseen)
        assert cloud.not_counted == uncounted
        assert (cloud.views is not None) == (poses == "given")


def test_an_unknown_family_is_refused():
    with pytest.raises(InputError, match="family='cellars' is unknown; choose from rooms"):
        family_sources(["cellars"], [0])
