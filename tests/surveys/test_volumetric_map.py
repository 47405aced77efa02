import sys

import numpy as np
import pytest

from gmmjax import detect_changes
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.scenes.ray_casting import Solid
from gmmjax.surveys import Frame, Trajectory, localised_map, volumetric_map
from tests.surveys.seen_room import CAMERA, SOLIDS, around, distance_to_surfaces, motion, off, survey

pytestmark = pytest.mark.usefixtures("open3d")


@pytest.mark.parametrize(("noise", "middle", "most"), [(0.0, 0.0015, 0.012), (0.008, 0.005, 0.025)])
def test_points_lie_on_the_surfaces(noise, middle, most):
    frames, trajectory = survey(around(16), noise)
    made = volumetric_map(frames, trajectory, voxel_size=0.02)
    apart = distance_to_surfaces(made.points)
    assert len(made.points) > 20_000
    assert np.median(apart) < middle and np.quantile(apart, 0.99) < most
    np.testing.assert_allclose(np.linalg.norm(made.normals, axis=1), 1, atol=0.01)


def test_half_a_pixel_is_not_lost():
    """A floor that is seen aslant is where it is, in a grid that is not along it."""
    frames, trajectory = survey(around(8))
    way = motion(2)
    made = volumetric_map(frames, Trajectory(trajectory.times, way @ trajectory.poses), voxel_size=0.02)
    heights = ((made.points - way[:3, 3]) @ way[:3, :3])[:, 2]
    assert abs(np.median(heights[np.abs(heights) < 0.03])) < 0.0005


def test_normals_point_to_where_the_surface_was_seen_from():
    frames, trajectory = survey(around(8))
    made = volumetric_map(frames, trajectory, voxel_size=0.02)
    floor = (np.abs(made.points[:, 2]) < 0.005) & (np.abs(made.points[:, :2]).max(axis=1) < 1.4)
    assert np.median(made.normals[floor, 2]) > 0.99


def test_a_motion_of_the_trajectory_moves_the_map():
    frames, trajectory = survey(around(8))
    way = motion(1)
    moved = volumetric_map(frames, Trajectory(trajectory.times, way @ trajectory.poses), voxel_size=0.02)
    back = (moved.points - way[:3, 3]) @ way[:3, :3]
    assert np.quantile(distance_to_surfaces(back), 0.99) < 0.012
    still = volumetric_map(frames, trajectory, voxel_size=0.02)
    assert len(back) == pytest.approx(len(still.points), rel=0.2)


def test_pixels_that_fly_at_edges_vanish():
    frames, trajectory = survey(around(8))
    random = np.random.default_rng(0)
    for index, frame in enumerate(frames):
        image = frame.image()
        flying = random.random(image.shape[:2]) < 0.01
        image[flying] *= random.uniform(0.4, 0.8, (flying.sum(), 1))
        frames[index] = Frame.of_image(image, frame.time)
    assert (distance_to_surfaces(localised_map(frames, trajectory).points) > 0.1).sum() > 200
    made = volumetric_map(frames, trajectory, voxel_size=0.02)
    assert (distance_to_surfaces(made.points) > 0.1).sum() < 5


def test_small_voxels_keep_a_truncation_beyond_the_noise():
    frames, trajectory = survey(around(16), 0.01)
    bounds = [[-0.3, -0.5, 0.05], [0.5, 0.3, 0.6]]
    made = volumetric_map(frames, trajectory, voxel_size=0.006, bounds=bounds)
    assert np.quantile(distance_to_surfaces(made.points), 0.95) < 0.02


def test_each_frame_has_its_own_camera():
    poses = around(8)
    frames, trajectory = survey(poses)
    half = [Frame.of_image(frame.image()[:, : CAMERA.width // 2], frame.time) for frame in frames]
    made = volumetric_map([*frames[::2], *half[1::2]], trajectory, voxel_size=0.02)
    assert np.quantile(distance_to_surfaces(made.points), 0.99) < 0.012


def test_frames_in_no_order_or_of_no_camera():
    frames, trajectory = survey(around(4))
    loose = [Frame(PointCloud.from_rows(frame.cloud.points), frame.time) for frame in frames]
    with pytest.raises(InputError, match="in no order"):
        volumetric_map(loose, trajectory)
    turned = [Frame.of_image(frame.image()[:, :, [2, 0, 1]], frame.time) for frame in frames]
    with pytest.raises(InputError, match="intrinsics"):
        volumetric_map(turned, trajectory)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"voxel_size": 0.0}, "voxel_size=0.0"),
        ({"voxel_size": np.inf}, "voxel_size=inf"),
    ],
)
def test_settings_that_cannot_be(settings, message):
    frames, trajectory = survey(around(4))
    with pytest.raises(InputError, match=message):
        volumetric_map(frames, trajectory, **settings)


def test_without_open3d(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    frames, trajectory = survey(around(4))
    with pytest.raises(InputError, match=r"a volumetric map needs Open3D: pip install 'gmmjax\[open3d\]'"):
        volumetric_map(frames, trajectory)


def test_nothing_is_printed(capfd):
    frames, trajectory = survey(around(4))
    volumetric_map(frames, trajectory, voxel_size=0.02)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("make_map", [localised_map, volumetric_map])
def test_the_evidence_of_both_maps(make_map):
    """Between two surveys from other poses a box appeared, and nothing else."""
    box = Solid(np.array([0.7, 0.6, 0.151]), np.array([0.35, 0.3, 0.3]), yaw=0.5)
    before, after = (
        make_map(*survey(off(around(12), 0.05, 3.0, seed), 0.006, seed, solids))
        for seed, solids in ((1, SOLIDS), (2, [*SOLIDS, box]))
    )
    changes = detect_changes(before.points, after.points, views_before=before.views, views_after=after.views)
    assert [change.kind for change in changes.items] == ["appeared"]
    assert np.linalg.norm(changes.items[0].box.centre - box.centre) < 0.1
