import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.surveys import Frame, Trajectory, localised_map
from gmmjax.surveys.pose_refinement import refined_poses
from tests.surveys.seen_room import around, distance_to_surfaces, off, survey


def errors(poses, true):
    """Shifts (metres) and turns (degrees) from the true poses, but for what all have in common."""
    apart = poses @ np.linalg.inv(true)
    turn = Rotation.from_matrix(apart[:, :3, :3]).mean().as_matrix()
    places = (poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)) @ turn - (true[:, :3, 3] - true[:, :3, 3].mean(axis=0))
    turns = Rotation.from_matrix(turn.T @ apart[:, :3, :3])
    return np.linalg.norm(places, axis=1), np.degrees(turns.magnitude())


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "degrees"), [(0.02, 0.5), (0.01, 0.5), (0.01, 0.1), (0.005, 0.2)])
def test_noisy_poses_become_better(shift, degrees):
    true = around(10)
    frames, _ = survey(true, noise=0.006)
    given = off(true, shift, degrees)
    made = localised_map(frames, Trajectory(np.arange(10.0), given), refine=True)
    assert made.refined
    shifts, turns = errors(made.poses, true)
    before_shifts, before_turns = errors(given, true)
    assert shifts.max() < 0.004 and shifts.mean() < 0.5 * before_shifts.mean()
    assert turns.max() < 0.15 and turns.mean() < before_turns.mean()
    np.testing.assert_array_equal(made.views.poses, made.poses)


@pytest.mark.slow
def test_the_points_come_to_lie_on_the_surfaces():
    true = around(10)
    frames, _ = survey(true, noise=0.002)
    noisy = Trajectory(np.arange(10.0), off(true, 0.02, 0.5))
    rough, fine = (
        np.median(distance_to_surfaces(localised_map(frames, noisy, refine=r).points)) for r in (False, True)
    )
    assert fine < 0.6 * rough


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.006])
def test_true_poses_stay(noise):
    frames, trajectory = survey(around(10), noise=noise)
    made = localised_map(frames, trajectory, refine=True)
    assert not made.refined
    np.testing.assert_allclose(made.poses, trajectory.poses, atol=1e-12)


def test_poses_that_are_far_off_stay():
    true = around(10)
    frames, _ = survey(true)
    given = off(true, 0.4, 10.0)
    assert not localised_map(frames, Trajectory(np.arange(10.0), given), refine=True).refined


def test_one_frame_and_frames_that_do_not_overlap_stay():
    frames, trajectory = survey(around(2))
    assert not localised_map(frames[:1], trajectory, refine=True).refined
    apart = trajectory.poses.copy()
    apart[1, :3, 3] += 50
    assert not localised_map(frames, Trajectory(trajectory.times, apart), refine=True).refined


def test_frames_without_planes_stay_where_they_are():
    true = around(10)
    frames, _ = survey(true, noise=0.006)
    given = off(true, 0.02, 0.5)
    clouds = [frame.cloud.points for frame in frames]
    clouds[3] = clouds[3][:0]
    clouds[4] = np.random.default_rng(0).uniform(-1, 1, (500, 3)) + np.array([0, 0, 30.0])
    found = refined_poses(clouds, given)
    np.testing.assert_allclose(found[3], given[3])
    np.testing.assert_allclose(found[4], given[4])
    others = [0, 1, 2, 5, 6, 7, 8, 9]
    assert errors(found[others], true[others])[0].max() < 0.004


@pytest.mark.slow
def test_points_beyond_the_range_are_no_help_and_no_harm():
    frames, _ = survey(around(10))
    noisy = Trajectory(np.arange(10.0), off(around(10), 0.02, 0.5))
    lone = Frame(frames[0].cloud, 20.0)
    made = localised_map([*frames, lone], noisy, refine=True, max_range=2.5)
    assert made.frames_skipped == 1 and made.refined
