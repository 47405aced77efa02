import functools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax.geometry import transformed
from gmmjax.scenes import family_scene

SEEDS = range(10)
scene_of = functools.cache(functools.partial(family_scene, "doors"))


def degrees(rotation):
    return np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))


def true_motions(scene):
    """Of the moved things in the frame of the before cloud, metres."""
    for motion in scene.motions.values():
        own = scene.registration @ motion
        yield np.block([[own[:3, :3], own[:3, 3:] / scene.unit], [np.array([[0.0, 0.0, 0.0, 1.0]])]])


def test_leaves_turn_about_a_hinge_and_drawers_are_pulled_straight():
    motions = [motion for seed in SEEDS for motion in true_motions(scene_of(seed))]
    angles = np.array([degrees(motion[:3, :3]) for motion in motions])
    turns, slides = angles > 1, angles < 1e-3
    assert (turns | slides).all() and turns.any() and slides.any()
    assert (angles[turns] >= 5).all() and (angles[turns] <= 100).all()
    for motion, slide in zip(motions, slides, strict=True):
        if slide:
            assert 0.05 <= np.linalg.norm(motion[:3, 3]) <= 0.4
        else:
            # A hinge stays where it is: along the axis of the rotation nothing moves.
            axis = np.linalg.svd(motion[:3, :3] - np.eye(3))[2][2]
            assert abs(axis @ motion[:3, 3]) < 1e-6 * max(1.0, np.linalg.norm(motion[:3, 3]))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_leaf_lies_after_where_its_motion_brings_it(seed):
    scene = scene_of(seed)
    for number in set(scene.motions) - scene.uncounted.before - scene.uncounted.after:
        before, after = (cloud[truth == number] for cloud, truth in zip(scene.clouds, scene.truth, strict=True))
        brought = transformed(before, scene.motions[number])
        assert np.median(cKDTree(brought).query(after)[0]) < 0.1 * scene.unit
