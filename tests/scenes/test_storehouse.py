import numpy as np
import pytest

from gmmjax.geometry import transformed
from gmmjax.pair import each
from gmmjax.scenes import StorehouseSettings, storehouse

SMALL = StorehouseSettings(points=12_000, rays=20_000)


@pytest.fixture(scope="module")
def colored():
    return storehouse(0, SMALL)


def test_each_kind_of_change_is_there_and_can_be_seen(colored):
    scene = colored.scene
    assert sorted(scene.kinds) == ["appeared", "appeared", "disappeared", "disappeared", "moved", "moved"]
    assert all(not numbers for numbers in scene.uncounted)
    assert all(10_000 < len(points) < 14_000 for points in scene.clouds)


def test_the_motion_of_what_moved_takes_its_points_to_where_they_are_later(colored):
    scene = colored.scene
    for number, motion in scene.motions.items():
        before, after = each(lambda points, truth, number=number: points[truth == number], scene.clouds, scene.truth)
        low, high = after.min(axis=0) - 0.1, after.max(axis=0) + 0.1
        moved = transformed(before, motion)
        assert ((moved > low) & (moved < high)).all(axis=1).mean() > 0.95


def test_things_have_colours_of_their_own(colored):
    scene = colored.scene
    drum, pallet = (
        colors[truth == number].mean(axis=0)
        for colors, truth, number in (
            (colored.colors.before, scene.truth.before, 2),
            (colored.colors.after, scene.truth.after, 0),
        )
    )
    assert drum[2] > drum[0] + 40
    assert pallet[0] > pallet[2] + 40


def test_a_seed_says_all(colored):
    again = storehouse(0, SMALL)
    np.testing.assert_array_equal(again.scene.clouds.after, colored.scene.clouds.after)
    np.testing.assert_array_equal(again.colors.after, colored.colors.after)
    other = storehouse(1, SMALL)
    assert other.scene.clouds.before.shape != colored.scene.clouds.before.shape
