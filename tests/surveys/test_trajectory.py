import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from gmmjax.errors import InputError
from gmmjax.surveys import Trajectory, pose_matrix


def poses(count, seed=0):
    random = np.random.default_rng(seed)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    if count:  # SciPy 1.14 makes no matrices of no rotations.
        matrices[:, :3, :3] = Rotation.random(count, random_state=seed).as_matrix()
    matrices[:, :3, 3] = random.uniform(-2, 2, (count, 3))
    return matrices


@given(st.integers(2, 12), st.integers(0, 1000))
def test_between_samples_it_is_scipy_s_slerp_and_a_straight_line(count, seed):
    random = np.random.default_rng(seed)
    times = np.cumsum(random.uniform(0.01, 0.4, count))
    trajectory = Trajectory(times, poses(count, seed))
    asked = random.uniform(times[0], times[-1], 20)
    found, covered = trajectory.at(asked)
    assert covered.all()
    turned = Slerp(times, Rotation.from_matrix(trajectory.poses[:, :3, :3]))(asked)
    np.testing.assert_allclose(found[:, :3, :3], turned.as_matrix(), atol=1e-12)
    for axis in range(3):
        expected = np.interp(asked, times, trajectory.poses[:, axis, 3])
        np.testing.assert_allclose(found[:, axis, 3], expected, atol=1e-12)
    np.testing.assert_array_equal(found[:, 3], np.tile([0, 0, 0, 1], (20, 1)))


def test_a_turn_at_a_constant_speed():
    times = np.arange(5.0)
    quarter = [pose_matrix([2 * t, 0, 0], Rotation.from_euler("z", 40 * t, degrees=True).as_quat()) for t in times]
    found, covered = Trajectory(times, np.stack(quarter)).at([1.25], 1.0)
    assert covered.all()
    np.testing.assert_allclose(found[0, :3, :3], Rotation.from_euler("z", 50, degrees=True).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found[0, :3, 3], [2.5, 0, 0])


def test_samples_are_met_exactly_and_nothing_beyond_the_ends_is_covered():
    times = np.array([1.6e9, 1.6e9 + 0.1, 1.6e9 + 0.2])
    trajectory = Trajectory(times, poses(3))
    found, covered = trajectory.at([times[0] - 1e-3, *times, times[-1] + 1e-3])
    np.testing.assert_array_equal(covered, [False, True, True, True, False])
    np.testing.assert_allclose(found[1:4], trajectory.poses, atol=1e-12)
    np.testing.assert_allclose(found[[0, 4]], trajectory.poses[[0, 2]], atol=1e-12)


def test_a_gap_is_not_covered_but_its_ends_are():
    trajectory = Trajectory(np.array([0.0, 0.1, 2.0, 2.1]), poses(4))
    found, covered = trajectory.at([0.05, 0.1, 0.2, 1.9, 2.0, 2.05])
    np.testing.assert_array_equal(covered, [True, True, False, False, True, True])
    np.testing.assert_allclose(found[[2, 3]], trajectory.poses[[1, 2]], atol=1e-12)
    assert trajectory.at([0.2, 1.9], 2.0)[1].all()


def test_one_pose_covers_its_own_time():
    trajectory = Trajectory(np.array([3.0]), poses(1))
    found, covered = trajectory.at([2.9, 3.0, 3.1])
    np.testing.assert_array_equal(covered, [False, True, False])
    np.testing.assert_array_equal(found, np.repeat(trajectory.poses, 3, axis=0))


def test_the_sensor_of_a_body():
    body, on_body = Trajectory(np.arange(3.0), poses(3)), poses(1, seed=9)[0]
    point = np.array([0.3, -0.2, 1.5, 1.0])
    np.testing.assert_allclose(body.of_sensor(on_body).poses @ point, body.poses @ (on_body @ point))


def test_samples_in_any_order_of_which_the_last_at_a_time_counts():
    three = poses(3)
    trajectory = Trajectory.of_samples([2.0, 1.0, 2.0], three)
    np.testing.assert_array_equal(trajectory.times, [1.0, 2.0])
    np.testing.assert_array_equal(trajectory.poses, three[[1, 2]])
    with pytest.raises(InputError, match="3 poses need as many times"):
        Trajectory.of_samples([0.0, 1.0], three)


@pytest.mark.parametrize(
    ("times", "matrices", "message"),
    [
        (np.array([0.0, 0.0]), poses(2), "time 1 .* is not after"),
        (np.array([0.0, np.nan]), poses(2), "need as many times"),
        (np.array([0.0, 1.0]), 2 * poses(2), "trajectory: pose 0 of 2 is not rigid"),
        (np.zeros(0), poses(0), "at least 1"),
    ],
)
def test_what_no_trajectory_has(times, matrices, message):
    with pytest.raises(InputError, match=message):
        Trajectory(times, matrices)


@given(st.integers(0, 1000), st.floats(0.1, 10))
def test_pose_matrix(seed, length):
    turned = Rotation.random(random_state=seed)
    pose = pose_matrix([1, 2, 3], length * turned.as_quat())
    np.testing.assert_allclose(pose[:3, :3], turned.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(pose[:, 3], [1, 2, 3, 1])


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [0, 0, 1], [0, 0, np.nan, 1], [1e300, 0, 0, 1e300]])
def test_what_no_pose_has(quaternion):
    with pytest.raises(InputError, match="quaternion x y z w"):
        pose_matrix([0, 0, 0], quaternion)
