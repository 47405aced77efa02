import functools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax.geometry import transformed
from gmmjax.scenes import family_scene
from gmmjax.scenes.families.earthworks import earthworks

scene_of = functools.cache(functools.partial(family_scene, "earthworks"))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number", "kind"), [(6, 0, "disappeared"), (10, 1, "appeared"), (12, 1, "appeared")])
def test_displaced_ground_is_a_change_at_both_its_heights(seed, number, kind):
    scene = scene_of(seed)
    assert scene.kinds[number] == kind
    before, after = (cloud[truth == number] for cloud, truth in zip(scene.clouds, scene.truth, strict=True))
    after = transformed(after, scene.registration)
    assert min(len(before), len(after)) > 40
    below = cKDTree(before[:, :2]).query(after[:, :2])[1]
    rise = np.median(after[:, 2] - before[below, 2]) / scene.unit
    assert 0.1 < (rise if kind == "appeared" else -rise) < 5


@pytest.mark.slow
def test_changes_are_apart_and_smaller_than_the_ground():
    for seed in (0, 9, 12):
        scene = scene_of(seed)
        for cloud, truth in zip(scene.clouds, scene.truth, strict=True):
            extent = np.ptp(cloud[:, :2], axis=0).max()
            places = [cloud[truth == number] for number in range(len(scene.kinds)) if (truth == number).sum() > 20]
            for one in range(len(places)):
                assert np.ptp(places[one][:, :2], axis=0).max() < 0.6 * extent
                for other in range(one):
                    assert cKDTree(places[one]).query(places[other])[0].min() > 0


@pytest.mark.slow
def test_a_scene_is_drawn_from_its_generator_alone():
    drawn = [earthworks(np.random.default_rng(3)) for _ in range(2)]
    for one, other in zip(drawn[0].clouds, drawn[1].clouds, strict=True):
        np.testing.assert_array_equal(one, other)
