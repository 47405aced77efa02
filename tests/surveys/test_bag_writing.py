import itertools

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from gmmjax.errors import InputError
from gmmjax.surveys import BagNames, Frame, Trajectory, open_bag, write_bag
from tests.surveys.recordings import BAGS, CLOUDS, SENSOR_ON_BODY, frames, trajectory

LETTERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def messages(path):
    """All messages of a bag as rosbags reads them: topic, time and message."""
    with AnyReader([path]) as reader:
        return [
            (connection.topic, time, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
        ]


def plain_points(message):
    """The coordinates in a message, one number after the other."""
    numbers = []
    for row, column in itertools.product(range(message.height), range(message.width)):
        start = row * message.row_step + column * message.point_step
        for field in message.fields:
            kind = np.dtype((">" if message.is_bigendian else "<") + LETTERS[field.datatype])
            where = slice(start + field.offset, start + field.offset + kind.itemsize)
            numbers.append(float(message.data[where].copy().view(kind)[0]))
    return np.array(numbers).reshape(message.height, message.width, 3)


def rows_of(frame):
    """The points of a frame as float32, in the order in which they are sent."""
    return (frame.cloud.points[None] if frame.width is None else frame.image()).astype(np.float32)


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("point_step", [12, 37])
@pytest.mark.parametrize("ordered", [False, True])
def test_another_reader_gets_the_same_points(tmp_path, name, big_endian, point_step, ordered):
    own = frames(3)
    if not ordered:
        own = [Frame(frame.cloud.from_rows(frame.cloud.points), frame.time, frame.name) for frame in own]
    write_bag(tmp_path / name, own, trajectory(), big_endian=big_endian, point_step=point_step)
    clouds = [(time, message) for topic, time, message in messages(tmp_path / name) if topic == CLOUDS]
    for frame, (time, message) in zip(own, clouds, strict=True):
        assert message.is_bigendian is big_endian
        assert (message.point_step, message.is_dense) == (point_step, not ordered)
        assert (message.height, message.width) == ((6, 8) if ordered else (1, len(frame.cloud)))
        np.testing.assert_array_equal(plain_points(message), rows_of(frame))
        assert abs(time - frame.time * 1e9) < 1000
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time
    with open_bag(tmp_path / name) as bag:
        for frame, found in zip(own, bag.frames(), strict=True):
            np.testing.assert_array_equal(found.cloud.points, frame.cloud.points.astype(np.float32))


@pytest.mark.parametrize("name", BAGS)
def test_messages_are_in_the_order_of_their_times(tmp_path, name):
    write_bag(tmp_path / name, frames(), trajectory(), sensor_on_body=SENSOR_ON_BODY)
    found = messages(tmp_path / name)
    assert [time for _, time, _ in found] == sorted(time for _, time, _ in found)
    (static,) = [message for topic, _, message in found if topic == "/tf_static"]
    (edge,) = static.transforms
    assert (edge.header.frame_id, edge.child_frame_id) == ("body", "haz_cam")
    moved = edge.transform.translation
    assert [moved.x, moved.y, moved.z] == SENSOR_ON_BODY[:3, 3].tolist()


def test_names_and_the_type_of_the_poses(tmp_path):
    names = BagNames(clouds="/points", poses="/pose", world="map", body="base", sensor="depth")
    unnamed = [Frame(frame.cloud, frame.time, "", frame.width, frame.height) for frame in frames(2)]
    write_bag(tmp_path / "run.bag", unnamed, trajectory(), names=names, pose_message="PoseStamped")
    found = messages(tmp_path / "run.bag")
    assert {topic for topic, _, _ in found} == {"/points", "/pose", "/tf", "/tf_static"}
    assert {message.header.frame_id for topic, _, message in found if topic == "/points"} == {"depth"}
    with open_bag(tmp_path / "run.bag") as bag:
        assert bag.transforms().frames == ("base", "depth", "map")
        assert {topic.type for topic in bag.topics() if topic.name == "/pose"} == {"geometry_msgs/msg/PoseStamped"}


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3"])
def test_the_same_run_gives_the_same_bytes(tmp_path, name):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        write_bag(tmp_path / folder / name, frames(), trajectory())
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


@pytest.mark.parametrize("name", BAGS)
def test_a_bag_that_fails_leaves_nothing(tmp_path, name):
    def failing():
        yield from frames(3)
        raise RuntimeError("no more light")

    with pytest.raises(RuntimeError, match="no more light"):
        write_bag(tmp_path / name, failing(), trajectory())
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_and_a_folder_is_not(tmp_path):
    for count in (2, 5):
        write_bag(tmp_path / "run.bag", frames(count), trajectory())
    with open_bag(tmp_path / "run.bag") as bag:
        assert len(list(bag.frames())) == 5
    write_bag(tmp_path / "run", frames(2), trajectory())
    with pytest.raises(InputError, match="folder that is there already"):
        write_bag(tmp_path / "run", frames(2), trajectory())


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda folder: write_bag(folder / "run.zip", [], trajectory()), "ends with .bag, .mcap or .db3"),
        (lambda folder: write_bag(folder / "none" / "run.bag", [], trajectory()), "create the folder"),
        (
            lambda folder: write_bag(folder / "run.bag", [], Trajectory(np.array([-5.0]), np.eye(4)[None])),
            "times from 1970",
        ),
        (
            lambda folder: write_bag(folder / "run.bag", [], trajectory(), sensor_on_body=2 * np.eye(4)),
            "sensor_on_body: pose 0 of 1 is not rigid",
        ),
    ],
)
def test_what_cannot_be_written_is_an_input_error(tmp_path, act, words):
    with pytest.raises(InputError, match=words):
        act(tmp_path)
    assert list(tmp_path.iterdir()) == []
