import numpy as np

from gmmjax.geometry.icp import settled
from gmmjax.geometry.local_surface import LocalSurface
from tests.changes.scanned_objects import box, motion, placed

EXTENT = (0.4, 0.28, 0.22)


def error(transform, true):
    points = box(9, EXTENT, noise=0)
    return np.linalg.norm(placed(points, transform) - placed(points, true), axis=1).max()


def test_a_small_motion_is_found_although_a_part_is_missing():
    true = motion(0.05, [0.01, -0.015, 0.01])
    source, target = LocalSurface.of(box(0, EXTENT, (0, 1, 2))), LocalSurface.of(placed(box(1, EXTENT), true))
    found = settled(source.means(np.arange(len(source))), target, np.eye(4), 0.03, 0.006, 20)
    assert error(np.eye(4), true) > 0.02 and error(found, true) < 0.003


def test_along_a_plane_nothing_moves():
    """Nothing determines a motion along a wall: it is not 2 cm back to where it was, nor far away."""
    random = np.random.default_rng(0)
    wall = [np.column_stack([random.uniform(0, 1, (3000, 2)), 0.003 * random.standard_normal(3000)]) for _ in range(2)]
    source, target = LocalSurface.of(wall[0] + np.array([0.02, 0, 0.01])), LocalSurface.of(wall[1])
    found = settled(source.means(np.arange(3000)), target, np.eye(4), 0.05, 0.01, 20)
    shift = placed(wall[0].mean(axis=0), found) - wall[0].mean(axis=0)
    assert abs(shift[2] + 0.01) < 0.001 and np.abs(shift[:2]).max() < 0.01
