import json

import numpy as np
import pytest

from gmmjax.cli import main
from gmmjax.clouds import read_cloud, read_views
from gmmjax.surveys import Frame, write_bag
from gmmjax.thesis.laboratory import recorded_run
from tests.surveys.recordings import CLOUDS, POSES, SENSOR_ON_BODY, START, frame, frames, trajectory


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag whose poses end before its frames do: the last three have none."""
    path = tmp_path_factory.mktemp("bag") / "run.bag"
    write_bag(path, frames(13), trajectory(), sensor_on_body=SENSOR_ON_BODY)
    return path


def extract(source, *options):
    return main(["extract", str(source), *map(str, options)])


def failed(capsys, source, *options):
    """What a run that must end in status 2 says: one line, on standard error."""
    assert extract(source, *options) == 2
    captured = capsys.readouterr()
    assert not captured.out
    assert captured.err.startswith("gmmjax: error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def in_world(own):
    pose = trajectory().of_sensor(SENSOR_ON_BODY).at([own.time])[0][0]
    return own.cloud.points @ pose[:3, :3].T + pose[:3, 3]


def test_the_topics_are_listed(bag, capsys):
    assert extract(bag) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "2.4 s from 1600000000.000 (2020-09-13 12:26:40 UTC)" in lines[0]
    assert lines[2].split() == [CLOUDS, "sensor_msgs/PointCloud2", "13", "5", "+0.000", "+2.400"]
    assert [line.split()[0] for line in lines[3:]] == [POSES, "/tf", "/tf_static"]


@pytest.mark.parametrize("time", ["+0.75", f"{START + 0.75}"])
@pytest.mark.parametrize("suffix", ["pcd", "ply", "npz"])
def test_the_frame_at_a_time(bag, tmp_path, capsys, time, suffix):
    out = tmp_path / f"frame.{suffix}"
    assert extract(bag, "--topic", CLOUDS, "--at", time, "--out", out) == 0
    points = frames()[4].cloud.points.astype(np.float32)
    np.testing.assert_array_equal(read_cloud(out).points, points)
    printed = capsys.readouterr().out
    assert f"frame.{suffix}  {len(points)} points at 1600000000.800 s" in printed


@pytest.mark.parametrize(
    "poses",
    [
        ["--poses", POSES],
        ["--poses", "/tf"],
        ["--poses", "/tf", "--parent", "world", "--child", "body"],
        ["--poses", POSES, "--sensor-on-body", "0.1", "0", "0.05", "0.5", "0.5", "0.5", "0.5"],
    ],
)
def test_a_frame_with_its_pose(bag, tmp_path, poses):
    out = tmp_path / "frame.pcd"
    assert extract(bag, "--at", "+0.8", "--out", out, *poses, "--quiet") == 0
    cloud = read_cloud(out)
    np.testing.assert_allclose(cloud.points, in_world(frames()[4]), atol=1e-5)
    expected = trajectory().of_sensor(SENSOR_ON_BODY).at([START + 0.8])[0]
    np.testing.assert_allclose(cloud.views.poses, expected, atol=1e-5)


def test_many_frames_in_an_archive(bag, tmp_path, capsys):
    assert extract(bag, "--every", 2, "--out", tmp_path / "frames.npz", "--poses", POSES) == 0
    with np.load(tmp_path / "frames.npz", allow_pickle=False) as arrays:
        np.testing.assert_allclose(arrays["times"], START + 0.4 * np.arange(6), atol=1e-6)
        expected = np.concatenate([in_world(own) for own in frames(11)[::2]])
        np.testing.assert_allclose(arrays["points"], expected, atol=1e-5)
        assert arrays["poses"].shape == (6, 4, 4)
    assert "6 frames, 1 left out, because no pose is near" in capsys.readouterr().out


def test_many_frames_in_a_folder(bag, tmp_path):
    out = tmp_path / "frames"
    assert extract(bag, "--rate", 2.5, "--start", "+0.9", "--end", "+2.0", "--format", "ply", "--out", out) == 0
    listed = json.loads((out / "frames.json").read_text())["frames"]
    np.testing.assert_allclose([entry["time"] - START for entry in listed], [1.0, 1.4, 1.8], atol=1e-6)
    assert all((out / entry["file"]).suffix == ".ply" for entry in listed)


def test_a_localised_map(bag, tmp_path, capsys):
    out = tmp_path / "before.ply"
    assert extract(bag, "--map", "localised", "--every", 3, "--out", out, "--poses", "/tf") == 0
    expected = np.concatenate([in_world(own) for own in frames(11)[::3]])
    np.testing.assert_allclose(read_cloud(out).points, expected, atol=1e-5)
    assert len(read_views(tmp_path / "before_views.json")) == 4
    assert "4 frames, 1 left out" in capsys.readouterr().out


def test_a_map_is_cropped(bag, tmp_path):
    out = tmp_path / "map.ply"
    box = ["--crop", 0, -9, -9, 2, 9, 9]
    assert extract(bag, "--map", "localised", "--out", out, "--poses", "/tf", *box, "--quiet") == 0
    points = read_cloud(out).points
    assert 0 < len(points) < sum(len(own.cloud) for own in frames(11))
    assert points[:, 0].min() >= 0
    assert points[:, 0].max() <= 2


def test_a_depth_image(tmp_path, capsys):
    depth = np.full((6, 8), 1500, np.uint16)
    depth[0, 0] = 0
    np.save(tmp_path / "depth.npy", depth)
    camera = {"fx": 8.0, "fy": 8.0, "cx": 3.5, "cy": 2.5, "width": 8, "height": 6}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    options = ["--intrinsics", tmp_path / "camera.json", "--out", tmp_path / "frame.pcd"]
    assert "--depth-unit 0.001" in failed(capsys, tmp_path / "depth.npy", *options)
    assert extract(tmp_path / "depth.npy", *options, "--depth-unit", "0.001") == 0
    cloud = read_cloud(tmp_path / "frame.pcd")
    np.testing.assert_allclose(cloud.points[:, 2], 1.5, atol=1e-6)
    assert (len(cloud), cloud.rows[0]) == (47, 1)
    assert "47 points of 8 x 6 pixels" in capsys.readouterr().out


def test_an_output_is_replaced_only_when_told(bag, tmp_path, capsys):
    out = ["--at", "+0.8", "--out", tmp_path / "frame.pcd"]
    assert extract(bag, *out, "--quiet") == 0
    assert "--overwrite replaces it" in failed(capsys, bag, *out)
    assert extract(bag, *out, "--quiet", "--overwrite") == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--at", "+0.8"], "--out is missing"),
        (["--out", "frame.pcd"], "give one of --at, --every or --rate, --map"),
        (["--at", "+1", "--every", "2", "--out", "frame.pcd"], "not --at and --every or --rate"),
        (["--at", "noon", "--out", "frame.pcd"], "--at noon: must be seconds"),
        (["--at", "+60", "--out", "frame.pcd"], "the nearest is at 1600000002.400"),
        (["--at", "+1", "--out", "frame.txt"], "must end in .pcd, .ply, .npz"),
        (["--every", "2", "--out", "frames.ply"], "must end in .npz, or be a folder"),
        (["--every", "0", "--out", "frames.npz"], "every=0 must be at least 1"),
        (["--at", "+1", "--out", "none/frame.pcd"], "there is no folder none"),
        (["--at", "+1", "--topic", "/points", "--out", "frame.pcd"], f"no topic /points; the topics are: {CLOUDS}"),
        (["--at", "+1", "--topic", "/tf", "--out", "frame.pcd"], "which are no point clouds"),
        (["--at", "+2.4", "--poses", "/tf", "--out", "frame.pcd"], "none of 1 frames can be used"),
        (["--every", "1", "--start", "+60", "--out", "frames.npz"], "no frames to write"),
        (["--every", "1", "--start", "+2.15", "--poses", "/tf", "--out", "frames"], "none of 2 frames can be used"),
        (["--map", "localised", "--out", "map.ply"], "with --poses"),
        (["--map", "localised", "--poses", POSES, "--out", "map.pcd"], "must end in .ply"),
    ],
)
def test_bad_input_leaves_nothing(bag, tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    assert words in failed(capsys, bag, *options)
    assert list(tmp_path.iterdir()) == []


def test_a_depth_image_takes_no_options_of_a_bag(tmp_path, capsys):
    np.save(tmp_path / "depth.npy", np.ones((2, 2)))
    out = ["--out", tmp_path / "frame.pcd"]
    assert "needs the intrinsics" in failed(capsys, tmp_path / "depth.npy", *out)
    assert "give nothing of --at" in failed(capsys, tmp_path / "depth.npy", *out, "--at", "+1")
    assert "--out is missing" in failed(capsys, tmp_path / "depth.npy")


def test_a_sensor_that_is_not_known_to_be_on_the_body_is_said(tmp_path, capsys):
    path = tmp_path / "run.bag"
    write_bag(path, [frame(START), frame(START + 0.2, name="lidar")], trajectory())
    assert extract(path, "--at", "+0", "--out", tmp_path / "frame.pcd", "--poses", POSES, "--child", "arm") == 0
    assert "gmmjax: warning: " in capsys.readouterr().err


def test_a_volumetric_map(tmp_path, open3d):
    """Three frames of a wall that the sensor moves along."""
    path, out = tmp_path / "run.mcap", tmp_path / "after.ply"
    rows, columns = np.mgrid[:60, :80]
    wall = np.stack([(columns - 39.5) / 60, (rows - 29.5) / 60, np.ones((60, 80))], axis=-1)
    write_bag(path, [Frame.of_image(wall, START + 0.2 * index, "haz_cam") for index in range(3)], trajectory())
    options = ["--map", "volumetric", "--poses", POSES, "--child", "haz_cam", "--voxel-size", "0.02", "--quiet"]
    assert extract(path, "--out", out, *options) == 0
    assert len(read_cloud(out)) > 500
    assert len(read_views(tmp_path / "after_views.json")) == 3


def test_the_frames_of_a_volumetric_map_are_refined(tmp_path, open3d):
    """Of a corner whose poses are off, every frame by its own centimetre: its floor gets thinner."""
    recording = recorded_run("run5", 0, frames=8)
    path = tmp_path / "run.bag"
    write_bag(path, recording.frames, recording.localised, sensor_on_body=recording.sensor_on_body)
    thickness = {}
    for name, refine in (("plain", []), ("refined", ["--refine"])):
        out = tmp_path / f"{name}.ply"
        options = ["--map", "volumetric", "--poses", POSES, "--voxel-size", "0.02", "--quiet"]
        assert extract(path, "--out", out, *options, *refine) == 0
        points = read_cloud(out).points
        floor = points[(np.abs(points[:, :2]) < 0.5).all(axis=1) & (np.abs(points[:, 2]) < 0.1)]
        design = np.column_stack([floor[:, :2], np.ones(len(floor))])
        thickness[name] = np.std(floor[:, 2] - design @ np.linalg.lstsq(design, floor[:, 2], rcond=None)[0])
        assert len(read_views(tmp_path / f"{name}_views.json")) == 8
    assert thickness["refined"] < 0.8 * thickness["plain"]
