import json

import numpy as np
import pytest

from gmmjax.clouds import PointCloud, read_cloud
from gmmjax.errors import InputError
from gmmjax.reporting.frame_files import frame_archive, frame_folder, write_frame
from gmmjax.surveys import Frame, pose_matrix

POSE = pose_matrix([1.0, 2.0, 3.0], [0.0, 0.6, 0.0, 0.8])


def frame(time=5.0, seed=0):
    """An ordered frame of a wall, a fifth of the pixels without a return."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:6, :8]
    image = np.stack([(columns - 3.5) / 4, (rows - 2.5) / 4, np.full((6, 8), 2.0)], axis=-1)
    image[random.random((6, 8)) < 0.2] = np.nan
    return Frame.of_image(image.astype(np.float32), time, "camera")


def in_world(own):
    return own.cloud.points @ POSE[:3, :3].T + POSE[:3, 3]


@pytest.mark.parametrize("suffix", ["pcd", "ply", "npz"])
@pytest.mark.parametrize("pose", [None, POSE])
def test_a_frame_is_read_back(tmp_path, suffix, pose):
    write_frame(tmp_path / f"frame.{suffix}", frame(), pose)
    cloud = read_cloud(tmp_path / f"frame.{suffix}")
    expected = frame().cloud.points if pose is None else in_world(frame())
    np.testing.assert_allclose(cloud.points, expected, atol=0 if pose is None else 1e-6)
    if suffix == "pcd":
        assert cloud.rows.tolist() == frame().cloud.rows.tolist()
        np.testing.assert_allclose(cloud.views.poses[0], np.eye(4) if pose is None else POSE, atol=1e-9)


@pytest.mark.parametrize("suffix", ["pcd", "ply"])
@pytest.mark.parametrize("ordered", [False, True])
def test_colours_and_fields_stay(tmp_path, suffix, ordered):
    points = np.array([[0, 0, 1], [np.nan, 0, 0], [0, 1, 1], [1, 1, 1.0]])
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3)
    cloud = PointCloud.from_rows(points, colors, {"ring": np.arange(4, dtype=np.uint16)})
    size = {"width": 2, "height": 2} if ordered else {}
    write_frame(tmp_path / f"frame.{suffix}", Frame(cloud, 0.0, **size))
    found = read_cloud(tmp_path / f"frame.{suffix}")
    assert found.colors.tolist() == cloud.colors.tolist()
    assert found.fields["ring"].tolist() == [0, 2, 3]
    assert found.fields["ring"].dtype == np.uint16


def test_far_coordinates_keep_their_digits(tmp_path):
    points = np.array([[4_500_000.123, 0.0, 1.0]])
    write_frame(tmp_path / "frame.pcd", Frame(PointCloud.from_rows(points), 0.0))
    assert read_cloud(tmp_path / "frame.pcd").points.tolist() == points.tolist()


@pytest.mark.parametrize("poses", [[None, None], [POSE, POSE], [None, POSE]])
def test_an_archive_of_frames(tmp_path, poses):
    own = [frame(5.0, 0), frame(6.0, 1)]
    with frame_archive(tmp_path / "frames.npz") as add:
        for each, pose in zip(own, poses, strict=True):
            add(each, pose)
    with np.load(tmp_path / "frames.npz", allow_pickle=False) as arrays:
        assert set(arrays) == {"points", "frame", "times"} | ({"poses"} if poses[0] is not None else set())
        expected = np.concatenate(
            [each.cloud.points if pose is None else in_world(each) for each, pose in zip(own, poses, strict=True)]
        )
        np.testing.assert_allclose(arrays["points"], expected, atol=1e-12)
        assert np.bincount(arrays["frame"]).tolist() == [len(each.cloud) for each in own]
        assert arrays["times"].tolist() == [5.0, 6.0]
    assert len(read_cloud(tmp_path / "frames.npz")) == len(expected)
    assert [path.name for path in tmp_path.iterdir()] == ["frames.npz"]


@pytest.mark.parametrize("suffix", ["pcd", "ply"])
def test_a_folder_of_frames(tmp_path, suffix):
    with frame_folder(tmp_path / "frames", suffix) as add:
        add(frame(5.0, 0), None)
        add(frame(6.0, 1), POSE)
    listed = json.loads((tmp_path / "frames" / "frames.json").read_text())["frames"]
    assert [entry["file"] for entry in listed] == [f"frame_000000.{suffix}", f"frame_000001.{suffix}"]
    assert [entry["time"] for entry in listed] == [5.0, 6.0]
    assert "pose" not in listed[0]
    np.testing.assert_array_equal(listed[1]["pose"], POSE)
    for entry in listed:
        assert len(read_cloud(tmp_path / "frames" / entry["file"])) == entry["points"]


def test_a_folder_is_replaced_by_one_of_fewer_frames(tmp_path):
    for count in (3, 1):
        with frame_folder(tmp_path / "frames", "pcd", overwrite=True) as add:
            for index in range(count):
                add(frame(float(index)), None)
    assert {path.name for path in (tmp_path / "frames").iterdir()} == {"frame_000000.pcd", "frames.json"}
    with pytest.raises(InputError, match="holds a previous folder of frames"), frame_folder(tmp_path / "frames", "pcd"):
        pass


def test_no_frames_leave_nothing(tmp_path):
    with pytest.raises(InputError, match="no frames to write"), frame_archive(tmp_path / "frames.npz"):
        pass
    with pytest.raises(InputError, match="no frames to write"), frame_folder(tmp_path / "frames", "ply"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_another_ending_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"\.pcd, \.ply, \.npz"):
        write_frame(tmp_path / "frame.las", frame())
