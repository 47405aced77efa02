import gc
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.geometry.rigid import rigid_transform
from gmmjax.surveys import Trajectory, localised_map
from tests.surveys.seen_room import around, distance_to_surfaces, frame, motion, survey


def lexicographic(points):
    return points[np.lexsort(points.T)]


def test_points_lie_on_the_surfaces():
    frames, trajectory = survey(around())
    made = localised_map(frames, trajectory)
    assert len(made.points) == sum(len(frame.cloud) for frame in frames)
    assert distance_to_surfaces(made.points).max() < 1e-9


def test_between_poses_the_frame_is_where_the_interpolated_pose_is():
    first, second = around(16)[:2]
    shared = Rotation.from_matrix([first[:3, :3], second[:3, :3]]).mean().as_matrix()
    between = rigid_transform(shared, (first[:3, 3] + second[:3, 3]) / 2)
    made = localised_map([frame(between, 0.2)], Trajectory(np.array([0.0, 0.4]), np.stack([first, second])))
    assert distance_to_surfaces(made.points).max() < 1e-9


def test_the_sensor_on_the_body():
    on_body = motion(3)
    frames, sensor = survey(around())
    body = Trajectory(sensor.times, sensor.poses @ np.linalg.inv(on_body))
    made = localised_map(frames, body.of_sensor(on_body))
    np.testing.assert_allclose(made.points, localised_map(frames, sensor).points, atol=1e-9)


@given(st.integers(0, 1000))
@settings(max_examples=5)
def test_a_motion_of_the_trajectory_moves_the_map(seed):
    frames, trajectory = survey(around(4))
    way = motion(seed)
    still, moved = (localised_map(frames, Trajectory(trajectory.times, t @ trajectory.poses)) for t in (np.eye(4), way))
    np.testing.assert_allclose(moved.points, still.points @ way[:3, :3].T + way[:3, 3], atol=1e-9)
    np.testing.assert_allclose(moved.views.poses, way @ still.views.poses, atol=1e-9)


@given(st.permutations(range(6)))
@settings(max_examples=5)
def test_frames_in_another_order_give_the_same_points(order):
    frames, trajectory = survey(around(6))
    made, again = localised_map(frames, trajectory), localised_map([frames[i] for i in order], trajectory)
    np.testing.assert_array_equal(lexicographic(made.points), lexicographic(again.points))
    np.testing.assert_array_equal(again.times, trajectory.times[list(order)])


def test_each_point_knows_its_frame():
    frames, trajectory = survey(around(4))
    made = localised_map(frames, trajectory, bounds=[[-1.0, -1.0, -0.01], [1.0, 1.0, 1.0]])
    for index, (seen, pose) in enumerate(zip(frames, made.poses, strict=True)):
        moved = seen.cloud.points @ pose[:3, :3].T + pose[:3, 3]
        inside = ((moved >= [-1, -1, -0.01]) & (moved <= 1)).all(axis=1)
        np.testing.assert_allclose(made.points[made.frame_of_point == index], moved[inside], atol=1e-12)


@pytest.mark.slow
def test_frames_are_not_held():
    poses = around(8)
    alive = []
    # What was there before is not looked through again with every frame.
    gc.collect()
    gc.freeze()

    def stream():
        for time, pose in enumerate(poses):
            seen = frame(pose, float(time))
            alive.append(weakref.ref(seen))
            yield seen
            gc.collect()
            assert sum(reference() is not None for reference in alive) <= 2

    try:
        assert localised_map(stream(), Trajectory(np.arange(8.0), poses)).frames_used == 8
    finally:
        gc.unfreeze()
