import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews, read_cloud, viewpoint_of, write_pcd
from gmmjax.errors import InputError
from tests.clouds.test_ordered_frame import HEIGHT, WIDTH, depth_frame


def pose(seed):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = np.random.default_rng(seed).uniform(-3, 3, 3)
    return matrix


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_points_in_no_order(tmp_path, kind):
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(kind)
    write_pcd(tmp_path / "cloud.pcd", points)
    cloud = read_cloud(tmp_path / "cloud.pcd")
    np.testing.assert_array_equal(cloud.points, points.astype(np.float64))
    assert cloud.views is None and cloud.rows_dropped == 0
    header = (tmp_path / "cloud.pcd").read_bytes()[:300]
    assert b"WIDTH 50\nHEIGHT 1\n" in header and f"SIZE {' '.join([str(kind().itemsize)] * 3)}\n".encode() in header


def test_a_frame_in_its_own_coordinates_has_its_view(tmp_path):
    points = depth_frame().reshape(HEIGHT, WIDTH, 3)
    write_pcd(tmp_path / "frame.pcd", points)
    cloud = read_cloud(tmp_path / "frame.pcd")
    kept = np.isfinite(points).all(axis=2).ravel()
    np.testing.assert_array_equal(cloud.points, points.reshape(-1, 3)[kept])
    np.testing.assert_array_equal(cloud.rows, np.flatnonzero(kept))
    np.testing.assert_array_equal(cloud.views.poses[0], np.eye(4))


@given(st.integers(0, 1000))
def test_a_frame_in_the_world_has_its_pose(tmp_path_factory, seed):
    path = tmp_path_factory.mktemp("pcd") / "frame.pcd"
    to_world = pose(seed)
    points = depth_frame(seed) @ to_world[:3, :3].T + to_world[:3, 3]
    write_pcd(path, points.reshape(HEIGHT, WIDTH, 3).astype(np.float32), viewpoint=viewpoint_of(to_world))
    views = read_cloud(path).views
    np.testing.assert_allclose(views.poses[0], to_world, atol=1e-12)
    expected = SensorViews.at_origin(depth_frame(seed)[np.isfinite(depth_frame(seed)[:, 0])])
    assert views.field_of_view == pytest.approx(expected.field_of_view, abs=0.01)


def test_colours_and_fields(tmp_path):
    random = np.random.default_rng(0)
    points = random.normal(size=(4, 5, 3))
    colors = random.integers(0, 256, (4, 5, 3), np.uint8)
    fields = {
        "label": random.integers(-9, 9, (4, 5), np.int64),
        "confidence": random.random((4, 5)).astype(np.float16),
        "edge": random.random((4, 5)) > 0.5,
    }
    write_pcd(tmp_path / "cloud.pcd", points, colors=colors, fields=fields)
    cloud = read_cloud(tmp_path / "cloud.pcd")
    np.testing.assert_array_equal(cloud.colors, colors.reshape(-1, 3))
    assert list(cloud.fields) == list(fields)
    for name, values in fields.items():
        np.testing.assert_array_equal(cloud.fields[name], values.ravel())


def test_open3d_reads_it(open3d, tmp_path):
    points = np.random.default_rng(0).normal(size=(30, 3)).astype(np.float32)
    colors = np.random.default_rng(1).integers(0, 256, (30, 3), np.uint8)
    write_pcd(tmp_path / "cloud.pcd", points, colors=colors, fields={"label": np.arange(30)})
    cloud = open3d.io.read_point_cloud(str(tmp_path / "cloud.pcd"))
    np.testing.assert_allclose(np.asarray(cloud.points), points)
    np.testing.assert_allclose(np.asarray(cloud.colors) * 255, colors)


@pytest.mark.parametrize(
    ("points", "settings", "message"),
    [
        (np.full((3, 3), np.nan), {}, "NaN or inf"),
        (np.where(np.arange(3) == 0, np.nan, np.ones((2, 2, 3))), {}, "NaN or inf"),
        (np.full((2, 2, 3), np.inf), {}, "NaN or inf"),
        (np.ones((2, 2, 2, 3)), {}, r"must have shape \[N, 3\]"),
        (np.ones((4, 2)), {}, r"must have shape \[N, 3\]"),
        (np.ones((4, 3)), {"viewpoint": (0.0,) * 7}, "length 1"),
        (np.ones((4, 3)), {"viewpoint": (0.0, 0.0, 0.0, 1.0)}, "position x y z and a quaternion"),
        (np.ones((4, 3)), {"viewpoint": (np.nan, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)}, "position x y z and a quaternion"),
        (np.ones((4, 3)), {"colors": np.ones((4, 3))}, "colors must be uint8"),
        (np.ones((4, 3)), {"colors": np.ones((3, 3), np.uint8)}, "colors must be uint8"),
        (np.ones((4, 3)), {"fields": {"x": np.ones(4)}}, "field 'x'"),
        (np.ones((4, 3)), {"fields": {"two words": np.ones(4)}}, "field 'two words'"),
        (np.ones((4, 3)), {"fields": {"_": np.ones(4)}}, "field '_'"),
        (np.ones((4, 3)), {"fields": {"label": np.ones(3)}}, r"must be numbers \[4\]"),
        (np.ones((4, 3)), {"fields": {"label": np.array(["a"] * 4)}}, r"must be numbers \[4\]"),
    ],
)
def test_what_pcd_cannot_hold(tmp_path, points, settings, message):
    path = tmp_path / "cloud.pcd"
    path.write_text("as it was")
    with pytest.raises(InputError, match=message) as caught:
        write_pcd(path, points, **settings)
    assert str(path) in str(caught.value)
    assert path.read_text() == "as it was" and list(tmp_path.iterdir()) == [path]
