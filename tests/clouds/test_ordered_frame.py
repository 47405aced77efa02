import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews, read_cloud

WIDTH, HEIGHT, FOCAL = 32, 24, 30.0
IDENTITY = "0 0 0 1 0 0 0"


def depth_frame(seed=0, distortion=0.0):
    """Camera coordinates of the pixels of a pinhole camera, row by row; every seventh has no depth."""
    rows, columns = (grid.ravel() for grid in np.mgrid[:HEIGHT, :WIDTH])
    x, y = (columns - WIDTH / 2 + 0.5) / FOCAL, (rows - HEIGHT / 2 + 0.5) / FOCAL
    x, y = (tangent * (1 + distortion * (x * x + y * y)) for tangent in (x, y))
    depth = np.random.default_rng(seed).uniform(1, 3, len(x))
    points = np.stack([x, y, np.ones_like(x)], axis=1) * depth[:, None]
    points[::7] = np.nan
    return points


def pcd(points, viewpoint, width=WIDTH, height=HEIGHT):
    lines = [
        "VERSION 0.7",
        "FIELDS x y z",
        "SIZE 8 8 8",
        "TYPE F F F",
        "COUNT 1 1 1",
        f"WIDTH {width}",
        f"HEIGHT {height}",
        *([f"VIEWPOINT {viewpoint}"] if viewpoint is not None else []),
        f"POINTS {width * height}",
        "DATA binary",
    ]
    return "\n".join([*lines, ""]).encode() + points.astype("<f8").tobytes()


def test_a_frame_in_its_camera_s_coordinates(write_file):
    points = depth_frame()
    cloud = read_cloud(write_file("frame.pcd", pcd(points, IDENTITY)))
    assert cloud.rows_dropped == np.isnan(points[:, 0]).sum()
    expected = SensorViews.at_origin(cloud.points)
    np.testing.assert_array_equal(cloud.views.poses, expected.poses)
    assert cloud.views.field_of_view == pytest.approx(expected.field_of_view)
    assert cloud.views.max_range == pytest.approx(expected.max_range)


@pytest.mark.parametrize("seed", range(4))
def test_a_frame_in_the_world(write_file, seed):
    turned, place = Rotation.random(random_state=seed), np.array([3.0, -1, 0.5])
    w, (x, y, z) = turned.as_quat()[3], turned.as_quat()[:3]
    points = depth_frame(seed) @ turned.as_matrix().T + place
    cloud = read_cloud(write_file("frame.pcd", pcd(points, f"3 -1 0.5 {w} {x} {y} {z}")))
    np.testing.assert_allclose(cloud.views.poses[0, :3, :3], turned.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(cloud.views.poses[0, :3, 3], place)
    assert cloud.views.in_field_of_view(cloud.views.in_camera(cloud.points, 0)).all()


def test_lens_distortion_is_no_matter(write_file):
    assert read_cloud(write_file("frame.pcd", pcd(depth_frame(distortion=0.1), IDENTITY))).views is not None


@pytest.mark.parametrize(
    ("points", "viewpoint"),
    [
        (depth_frame(), None),
        (depth_frame(), ""),
        (depth_frame(), "0 0 0 1 0 0"),
        (depth_frame(), "0 0 0 one 0 0 0"),
        (depth_frame(), "0 0 0 nan 0 0 0"),
        (depth_frame(), "0 0 0 0 0 0 0"),
        (depth_frame(), "0 0 0 2 0 0 0"),
        (depth_frame(), "0 0 0 1e300 0 0 1"),
        (depth_frame(), "1e308 0 0 1 0 0 0"),
        (depth_frame() * 1e300, "0 0 0 1 0 0 0.01"),
        (depth_frame(), "0 0 0 0 0 0 1"),
        (depth_frame(), "0.6 0 0 1 0 0 0"),
        (depth_frame(), "0 0 2 1 0 0 0"),
        (-depth_frame(), IDENTITY),
        (depth_frame()[:, [2, 0, 1]], IDENTITY),
        (np.random.default_rng(0).permutation(depth_frame()), IDENTITY),
        (depth_frame() + np.array([0, 0, 5.0]), IDENTITY),
    ],
    ids=[
        "no line",
        "empty line",
        "six numbers",
        "a word",
        "nan",
        "no quaternion",
        "not a unit quaternion",
        "a huge quaternion",
        "a huge position",
        "huge points, turned",
        "upside down",
        "beside",
        "in front",
        "points behind",
        "z up",
        "not in order",
        "moved away",
    ],
)
def test_a_pose_is_never_guessed(write_file, points, viewpoint):
    assert read_cloud(write_file("frame.pcd", pcd(points, viewpoint))).views is None


def test_unordered_points_have_no_view(write_file):
    points = depth_frame()
    cloud = read_cloud(write_file("cloud.pcd", pcd(points, IDENTITY, width=len(points), height=1)))
    assert cloud.views is None
    few = points[1:7]
    assert read_cloud(write_file("few.pcd", pcd(few, IDENTITY, width=3, height=2))).views is None
