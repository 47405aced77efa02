import dataclasses

import numpy as np
import pytest

from gmmjax.geometry.icp import IcpSettings, point_to_plane_icp
from gmmjax.geometry.local_surface import LocalSurface
from tests.changes.scanned_objects import box, motion, placed

EXTENT = (0.4, 0.28, 0.22)
SETTINGS = IcpSettings(steps=20)


def error(transform, true):
    points = box(9, EXTENT, noise=0)
    return np.linalg.norm(placed(points, transform) - placed(points, true), axis=1).max()


@pytest.fixture(scope="module")
def displaced():
    """The local means of a box of which two sides are missing, the whole box after a small motion, and the motion."""
    true = motion(0.05, [0.01, -0.015, 0.01])
    source = LocalSurface.of(box(0, EXTENT, (0, 1, 2)))
    return source.means(np.arange(len(source))), LocalSurface.of(placed(box(1, EXTENT), true)), true


def test_a_small_motion_is_found_although_a_part_is_missing(displaced):
    means, target, true = displaced
    found = point_to_plane_icp(means, target, np.eye(4), 0.03, 0.006, SETTINGS)
    assert error(np.eye(4), true) > 0.02 and error(found, true) < 0.003


def test_along_a_plane_nothing_moves():
    """Nothing determines a motion along a wall: it is not 2 cm back to where it was, nor far away."""
    random = np.random.default_rng(0)
    wall = [np.column_stack([random.uniform(0, 1, (3000, 2)), 0.003 * random.standard_normal(3000)]) for _ in range(2)]
    source, target = LocalSurface.of(wall[0] + np.array([0.02, 0, 0.01])), LocalSurface.of(wall[1])
    found = point_to_plane_icp(source.means(np.arange(3000)), target, np.eye(4), 0.05, 0.01, SETTINGS)
    shift = placed(wall[0].mean(axis=0), found) - wall[0].mean(axis=0)
    assert abs(shift[2] + 0.01) < 0.001 and np.abs(shift[:2]).max() < 0.01


def test_the_settings_bound_the_steps(displaced):
    means, target, true = displaced
    none, one = (
        point_to_plane_icp(means, target, np.eye(4), 0.03, 0.006, dataclasses.replace(SETTINGS, steps=steps))
        for steps in (0, 1)
    )
    np.testing.assert_array_equal(none, np.eye(4))
    assert 0.003 < error(one, true) < error(np.eye(4), true)


def test_points_without_a_counterpart_have_no_influence(displaced):
    """Half as many points again, beyond the last reach from the surface."""
    means, target, true = displaced
    others = means[::2] + np.array([0, 0, 0.3])
    found = point_to_plane_icp(np.concatenate([means, others]), target, np.eye(4), 0.03, 0.006, SETTINGS)
    assert error(found, true) < 0.003
