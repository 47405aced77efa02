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


def test_relative_to_an_offset():
    views, offset = SensorViews(some_poses(3), (60, 45), 4.0), np.array([5e5, 5.2e6, 30.0])
    points = np.random.default_rng(3).normal(0, 5, (20, 3))
    survey = views.relative_to(-offset)
    for view in range(len(views)):
        np.testing.assert_allclose(survey.in_camera(points + offset, view), views.in_camera(points, view), atol=1e-8)


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


def a_room(seed=0, count=4000):
    """Points on the walls, the floor and the ceiling of a room of 6 x 4 x 3 m whose corner is the origin."""
    random = np.random.default_rng(seed)
    size = np.array([6.0, 4.0, 3.0])
    points = random.uniform(0, 1, (count, 3)) * size
    axis = random.integers(0, 3, count)
    points[np.arange(count), axis] = random.integers(0, 2, count) * size[axis]
    return points


def test_a_sensor_with_points_all_around_turns():
    points = a_room()
    views = SensorViews.from_positions(points, [[2, 1, 1.5], [4, 3, 1.4]])
    assert views.turning and len(views) == 2
    np.testing.assert_array_equal(views.poses[:, :3, 3], [[2, 1, 1.5], [4, 3, 1.4]])
    # All but what is straight above and below.
    assert all(views.in_field_of_view(views.in_camera(points, view)).mean() > 0.99 for view in range(2))
    farthest = np.linalg.norm(points[:, None] - views.poses[:, :3, 3], axis=2).max()
    assert farthest < views.max_range < 1.05 * farthest


def test_stray_points_do_not_widen_what_is_seen():
    points = a_room()
    stray = np.concatenate([points, [[1e6, 0, 0], [0, 0, -3.4e38]]])
    for place in ([3, 2, 1.5], [-5.0, 2, 1.5]):
        views, seen = (SensorViews.from_positions(own, place) for own in (points, stray))
        assert (views.field_of_view, views.max_range) == (seen.field_of_view, seen.max_range)
    ahead = np.array([0, 0, 3])
    assert SensorViews.at_origin(points + ahead).max_range == SensorViews.at_origin(stray + ahead).max_range


def test_the_vertical_angle_of_a_turning_scanner_just_holds_the_points():
    points = a_room()
    points = points[(points[:, 2] > 1) & (points[:, 2] < 2)]
    views = SensorViews.from_positions(points, [3, 2, 1.5])
    assert views.in_field_of_view(views.in_camera(points, 0)).all()
    steepest = 2 * np.degrees(np.arctan2(np.abs(points[:, 2] - 1.5), np.hypot(*(points[:, :2] - [3, 2]).T))).max()
    assert steepest < views.field_of_view[1] < 1.05 * steepest + 2


@pytest.mark.parametrize("place", [[-5.0, 2, 1.5], [3, -9, 3], [3.1, 2, 12], [3, 2.2, -9]])
def test_a_sensor_with_the_points_on_one_side_is_a_camera_that_looks_at_them(place):
    points = a_room()
    views = SensorViews.from_positions(points, place)
    assert not views.turning
    assert views.in_field_of_view(views.in_camera(points, 0)).all()
    smaller = SensorViews(views.poses, np.array(views.field_of_view) * 0.9, views.max_range)
    assert not smaller.in_field_of_view(smaller.in_camera(points, 0)).all()


def test_a_level_camera_is_upright():
    views = SensorViews.from_positions(a_room(), [-5.0, 2, 1.5])
    above, beside = (views.in_camera(np.array([[0.0, 2, 1.5]]) + offset, 0)[0] for offset in ([0, 0, 1], [0, -1, 0]))
    assert above[1] < -0.99 and abs(above[0]) < 0.05
    assert beside[0] > 0.99 and abs(beside[1]) < 0.05


def test_a_frame_in_its_own_coordinates_has_its_camera():
    """From its position alone about what `at_origin` says of it."""
    points = np.random.default_rng(0).uniform([-1, -0.5, 1.0], [1, 0.5, 3], (500, 3))
    views = SensorViews.from_positions(points, np.zeros(3))
    np.testing.assert_allclose(views.poses[0], np.eye(4), atol=0.1)
    np.testing.assert_allclose(views.field_of_view, SensorViews.at_origin(points).field_of_view, atol=8)


def test_points_at_the_sensor_are_in_no_direction():
    """As the missing returns that some scanners write."""
    points = np.vstack([a_room() + np.array([5, 0, 0]), np.zeros((50, 3))])
    assert not SensorViews.from_positions(points, np.zeros(3)).turning


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ([0, 0], r"\[V, 3\]"),
        (np.zeros((0, 3)), "at least 1"),
        ([0, np.nan, 0], "finite"),
        ("here", "numbers"),
        ([10_000.0, 0, 1.5], r"\(10000, 0, 1.5\) is 9.99e\+03 away from a cloud that is only 7.81 large"),
        ([1e300, 0, 0], "away from a cloud"),
    ],
)
def test_positions_that_are_none(positions, message):
    with pytest.raises(InputError, match=message):
        SensorViews.from_positions(a_room(), positions)


def test_a_cloud_without_points_has_no_field_of_view():
    with pytest.raises(InputError, match="no points"):
        SensorViews.from_positions(np.zeros((0, 3)), np.zeros(3))
