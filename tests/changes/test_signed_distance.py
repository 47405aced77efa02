"""A wall and a floor of which a part has come nearer."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.differences import differences_between
from gmmjax.changes.signed_distance import SignedDistanceSettings, signed_distances
from gmmjax.clouds import SensorViews
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

SPACING = 0.05
STEP = 0.12


def floor(seed, step=0.0):
    """A floor of which the part beyond x = 1 has risen."""
    random = np.random.default_rng(seed)
    points = random.uniform([-2, -2, 0], [2, 2, 0], (6000, 3))
    points[:, 2] += random.normal(0, 0.002, len(points)) + np.where(points[:, 0] > 1, step, 0)
    return points


def distances(points, views=Pair(None, None), settings=SignedDistanceSettings()):
    surfaces = points.map(LocalSurface.of)
    return signed_distances(surfaces, differences_between(surfaces, SPACING), views, settings)


@pytest.fixture(scope="module")
def risen():
    return Pair(floor(0), floor(1, STEP))


def parts(points):
    return points[:, 0] > 1.2, points[:, 0] < 0.8


def test_a_floor_that_rose_has_a_positive_distance_in_both_clouds(risen):
    for points, found in zip(risen, distances(risen), strict=True):
        changed, same = parts(points)
        assert np.nanmedian(found[changed]) == pytest.approx(STEP, abs=0.003)
        assert abs(np.nanmedian(found[same])) < 0.001


def test_a_floor_that_sank_has_a_negative_distance(risen):
    there, back = distances(risen), distances(risen.swapped)
    np.testing.assert_allclose(there.before, -back.after, atol=1e-12)
    np.testing.assert_allclose(there.after, -back.before, atol=1e-12)


def test_towards_the_sensor_is_positive(risen):
    below = np.eye(4)
    below[2, 3] = -3.0
    views = SensorViews(below[None], (360.0, 170.0), 10.0)
    changed, _ = parts(risen.before)
    assert np.nanmedian(distances(risen, Pair(views, views)).before[changed]) == pytest.approx(-STEP, abs=0.003)


def test_beyond_the_edge_of_the_other_cloud_there_is_nothing_to_compare_with(risen):
    part = Pair(risen.before, risen.after[risen.after[:, 1] < 0])
    found = distances(part).before
    assert np.isnan(found[risen.before[:, 1] > 0.4]).all()
    assert np.isfinite(found[risen.before[:, 1] < -0.1]).all()
    everywhere = distances(part, settings=SignedDistanceSettings(reach=np.inf)).before
    assert np.isfinite(everywhere).all()


def test_a_rigid_motion_leaves_the_distances_where_the_sensors_move_along(risen):
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_euler("xyz", [40, 170, -80], degrees=True).as_matrix()
    motion[:3, 3] = [3e5, 5e6, 40.0]
    above = np.eye(4)
    above[2, 3] = 3.0
    views = SensorViews(above[None], (360.0, 170.0), 10.0)
    moved = risen.map(lambda points: points @ motion[:3, :3].T + motion[:3, 3])
    found = distances(risen, Pair(views, views))
    there = distances(moved, Pair(views.moved(motion), views.moved(motion)))
    np.testing.assert_allclose(there.after, found.after, atol=1e-6)
