import numpy as np
import pytest

from gmmjax.reporting.camera import HALF_HEIGHT, HALF_WIDTH, initial_camera

RANDOM = np.random.default_rng(0)
DEPTH_SCAN = np.c_[RANDOM.uniform(-0.5, 0.5, (500, 2)), RANDOM.uniform(1, 2, 500)]
FLOOR = RANDOM.uniform(-5, 5, (500, 3)) * [1, 1, 0.01]
WALL = RANDOM.uniform(-5, 5, (500, 3)) * [0.01, 1, 1]


def test_a_depth_scan_is_seen_from_the_sensor():
    camera = initial_camera(DEPTH_SCAN)
    assert camera.towards_eye[2] < -0.9
    np.testing.assert_array_equal(camera.up, [0, -1, 0])


def test_a_depth_scan_with_z_backward_is_seen_from_the_sensor_too():
    """OpenGL's axes: the same view, turned by half a turn about x."""
    turn = np.array([1, -1, -1])
    camera, turned = initial_camera(DEPTH_SCAN), initial_camera(DEPTH_SCAN * turn)
    np.testing.assert_allclose(turned.towards_eye, turn * camera.towards_eye)
    np.testing.assert_allclose(turned.up, [0, 1, 0])


def test_a_floor_is_seen_from_above():
    camera = initial_camera(FLOOR)
    assert camera.towards_eye[2] > 0.5
    np.testing.assert_array_equal(camera.up, [0, 0, 1])


def test_a_wall_is_seen_from_its_side():
    assert abs(initial_camera(WALL).towards_eye[0]) > 0.8


@pytest.mark.parametrize("points", [DEPTH_SCAN, FLOOR, WALL, FLOOR * [1, 0, 0]], ids=["scan", "floor", "wall", "line"])
def test_nearly_all_points_are_in_the_view(points):
    camera = initial_camera(points)
    centred = (points - points.mean(axis=0)) / np.ptp(points, axis=0).max()
    centre, distance = camera.framed(centred)
    forward = -camera.towards_eye
    across = np.cross(forward, camera.up)
    across /= np.linalg.norm(across)
    seen = centred - (centre + distance * camera.towards_eye)
    depth = seen @ forward
    inside = np.abs(seen @ across) < HALF_WIDTH * depth
    inside &= np.abs(seen @ np.cross(across, forward)) < HALF_HEIGHT * depth
    assert inside.mean() > 0.95
