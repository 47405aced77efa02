import functools

import numpy as np
import pytest

from gmmjax.scenes import family_scene
from gmmjax.scenes.families.staging import Support, top_of
from gmmjax.scenes.families.things import footprint, height, rack, rod

RANDOM = np.random.default_rng(0)
scene_of = functools.cache(functools.partial(family_scene, "depots"))


def test_rods_lie_on_the_floor():
    for thing in (rod(RANDOM) for _ in range(20)):
        lowest = min(float(solid.centre[2] - (np.abs(solid.rotation) @ solid.extent)[2] / 2) for solid in thing)
        assert lowest == pytest.approx(0, abs=1e-12)
        assert height(thing) <= 0.26 and 0.4 <= footprint(thing) <= 2.5


def test_goods_fit_between_the_decks_of_a_rack():
    levels = 3
    thing = rack(RANDOM, levels)
    decks = [top_of(deck) for deck in thing[:levels]]
    heights = [deck.middle[2, 3] for deck in decks]
    assert np.diff(heights) == pytest.approx(heights[0], abs=0.05) and height(thing) >= heights[-1]
    assert all(isinstance(deck, Support) and deck.size == decks[0].size for deck in decks)


def test_what_changes_stands_on_the_floor_and_in_the_racks():
    lowest = []
    for scene in (scene_of(seed) for seed in (0, 3)):
        # A camera's y axis is down.
        above = -scene.clouds.before @ scene.views.before.poses[0, :3, 1] / scene.unit
        changes = np.unique(scene.truth.before[scene.truth.before >= 0])
        lowest += [above[scene.truth.before == number].min() - np.percentile(above, 1) for number in changes]
    assert min(lowest) < 0.1 and max(lowest) > 0.7
