import functools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax.geometry import transformed
from gmmjax.scenes import family_scene

SEEDS = range(7, 16)
scene_of = functools.cache(functools.partial(family_scene, "tabletop"))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_camera_stands_near_the_table(seed):
    scene = scene_of(seed)
    for cloud, views in zip(scene.clouds, scene.views, strict=True):
        nearest = cKDTree(cloud).query(views.poses[:, :3, 3])[0] / scene.unit
        assert 1 <= len(views) <= 3 and (nearest > 0.25).all() and (nearest < 1.6).all()


def test_what_came_or_went_lies_apart_from_the_other_cloud():
    apart = []
    for scene in map(scene_of, SEEDS):
        registered = transformed(scene.clouds.after, scene.registration)
        for kind, side, own, other in (
            ("disappeared", "before", scene.clouds.before, registered),
            ("appeared", "after", registered, scene.clouds.before),
        ):
            distance, truth = cKDTree(other).query(own)[0], getattr(scene.truth, side)
            usual = np.median(distance[(truth == -1) & ~getattr(scene.unseen, side)])
            counted = set(range(len(scene.kinds))) - getattr(scene.uncounted, side)
            numbers = [number for number in counted if scene.kinds[number] == kind]
            apart += [np.median(distance[truth == number]) / usual for number in numbers]
    # One thing in the place of another may lie on its surface, in part.
    assert len(apart) >= 4 and np.median(apart) > 3 and min(apart) > 0.9


def test_some_scenes_are_one_frame_split_in_two():
    still = [scene for scene in map(scene_of, SEEDS) if np.allclose(scene.registration, np.eye(4))]
    assert still and len(still) < len(SEEDS)
    for scene in still:
        np.testing.assert_array_equal(scene.views.before.poses, scene.views.after.poses)
        assert len(scene.views.before) == 1
