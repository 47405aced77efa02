import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.evaluation import CONDITIONS, family_sources, laboratory_pair, laboratory_sources
from gmmjax.scenes import family_scene


def test_every_condition_has_its_scenes():
    sources = laboratory_sources([4, 5], level="hard", poses="unknown")
    assert len(sources) == 2 * len(CONDITIONS) == 18
    assert {source.group for source in sources} == {"hard panorama, poses unknown"}


@pytest.mark.parametrize(("condition", "before", "after"), [("(-1 +1)", 1, 1), ("(moved)", 1, 1), ("(none)", 0, 0)])
def test_scenes_are_what_their_condition_says(condition, before, after):
    poses = "unknown" if condition == "(none)" else "given"
    pair = laboratory_pair(condition, 1, "normal", "frame", poses)
    assert (pair.before.views is None) == (pair.after.views is None) == (poses == "unknown")
    assert len(np.unique(pair.before.truth)) - 1 == before and len(np.unique(pair.after.truth)) - 1 == after
    assert pair.unchanged == (condition == "(none)")
    assert set(pair.before.truth) - {-1} == set(pair.after.truth) - {-1} or condition != "(moved)"
    assert pair.before.unseen is not None and pair.before.not_counted == frozenset()


def test_every_family_and_seed_is_a_source():
    sources = family_sources(["rooms", "kitchens"], [3, 4], poses="unknown")
    assert [(source.condition, source.name) for source in sources] == [
        ("rooms", "seed 3"), ("rooms", "seed 4"), ("kitchens", "seed 3"), ("kitchens", "seed 4"),
    ]  # fmt: skip
    assert {source.group for source in sources} == {"poses unknown"}


@pytest.mark.parametrize("poses", ["given", "unknown"])
def test_a_pair_is_its_scene(poses):
    pair, scene = family_sources(["yards"], [1], poses=poses)[0].load(), family_scene("yards", 1)
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
