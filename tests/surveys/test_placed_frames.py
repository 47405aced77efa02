"""What both kinds of map do alike with frames and poses."""

import numpy as np
import pytest

from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.surveys import Frame, Trajectory, localised_map, volumetric_map
from tests.surveys.seen_room import CAMERA, around, survey


@pytest.fixture(params=["localised", "volumetric"])
def make_map(request):
    if request.param == "localised":
        return localised_map
    request.getfixturevalue("open3d")
    return lambda *given, **settings: volumetric_map(*given, **{"voxel_size": 0.04} | settings)


def test_frames_outside_of_the_trajectory_are_skipped_and_counted(make_map):
    frames, whole = survey(around(8))
    part = Trajectory(whole.times[2:6], whole.poses[2:6])
    made = make_map(frames, part)
    assert (made.frames_used, made.frames_skipped) == (4, 4)
    np.testing.assert_array_equal(made.times, whole.times[2:6])
    np.testing.assert_allclose(made.poses, whole.poses[2:6], atol=1e-12)
    np.testing.assert_allclose(made.views.poses, whole.poses[2:6], atol=1e-12)
    alone = make_map(frames[2:6], whole)
    np.testing.assert_allclose(made.points, alone.points, atol=1e-9)


def test_frames_in_a_gap_are_skipped(make_map):
    frames, whole = survey(around(8))
    frames = [*frames, Frame(frames[3].cloud, 3.5, "", CAMERA.width, CAMERA.height)]
    assert make_map(frames, whole).frames_skipped == 1
    assert make_map(frames, whole, max_gap=1.0).frames_skipped == 0


def test_frames_without_points_are_skipped(make_map):
    frames, whole = survey(around(4))
    empty = Frame.of_image(np.full((CAMERA.height, CAMERA.width, 3), np.nan), 2.0)
    made = make_map([*frames[:2], empty, frames[3]], whole)
    assert (made.frames_used, made.frames_skipped) == (3, 1)


def test_no_frame_left_names_both_spans(make_map):
    frames, whole = survey(around(4))
    later = Trajectory(whole.times + 100, whole.poses)
    with pytest.raises(
        InputError, match=r"none of 4 frames .* from 0\.000 to 3\.000 s, the 4 poses from 100\.000 to 103"
    ):
        make_map(frames, later)
    with pytest.raises(InputError, match="no frames"):
        make_map([], whole)


def test_the_map_is_cropped_but_the_views_stay(make_map):
    frames, whole = survey(around(8))
    bounds = [[-0.5, -0.5, 0.05], [0.6, 0.5, 1.0]]
    made, full = make_map(frames, whole, bounds=bounds), make_map(frames, whole)
    inside = ((full.points >= bounds[0]) & (full.points <= bounds[1])).all(axis=1)
    assert 0 < inside.sum() < len(inside)
    np.testing.assert_array_equal(made.points, full.points[inside])
    np.testing.assert_array_equal(made.views.poses, full.views.poses)
    assert made.views.max_range == full.views.max_range


def test_points_beyond_the_range_are_left_out(make_map):
    frames, whole = survey(around(8))
    made = make_map(frames, whole, max_range=1.5)
    assert made.views.max_range == 1.5
    nearest = np.min([np.linalg.norm(made.points - pose[:3, 3], axis=1) for pose in made.poses], axis=0)
    # Voxels blur where the surface ends.
    assert nearest.max() < 1.6
    assert len(made.points) < len(make_map(frames, whole).points)


def test_the_views_see_the_map(make_map):
    frames, whole = survey(around(8))
    made = make_map(frames, whole)
    assert made.views.field_of_view == pytest.approx(CAMERA.field_of_view, abs=1e-6)
    seen = np.zeros(len(made.points), bool)
    for view in range(len(made.views)):
        seen |= made.views.in_field_of_view(made.views.in_camera(made.points, view))
    assert seen.mean() > 0.99


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bounds": [[0, 0, 0]]}, r"corner \[2, 3\]"),
        ({"bounds": [[0, 0, 0], [1, -1, 1]]}, "above upper"),
        ({"bounds": [[90, 90, 90], [91, 91, 91]]}, "in the bounds and in range"),
        ({"max_range": 0.01}, "in the bounds and in range"),
        ({"max_range": -1.0}, "max_range=-1.0"),
    ],
)
def test_settings_that_cannot_be(make_map, settings, message):
    frames, whole = survey(around(4))
    with pytest.raises(InputError, match=message):
        make_map(frames, whole, **settings)


def test_the_field_of_view_of_points_in_no_order_holds_them():
    frames, whole = survey(around(4))
    loose = [Frame(PointCloud.from_rows(frame.cloud.points), frame.time) for frame in frames]
    assert localised_map(loose, whole).views.field_of_view == pytest.approx(CAMERA.field_of_view, abs=1.5)
    scanner = [Frame(PointCloud.from_rows(frame.cloud.points - np.array([0, 0, 2])), frame.time) for frame in frames]
    assert localised_map(scanner, whole).views.field_of_view[0] == 360
