import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from gmmjax.errors import InputError
from gmmjax.surveys import Frame, Trajectory, open_bag, write_bag
from tests.surveys.recordings import BAGS, CLOUDS, SENSOR_ON_BODY, frames, trajectory


def messages(path):
    """All messages of a bag as rosbags reads them: topic, time and message."""
    with AnyReader([path]) as reader:
        return [
            (connection.topic, time, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
        ]


def plain_points(message):
    """The coordinates in a message, whose points are three numbers of four bytes."""
    assert [(field.name, field.offset) for field in message.fields] == [("x", 0), ("y", 4), ("z", 8)]
    assert {field.datatype for field in message.fields} == {7}
    assert (message.is_bigendian, message.point_step, message.row_step) == (False, 12, 12 * message.width)
    return message.data.copy().view("<f4").reshape(message.height, message.width, 3)


def rows_of(frame):
    """The points of a frame as float32, in the order in which they are sent."""
    return (frame.cloud.points[None] if frame.width is None else frame.image()).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("ordered", [False, True])
def test_another_reader_gets_the_same_points(tmp_path, name, ordered):
    own = frames(3)
    if not ordered:
        own = [Frame(frame.cloud.from_rows(frame.cloud.points), frame.time, frame.name) for frame in own]
    write_bag(tmp_path / name, own, trajectory())
    clouds = [(time, message) for topic, time, message in messages(tmp_path / name) if topic == CLOUDS]
    for frame, (time, message) in zip(own, clouds, strict=True):
        assert message.is_dense is not ordered
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


def test_the_name_of_the_sensor(tmp_path):
    unnamed = [Frame(frame.cloud, frame.time, "", frame.width, frame.height) for frame in frames(2)]
    write_bag(tmp_path / "run.bag", unnamed, trajectory())
    found = messages(tmp_path / "run.bag")
    assert {message.header.frame_id for topic, _, message in found if topic == CLOUDS} == {"haz_cam"}
    with open_bag(tmp_path / "run.bag") as bag:
        assert bag.transforms().frames == ("body", "haz_cam", "world")


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
