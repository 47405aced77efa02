import contextlib
import re
import shutil
import sqlite3
import sys
import tracemalloc

import numpy as np
import pytest

from gmmjax.errors import InputError, InputWarning
from gmmjax.surveys import open_bag, sensor_trajectory, write_bag
from gmmjax.surveys.point_cloud2 import encode_cloud
from tests.surveys.recordings import (
    BAGS,
    CLOUDS,
    POSES,
    SENSOR_ON_BODY,
    START,
    Recorder,
    frame,
    frames,
    trajectory,
)

KIND = "sensor_msgs/msg/PointCloud2"


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """The same run in every form of bag."""
    folder = tmp_path_factory.mktemp("bags")
    for name in BAGS:
        write_bag(folder / name, frames(), trajectory(), sensor_on_body=SENSOR_ON_BODY)
    return folder


@pytest.fixture(params=BAGS)
def bag(bags, request):
    with open_bag(bags / request.param) as opened:
        yield opened


def recorded(path, *, delays=(0.0,), stamps=None, count=10):
    """A bag of frames, each recorded so long after its stamp; written by rosbags alone."""
    with Recorder(path) as recorder:
        for index in range(count):
            log_time = START + 0.2 * index
            stamp = log_time - delays[index % len(delays)] if stamps is None else stamps
            cloud = recorder.cloud(stamp, "camera", encode_cloud(frame(0.0, seed=index)))
            recorder.record("/points", KIND, cloud, log_time)
    return path


def test_topics(bag):
    found = {topic.name: (topic.type, topic.count) for topic in bag.topics()}
    assert found == {
        CLOUDS: (KIND, 10),
        POSES: ("nav_msgs/msg/Odometry", 21),
        "/tf": ("tf2_msgs/msg/TFMessage", 21),
        "/tf_static": ("tf2_msgs/msg/TFMessage", 1),
    }
    clouds = bag.topics()[0]
    assert clouds.start == pytest.approx(START, abs=1e-6)
    assert clouds.end == pytest.approx(START + 1.8, abs=2e-3)
    assert clouds.rate == pytest.approx(5, rel=1e-2)
    assert bag.topics()[3].rate is None
    assert (bag.start, bag.end) == pytest.approx((START, START + 2.0), abs=1e-6)


def test_frames_are_those_that_were_written(bag):
    found = list(bag.frames())
    assert len(found) == 10
    for own, expected in zip(found, frames(), strict=True):
        np.testing.assert_array_equal(own.cloud.points, expected.cloud.points.astype(np.float32))
        np.testing.assert_array_equal(own.cloud.rows, expected.cloud.rows)
        assert own.time == pytest.approx(expected.time, abs=1e-6)
        assert (own.name, own.width, own.height) == ("haz_cam", 8, 6)


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        ({"every": 4}, [0, 4, 8]),
        ({"rate": 2.0}, [0, 3, 5, 8]),
        ({"rate": 5.0}, list(range(10))),
        ({"rate": 100.0}, list(range(10))),
        ({"start": START + 0.5, "end": START + 1.2001}, [3, 4, 5, 6]),
        ({"start": START + 0.5, "every": 3}, [3, 6, 9]),
        ({"start": START + 50}, []),
        ({"end": START - 50}, []),
    ],
)
def test_which_frames_are_taken(bag, choice, expected):
    indices = [round((own.time - START) / 0.2) for own in bag.frames(CLOUDS, **choice)]
    assert indices == expected


def test_frames_that_come_a_little_early_are_taken_in_their_turn(tmp_path):
    path = recorded(tmp_path / "run.bag", delays=(0.0, 0.01, -0.01))
    with open_bag(path) as bag:
        assert len(list(bag.frames(rate=5.0))) == 10


@pytest.mark.parametrize("choice", [{"every": 0}, {"rate": 0.0}, {"rate": float("nan")}])
def test_a_choice_of_nothing_is_an_input_error(bag, choice):
    with pytest.raises(InputError, match=r"every=.* rate="):
        bag.frames(**choice)


def test_the_frame_nearest_in_time(bag):
    assert bag.frame_at(CLOUDS, START + 0.69).time == pytest.approx(START + 0.6, abs=1e-6)
    assert bag.frame_at(None, START + 0.71).time == pytest.approx(START + 0.8, abs=1e-6)
    assert bag.frame_at(None, START - 0.4).time == pytest.approx(START, abs=1e-6)
    assert bag.frame_at(None, START + 1e9, tolerance=float("inf")).time == pytest.approx(START + 1.8, abs=1e-6)


def test_no_frame_near_the_time_is_an_input_error(bag):
    with pytest.raises(
        InputError, match=rf"within 0\.5 s of .*nearest is at {START + 1.8:.3f} \(\+1\.800\).*the bag runs"
    ):
        bag.frame_at(None, START + 60)


@pytest.mark.parametrize("name", ["run.bag", "run"])
def test_the_time_is_that_of_the_stamp_not_of_the_record(tmp_path, name):
    path = recorded(tmp_path / name, delays=(3600.0, 3600.3))
    with open_bag(path) as bag:
        assert bag.frame_at(None, START - 3600 + 0.82).time == pytest.approx(START - 3600 + 0.8, abs=1e-6)
        assert len(list(bag.frames(start=START - 3600 + 0.75, end=START - 3600 + 1.25))) == 3
        with pytest.raises(InputError, match="no message of /points"):
            bag.frame_at(None, START)


def test_a_stamp_of_zero_gives_way_to_the_time_of_the_record(tmp_path):
    with open_bag(recorded(tmp_path / "run.bag", stamps=0.0)) as bag:
        assert bag.frame_at(None, START + 1.01).time == pytest.approx(START + 1.0, abs=1e-6)


def test_a_frame_is_read_through_the_index(bags, monkeypatch):
    """Of a long bag only the messages about the time are unpacked."""
    path = bags / "long.bag"
    write_bag(path, frames(120, height=2, width=2), trajectory(24.0))
    with open_bag(path) as bag:
        unpacked = []
        deserialize = bag._reader.deserialize
        monkeypatch.setattr(bag._reader, "deserialize", lambda *data: unpacked.append(1) or deserialize(*data))
        bag.frame_at(None, START + 12)
        assert 0 < len(unpacked) < 40


def max_memory(path):
    """The most memory that writing and reading a bag of sixty frames of 120 by 100 pixels takes."""
    many = (frame(START + 0.1 * index, 120, 100) for index in range(60))
    tracemalloc.start()
    try:
        write_bag(path, many, trajectory())
        written = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        with open_bag(path) as bag:
            assert sum(1 for _ in bag.frames()) == 60
        return max(written, tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3"])
def test_memory_does_not_grow_with_the_bag(tmp_path, name):
    # What is loaded and made once, such as a larger table of all names in the interpreter, is not the bag's.
    taken = [max_memory(tmp_path / f"{attempt}_{name}") for attempt in range(2)]
    assert min(taken) < 40 * 120 * 100 * 12


@pytest.mark.parametrize("little_endian", [False, True])
def test_messages_of_either_byte_order(tmp_path, little_endian):
    """The order of the message as ROS 2 sends it, which is not that of the points in it."""
    with Recorder(tmp_path / "run") as recorder:
        cloud = recorder.cloud(START, "camera", encode_cloud(frame(0.0)))
        recorder.record("/points", KIND, cloud, START, little_endian=little_endian)
    with open_bag(tmp_path / "run") as bag:
        (found,) = bag.frames()
    np.testing.assert_array_equal(found.cloud.points, frame(0.0).cloud.points.astype(np.float32))


def test_poses_of_odometry(bag):
    found, expected = bag.trajectory(POSES), trajectory()
    np.testing.assert_allclose(found.times, expected.times, atol=1e-6)
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-9)
    assert bag.body_of(POSES) == "body"


@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_poses_of_transforms(bag, topic):
    sensor = bag.trajectory(topic, child="haz_cam")
    np.testing.assert_allclose(sensor.poses, trajectory().poses @ SENSOR_ON_BODY, atol=1e-9)
    body = bag.trajectory(topic, "/world", "/body")
    np.testing.assert_allclose(body.poses, trajectory().poses, atol=1e-9)


@pytest.mark.parametrize("name", ["run.bag", "run"])
def test_every_kind_of_pose(tmp_path, name):
    """Messages that another writer made, with names as in old bags."""
    path, position = tmp_path / name, (1.0, 2.0, 3.0)
    with Recorder(path) as recorder:
        for index in range(3):
            time = START + index
            header, pose = recorder.header(time, "/world"), recorder.pose(position)
            stamped = recorder.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose)
            recorder.record("/pose", "geometry_msgs/msg/PoseStamped", stamped, time)
            uncertain = recorder.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
            kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
            recorder.record("/uncertain", kind, recorder.make(kind, header=header, pose=uncertain), time)
            moved = recorder.transform(time, "/world", "/body", position)
            recorder.record("/vicon", "geometry_msgs/msg/TransformStamped", moved, time)
            kind = "tf/msg/tfMessage" if name == "run.bag" else "tf2_msgs/msg/TFMessage"
            recorder.record("/tf", kind, recorder.make(kind, transforms=[moved]), time)
    with open_bag(path) as bag:
        for topic in ("/pose", "/uncertain", "/vicon"):
            found = bag.trajectory(topic)
            assert found.times.tolist() == [START, START + 1, START + 2]
            assert found.poses[1, :3, 3].tolist() == list(position)
        assert bag.trajectory("/tf", "world", "body").poses[1, :3, 3].tolist() == list(position)
        assert (bag.body_of("/pose"), bag.body_of("/vicon")) == ("", "body")


def test_poses_that_are_none_are_left_out(tmp_path):
    with Recorder(tmp_path / "run.bag") as recorder:
        for index, rotation in enumerate([(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)]):
            kind, time = "geometry_msgs/msg/PoseStamped", START + index
            pose = recorder.pose((0, 0, 0), rotation)
            recorder.record("/pose", kind, recorder.make(kind, header=recorder.header(time, "world"), pose=pose), time)
    with open_bag(tmp_path / "run.bag") as bag, pytest.warns(InputWarning, match="1 of 2 poses"):
        assert len(bag.trajectory("/pose")) == 1


@pytest.mark.parametrize("topic", [POSES, "/tf"])
def test_the_sensors_poses_from_whatever_the_bag_has(bag, topic):
    expected = trajectory().poses @ SENSOR_ON_BODY
    np.testing.assert_allclose(sensor_trajectory(bag, topic, "/haz_cam").poses, expected, atol=1e-9)
    own = sensor_trajectory(bag, topic, "haz_cam", child="body", sensor_on_body=np.eye(4))
    np.testing.assert_allclose(own.poses, trajectory().poses, atol=1e-9)


def test_poses_of_a_body_that_the_sensor_is_not_known_to_be_on(bag):
    with pytest.warns(InputWarning, match="'lidar' is on the body 'body' is not known.*--sensor-on-body"):
        found = sensor_trajectory(bag, POSES, "lidar")
    np.testing.assert_allclose(found.poses, trajectory().poses, atol=1e-9)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda bag: bag.frames("/points"), rf"no topic /points; the topics are: {CLOUDS} \({KIND}\), {POSES}"),
        (lambda bag: bag.frames("/tf"), "/tf is of type tf2_msgs/msg/TFMessage, which are no point clouds"),
        (lambda bag: bag.trajectory("/odom"), "no topic /odom"),
        (lambda bag: bag.trajectory(CLOUDS), "which are no poses"),
        (lambda bag: bag.trajectory("/tf"), "name the child.*body, haz_cam, world"),
        (lambda bag: bag.trajectory("/tf", child="moon"), "no frame 'moon'"),
    ],
)
def test_what_the_bag_does_not_have_is_an_input_error(bag, act, words):
    with pytest.raises(InputError, match=words):
        act(bag)


def test_two_topics_of_clouds_leave_a_choice(tmp_path):
    with Recorder(tmp_path / "run.bag") as recorder:
        for topic in ("/left", "/right"):
            recorder.record(topic, KIND, recorder.cloud(START, "camera", encode_cloud(frame(0.0))), START)
    with open_bag(tmp_path / "run.bag") as bag:
        with pytest.raises(InputError, match=r"2 topics of point clouds.*/left.*/right"):
            bag.cloud_topic()
        assert bag.cloud_topic("/left") == "/left"


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3"])
def test_a_bag_cut_off_anywhere_is_an_input_error(bags, tmp_path, name):
    data = (bags / name).read_bytes()
    cut = tmp_path / name
    with open_bag(bags / name) as bag:
        whole = list(bag.frames())
    for length in np.linspace(0, len(data) - 1, 10).astype(int):
        cut.write_bytes(data[:length])
        try:
            with open_bag(cut) as bag:
                found = list(bag.frames())
        except InputError as error:
            assert re.match(f"{cut}: (cannot be read|is empty) .*copy it again", str(error))
        else:
            # The end of a database need not hold what is asked for.
            assert name == "run.db3"
            assert [own.cloud.points.sum() for own in found] == [own.cloud.points.sum() for own in whole]


def test_messages_that_are_not_those_of_ros_are_refused(bags, tmp_path):
    data = (bags / "run.mcap").read_bytes()
    path = tmp_path / "run.mcap"
    path.write_bytes(data.replace(b"float64 y", b"float64 q"))
    with (
        pytest.raises(InputError, match=r"run\.mcap: defines geometry_msgs/msg/\w+ otherwise than ROS"),
        open_bag(path),
    ):
        pass


def test_a_quaternion_beyond_all_numbers_is_left_out(tmp_path):
    with Recorder(tmp_path / "run.bag") as recorder:
        for number, rotation in enumerate(((0.0, 0.0, 0.0, 1.0), (1e300, 0.0, 0.0, 1e300))):
            header = recorder.header(START + number, "map")
            kind = "geometry_msgs/msg/PoseStamped"
            pose = recorder.make(kind, header=header, pose=recorder.pose((1, 2, 3), rotation))
            recorder.record("/pose", kind, pose, START + number)
    with open_bag(tmp_path / "run.bag") as bag, pytest.warns(InputWarning, match="1 of 2 poses"):
        assert len(bag.trajectory("/pose")) == 1


@pytest.mark.parametrize(
    ("number", "value"), [("message_count", ".inf"), ("message_count", "-3"), ("nanoseconds_since_epoch", ".nan")]
)
def test_a_folder_whose_numbers_are_none_is_refused(bags, tmp_path, number, value):
    shutil.copytree(bags / "run", tmp_path / "run")
    metadata = tmp_path / "run" / "metadata.yaml"
    metadata.write_text(re.sub(rf"\b{number}: \d+", f"{number}: {value}", metadata.read_text()))
    with pytest.raises(InputError, match=r"run: cannot be read"), open_bag(tmp_path / "run") as bag:
        bag.topics()


def test_a_folder_whose_yaml_merges_maps_is_refused(tmp_path):
    # Each line would double the time.
    lines = ["a0: &a0 {x: 1}", *(f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}" for n in range(1, 60))]
    (tmp_path / "metadata.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"metadata\.yaml: merges maps"), open_bag(tmp_path):
        pass


@pytest.mark.parametrize("name", ["run.bag", "run.mcap"])
def test_a_damaged_bag_is_an_input_error_or_gives_frames(bags, tmp_path, name):
    data = bytearray((bags / name).read_bytes())
    damaged = tmp_path / name
    random = np.random.default_rng(0)
    for _ in range(12):
        place = int(random.integers(len(data) - 40))
        damaged.write_bytes(data[:place] + random.bytes(40) + data[place + 40 :])
        try:
            with open_bag(damaged) as bag:
                list(bag.frames(CLOUDS))
        except InputError as error:
            assert str(damaged) in str(error)


def test_a_folder_cut_off_is_an_input_error(bags, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "metadata.yaml").write_bytes((bags / "run" / "metadata.yaml").read_bytes())
    with pytest.raises(InputError, match=r"run: cannot be read .*missing"), open_bag(folder):
        pass


@pytest.mark.parametrize("which", ["", " WHERE topic_type = 'sensor_msgs/msg/PointCloud2'"])
def test_messages_without_definitions_are_those_of_ros(bags, tmp_path, which):
    """As ROS 2 recorded before Iron: the definitions, or some of them, are only in the programs that read."""
    path = tmp_path / "run.db3"
    path.write_bytes((bags / "run.db3").read_bytes())
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute(f"DELETE FROM message_definitions{which}")
    with open_bag(path) as bag:
        assert len(list(bag.frames())) == 10
        assert len(bag.trajectory(POSES)) == 21


def test_a_compression_that_cannot_be_read_is_an_input_error(bags, tmp_path):
    folder = shutil.copytree(bags / "run", tmp_path / "run")
    metadata = (folder / "metadata.yaml").read_text()
    compressed = metadata.replace("compression_format: ''", "compression_format: lz4").replace(
        "compression_mode: ''", "compression_mode: file"
    )
    assert compressed != metadata
    (folder / "metadata.yaml").write_text(compressed)
    with pytest.raises(InputError, match=r"'lz4' is not supported.*write it without compression"), open_bag(folder):
        pass


def test_without_rosbags_the_extra_is_named(bags, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(InputError, match=r"run\.bag: .*pip install '\.\[ros\]'"), open_bag(bags / "run.bag"):
        pass


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.bag", "no such file"),
        ("folder", "no metadata.yaml"),
        ("run.bag.active", "not closed; mend it with rosbag reindex"),
        ("cloud.ply", "is no bag by its ending; .*.mcap"),
    ],
)
def test_what_is_no_bag_is_an_input_error(tmp_path, name, words):
    (tmp_path / "folder").mkdir()
    for file in ("run.bag.active", "cloud.ply"):
        (tmp_path / file).write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(InputError, match=words), open_bag(tmp_path / name):
        pass
