import functools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax.geometry import transformed
from gmmjax.scenes import family_scene

SEEDS = range(4)
scene_of = functools.cache(functools.partial(family_scene, "terrain"))


@pytest.mark.parametrize("seed", SEEDS)
def test_ground_that_stays_lies_on_itself(seed):
    scene = scene_of(seed)
    stays = (scene.truth.before == -1) & ~scene.unseen.before
    tree = cKDTree(transformed(scene.clouds.after, scene.registration))
    spacing = np.median(tree.query(tree.data[::20], k=2)[0][:, 1])
    assert np.median(tree.query(scene.clouds.before[stays])[0]) < 3 * spacing


def test_slopes_have_the_lengths_and_changes_of_slopes():
    kinds = set()
    for scene in map(scene_of, SEEDS):
        low, high = np.percentile(scene.clouds.before / scene.unit, [1, 99], axis=0)
        assert 15 < np.max(high - low) < 250
        kinds |= set(scene.kinds)
    assert kinds & {"appeared", "disappeared"}
