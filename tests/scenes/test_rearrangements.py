import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax.geometry import transformed
from gmmjax.scenes import RearrangementSettings, rearranged_scene

FEW = RearrangementSettings(pixels=(32, 24), frames=8)


@pytest.mark.slow
@pytest.mark.parametrize("gravity", ["floor", "none"])
@pytest.mark.parametrize("in_place", ["turned", "shifted", "door", "drawer"])
def test_the_motion_takes_a_thing_from_before_to_after(gravity, in_place):
    scene = rearranged_scene(2, gravity, appeared=1, disappeared=1, moved=1, in_place=in_place, settings=FEW)
    assert set(scene.motions) == {2, 3}
    for number, motion in scene.motions.items():
        before, after = (cloud[truth == number] for cloud, truth in zip(scene.clouds, scene.truth, strict=True))
        if not len(after) or not len(before):
            continue
        assert np.quantile(cKDTree(after).query(transformed(before, motion))[0], 0.1) < 0.05
        np.testing.assert_allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-9)
    assert (scene.truth.before != 1).all() and (scene.truth.after != 0).all()


def test_a_thing_that_was_replaced_is_two_changes():
    scene = rearranged_scene(2, moved=0, in_place="replaced", settings=FEW)
    assert set(np.unique(scene.truth.before)) == {-1, 0} and set(np.unique(scene.truth.after)) == {-1, 1}
    assert not scene.motions


def test_the_same_seed_gives_the_same_scene():
    first, again, other = (rearranged_scene(seed, "none", settings=FEW) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.clouds.after, again.clouds.after)
    assert first.clouds.after.shape != other.clouds.after.shape
