import functools

import numpy as np
import pytest

from gmmjax.scenes import family_scene
from gmmjax.scenes.families.things import footprint, height, rack, rod

scene_of = functools.cache(functools.partial(family_scene, "depots"))


def test_rods_lie_on_the_floor():
    random = np.random.default_rng(0)
    for thing in (rod(random) for _ in range(20)):
        lowest = min(float(solid.centre[2] - (np.abs(solid.rotation) @ solid.extent)[2] / 2) for solid in thing)
        assert lowest == pytest.approx(0, abs=1e-12)
        assert height(thing) <= 0.26 and 0.4 <= footprint(thing) <= 2.5


@pytest.mark.parametrize("levels", [1, 3])
def test_the_first_solids_of_a_rack_are_its_decks_from_the_lowest_on(levels):
    thing = rack(np.random.default_rng(0), levels)
    decks, others = thing[:levels], thing[levels:]
    step = decks[0].centre[2]
    np.testing.assert_allclose([deck.centre[2] for deck in decks], step * np.arange(1, levels + 1), atol=0.05)
    # Boards as wide as the rack; of beams and posts none is both wide and deep.
    assert all(min(deck.extent[:2]) > 0.7 for deck in decks)
    assert all(min(own.extent[:2]) < 0.1 for own in others)
    assert height(thing) > decks[-1].centre[2]


@pytest.mark.slow
def test_what_changes_stands_on_the_floor_and_in_the_racks():
    lowest = []
    for scene in (scene_of(seed) for seed in (0, 3)):
        # A camera's y axis is down.
        above = -scene.clouds.before @ scene.views.before.poses[0, :3, 1] / scene.unit
        changes = np.unique(scene.truth.before[scene.truth.before >= 0])
        lowest += [above[scene.truth.before == number].min() - np.percentile(above, 1) for number in changes]
    assert min(lowest) < 0.1 and max(lowest) > 0.7
