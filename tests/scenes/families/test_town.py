import functools

import numpy as np
import pytest

from gmmjax.geometry import transformed
from gmmjax.scenes import family_scene

SEEDS = range(3)
scene_of = functools.cache(functools.partial(family_scene, "town"))


@pytest.mark.parametrize("seed", SEEDS)
def test_it_is_seen_from_far_above_or_from_the_street(seed):
    scene = scene_of(seed)
    views = scene.views.before
    flown = views.field_of_view[0] < 180
    ranges = np.linalg.norm(scene.clouds.before[::50, None] - views.poses[None, :, :3, 3], axis=2).min(axis=1)
    if flown:
        # One direction to all that is below, and walls hardly seen.
        axes = views.poses[:, :3, 2]
        np.testing.assert_allclose(axes, np.broadcast_to(axes[:1], axes.shape), atol=2e-3)
        assert ranges.min() > 100 * scene.unit
    else:
        heights = transformed(scene.clouds.before, np.linalg.inv(views.poses[len(views) // 2]))[:, 1] / scene.unit
        # The ground is 1.7 to 2.4 m below the lidar on a car's roof.
        assert 1.2 < np.percentile(heights, 90) < 3.5 and ranges.min() < 8 * scene.unit


def test_blocks_change_in_parts_only():
    shares = [(scene.truth.before >= 0).mean() for scene in map(scene_of, SEEDS)]
    assert max(shares) < 0.3 and any(scene_of(seed).kinds for seed in SEEDS)
