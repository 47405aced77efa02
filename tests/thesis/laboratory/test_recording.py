import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.thesis.laboratory import THINGS, recorded_run


@pytest.fixture(scope="module")
def recording():
    return recorded_run("run4", 0, frames=6)


def moved(points, pose):
    return points @ pose[:3, :3].T + pose[:3, 3]


def angles(first, second):
    """Between two stacks of poses, degrees."""
    cosine = (np.einsum("nij,nij->n", first[:, :3, :3], second[:, :3, :3]) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def test_a_recording_is_its_seed(recording):
    again, other = recorded_run("run4", 0, frames=6), recorded_run("run4", 1, frames=6)
    for one, two in zip(recording.frames, again.frames, strict=True):
        np.testing.assert_array_equal(one.cloud.points, two.cloud.points)
    np.testing.assert_array_equal(recording.localised.poses, again.localised.poses)
    assert not np.allclose(recording.poses, other.poses)


def test_frames_are_images_of_the_thesiss_camera(recording):
    for frame in recording.frames:
        assert (frame.width, frame.height) == (224, 171)
        np.testing.assert_allclose(frame.intrinsics().field_of_view, (62, 45), atol=0.5)
        assert 0 < frame.cloud.rows_dropped < 0.4 * 224 * 171


def test_points_lie_on_the_things_that_they_are_said_to_be_on(recording):
    things = recording.laboratory.things
    for frame, labels, pose in zip(recording.frames, recording.things, recording.poses, strict=True):
        assert len(labels) == len(frame.cloud)
        places = moved(frame.cloud.points, pose)
        for label in np.unique(labels[labels >= 0]):
            parts = things[THINGS[label]]
            near = np.any([solid.contains(places[labels == label], 0.05) for solid in parts], axis=0)
            assert near.mean() > 0.99


def test_poses_are_believed_where_they_are_but_for_noise(recording):
    times = np.array([frame.time for frame in recording.frames])
    errors = {}
    for name in ("localised", "adjusted"):
        poses, covered = getattr(recording, name).of_sensor(recording.sensor_on_body).at(times)
        assert covered.all()
        errors[name] = np.linalg.inv(recording.misregistration) @ poses
        shift = np.linalg.norm(errors[name][:, :3, 3] - recording.poses[:, :3, 3], axis=1)
        assert (0 < shift).all() and shift.max() < 0.06
        assert angles(errors[name], recording.poses).max() < 2
    off = {name: np.linalg.norm(found[:, :3, 3] - recording.poses[:, :3, 3], axis=1) for name, found in errors.items()}
    assert off["localised"].mean() > 2 * off["adjusted"].mean()


def test_a_surveys_world_is_off_by_a_centimetre_and_a_quarter_of_a_degree_at_most(recording):
    assert 0.005 <= np.linalg.norm(recording.misregistration[:3, 3]) <= 0.01
    assert angles(recording.misregistration[None], np.eye(4)[None])[0] <= 0.25 + 1e-6


def test_arguments_that_make_no_survey_are_named(as_users):
    with pytest.raises(InputError, match=r"frames=3 must be at least 4"):
        recorded_run("run5", 0, frames=3)
