import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError

EYE = np.eye(4)[None]


def some_poses(seed, count=3):
    generator = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=seed).as_matrix()
    poses[:, :3, 3] = generator.normal(0, 5, (count, 3))
    return poses


def changed(index, change):
    poses = some_poses(0)
    poses[index] = change(poses[index])
    return poses


def scaled(pose):
    return pose @ np.diag([1.1, 1.1, 1.1, 1])


def mirrored(pose):
    return pose @ np.diag([-1.0, 1, 1, 1])


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (np.eye(4), r"not \[4, 4\]; give one pose as poses\[None\]"),
        (np.zeros((0, 4, 4)), r"\[V, 4, 4\] with V at least 1"),
        (np.zeros((2, 3, 4)), r"\[V, 4, 4\] with V at least 1"),
        ("poses", "must be numbers"),
        (changed(1, scaled), "pose 1 of 3 is not rigid"),
        (changed(2, mirrored), "pose 2 of 3 is not rigid"),
        (changed(0, np.transpose), "pose 0 of 3 is not rigid"),
        (changed(2, lambda pose: pose * np.nan), "pose 2 of 3 has NaN or inf"),
    ],
)
def test_poses_that_are_none(poses, message):
    with pytest.raises(InputError, match=f"views: .*{message}"):
        SensorViews(poses, (60.0, 45.0), 4.0)


@pytest.mark.parametrize(
    "field_of_view", [(0.0, 45.0), (60, 180), (361, 45), (60,), (60, 45, 1), "wide", 60, (np.nan, 45)]
)
def test_angles_that_no_sensor_has(field_of_view):
    with pytest.raises(InputError, match="views: field_of_view="):
        SensorViews(EYE, field_of_view, 4.0)


@pytest.mark.parametrize("max_range", [0, -1.0, np.nan, np.inf, "4", None, True])
def test_ranges_that_no_sensor_has(max_range):
    with pytest.raises(InputError, match=f"views: max_range={max_range!r}"):
        SensorViews(EYE, (60, 45), max_range)


def test_numbers_of_any_type():
    views = SensorViews(some_poses(0).tolist(), [np.float32(60), 45], np.float32(4))
    assert len(views) == 3
    assert views.poses.dtype == np.float64
    assert views.field_of_view == (60.0, 45.0)
    assert views.max_range == 4.0


def test_camera_coordinates():
    """Two metres above the origin, looking along the world's y, upright."""
    pose = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 2], [0, 0, 0, 1.0]])
    views = SensorViews(pose[None], (60, 45), 10.0)
    world = np.array([[0, 1, 2.0], [0, 3, 1], [1, 3, 2]])
    np.testing.assert_allclose(views.in_camera(world, 0), [[0, 0, 1], [0, 1, 3], [1, 0, 3]], atol=1e-12)


def test_field_of_view_of_a_camera():
    views = SensorViews(EYE, (90, 60), 2.0)
    inside = np.array([[0, 0, 1], [0.99, 0, 1], [0, 0.57, 1], [0, 0, 1.99]])
    outside = np.array([[0, 0, -1], [1.01, 0, 1], [0, 0.58, 1], [0, 0, 2.01], [0, 0, -0.1]])
    assert views.in_field_of_view(inside).all()
    assert not views.in_field_of_view(outside).any()


def test_field_of_view_of_a_turning_scanner():
    views = SensorViews(EYE, (360, 60), 2.0)
    inside = np.array([[0, 0, -1], [-1, 0, -1], [1, 0.5, 0], [0, -0.5, -1]])
    assert views.in_field_of_view(inside).all()
    assert not views.in_field_of_view(np.array([[0, 1, 0.1], [0, 0.6, 1], [0, 0.6, -1]])).any()
    half = SensorViews(EYE, (200, 60), 2.0)
    assert half.in_field_of_view(np.array([[1, 0, -0.1]])).all()
    assert not half.in_field_of_view(np.array([[1, 0, -0.5]])).any()


@given(st.integers(0, 2**32 - 1))
def test_moved_with_the_world(seed):
    views, motion = SensorViews(some_poses(seed), (60, 45), 4.0), some_poses(seed ^ 1)[0]
    points = np.random.default_rng(seed).normal(0, 5, (20, 3))
    moved = views.moved(motion)
    for view in range(len(views)):
        here = views.in_camera(points, view)
        there = moved.in_camera(points @ motion[:3, :3].T + motion[:3, 3], view)
        np.testing.assert_allclose(here, there, atol=1e-9)


def test_at_the_origin_just_holds_the_points():
    points = np.random.default_rng(0).uniform([-1, -0.4, 1.0], [1, 0.6, 3], (500, 3))
    views = SensorViews.at_origin(points)
    np.testing.assert_array_equal(views.poses, EYE)
    assert views.in_field_of_view(points).all()
    assert not views.in_field_of_view(points * 1.05).all()
    tangents = np.abs(points[:, :2] / points[:, 2:]).max(axis=0)
    np.testing.assert_allclose(np.tan(np.radians(views.field_of_view) / 2), tangents, rtol=0.03)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), [[0, 0, 1.0], [0, 0, -1]], [[0, 0, 0.0]]])
def test_at_the_origin_nothing_may_be_behind(points):
    with pytest.raises(InputError, match=r"give the camera's pose as SensorViews"):
        SensorViews.at_origin(points)
