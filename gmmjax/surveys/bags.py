"""ROS bags, of ROS 1 and ROS 2, read without ROS: their topics, frames and poses."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from gmmjax.errors import InputError, warn
from gmmjax.surveys.bag_opening import CLOUD_TYPES, open_reader, readable
from gmmjax.surveys.bag_poses import POSE_TYPES, TF_TYPES, frame_name, frames_of_pose, pose_trajectory, transform_tree
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.point_cloud2 import decode_frame, header_time
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory
from gmmjax.surveys.transforms import TransformTree

# How far (seconds) the delay between a message's own stamp and its record may vary within a bag.
DELAY_JITTER = 2.0
# A frame that is early by this share of the period is still taken for its turn.
PERIOD_JITTER = 0.1
NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes:
        name: with its slash.
        type: of its messages, such as "sensor_msgs/msg/PointCloud2".
        count: how many messages.
        start: when the first was recorded, seconds since 1970; None where there is no message.
        end: when the last was recorded, to a millisecond.
    """

    name: str
    type: str
    count: int
    start: float | None
    end: float | None

    @property
    def rate(self) -> float | None:
        """Messages a second, or None where there are too few to tell."""
        if self.start is None or self.end is None or self.count < 2 or self.end <= self.start:
            return None
        return (self.count - 1) / (self.end - self.start)


class Bag:
    """A bag that is open; see `open_bag`."""

    def __init__(self, path: Path, reader: Any) -> None:
        self.path = path
        self._reader = reader
        self._delays: dict[str, float] = {}
        self._tree: TransformTree | None = None
        self._types = {name: info.msgtype or "several types" for name, info in reader.topics.items()}
        self._connections = {name: list(info.connections) for name, info in reader.topics.items()}

    @property
    def start(self) -> float:
        """When the first message was recorded, seconds since 1970."""
        return float(self._reader.start_time) / NANOSECONDS

    @property
    def end(self) -> float:
        """When the last message was recorded."""
        return float(self._reader.end_time - 1) / NANOSECONDS

    def topics(self) -> tuple[Topic, ...]:
        """All topics, by name."""
        return tuple(self._topic(name) for name in sorted(self._types))

    def cloud_topic(self, topic: str | None = None) -> str:
        """The topic of the point clouds.

        Args:
            topic: its name; None where the bag has exactly one.

        Raises:
            InputError: none, more than one, no such topic, or one of another type; the message lists what there is.
        """
        if topic is not None:
            return self._require(topic, CLOUD_TYPES, "point clouds")
        names = [name for name, kind in self._types.items() if kind in CLOUD_TYPES]
        if len(names) != 1:
            which = "has no topic" if not names else f"has {len(names)} topics"
            raise InputError(f"{self.path}: {which} of point clouds; name one with its topic: {self._listed()}")
        return names[0]

    def frames(
        self,
        topic: str | None = None,
        *,
        every: int = 1,
        rate: float | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> Iterator[Frame]:
        """The frames of a topic one by one, in the order in which they were recorded; only one is held.

        Args:
            topic: of type `sensor_msgs/PointCloud2`; None where the bag has exactly one.
            every: take each n-th frame.
            rate: take at most this number a second.
            start: no frame before this time, seconds.
            end: no frame after this time.

        Raises:
            InputError: no such topic; while iterating, a message that cannot be read.
        """
        if every < 1 or (rate is not None and not 0 < rate < np.inf):
            raise InputError(f"frames: every={every} must be at least 1, rate={rate} positive")
        return self._frames(self.cloud_topic(topic), every, rate, start, end)

    def frame_at(self, topic: str | None, time: float, tolerance: float = 0.5) -> Frame:
        """The frame nearest to a time, by the stamp of its header; only messages about that time are read.

        Args:
            topic: of type `sensor_msgs/PointCloud2`; None where the bag has exactly one.
            time: seconds since 1970.
            tolerance: how far from it the frame may be, seconds.

        Raises:
            InputError: no such topic, or no frame within the tolerance; the message has the nearest time.
        """
        name = self.cloud_topic(topic)
        reach = max(tolerance, 0.1)
        best: tuple[float, Any] | None = None
        # The whole bag is reached at the latest when the time is as far away as its start or its end.
        while best is None:
            for log_time, message in self._messages(name, time - reach, time + reach):
                stamp = header_time(message.header, log_time)
                if best is None or abs(stamp - time) < abs(best[0] - time):
                    best = stamp, message
            if reach > abs(time - self.start) + abs(time - self.end) + abs(self._delay(name)):
                break
            reach *= 4
        if best is None:
            raise InputError(f"{self.path}: {name} has no message; choose another topic: {self._listed()}")
        if abs(best[0] - time) > tolerance:
            raise InputError(
                f"{self.path}: no message of {name} within {tolerance:g} s of {time:.3f}; the nearest is at "
                f"{best[0]:.3f} (+{best[0] - self.start:.3f}), the bag runs from {self.start:.3f} to {self.end:.3f} s"
            )
        return decode_frame(best[1], self._source(name, best[0]), best[0])

    def transforms(self) -> TransformTree:
        """The tree of all transforms in the bag; empty where it has none."""
        if self._tree is None:
            names = [name for name, kind in self._types.items() if kind in TF_TYPES]
            messages = ((name, *timed) for name in names for timed in self._messages(name))
            self._tree = transform_tree(messages, str(self.path))
        return self._tree

    def trajectory(
        self, topic: str, parent: str | None = None, child: str | None = None, max_gap: float = MAX_GAP
    ) -> Trajectory:
        """The poses of a topic.

        Args:
            topic: of type `nav_msgs/Odometry`, `geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped` or
                `TransformStamped`; or one of transforms, such as "/tf", which stands for all of them.
            parent: of transforms, the frame that the poses are given in; None is the root of the tree.
            child: of transforms, the frame whose poses these are.
            max_gap: of transforms, the longest gap that is interpolated over, seconds.

        Raises:
            InputError: no such topic, one of another type, no such frames, or no poses.
        """
        self._require(topic, (*POSE_TYPES, *TF_TYPES), "poses")
        if self._types[topic] in POSE_TYPES:
            return pose_trajectory(self._messages(topic), f"{self.path}: {topic}")
        tree = self.transforms()
        if child is None:
            raise InputError(f"{topic}: name the child, the frame whose poses are wanted: {', '.join(tree.frames)}")
        child = frame_name(child)
        return tree.trajectory(tree.root_of(child) if parent is None else frame_name(parent), child, max_gap)

    def has_transforms(self, topic: str) -> bool:
        """True where the messages of a topic are transforms as on /tf."""
        return self._types.get(topic) in TF_TYPES

    def body_of(self, topic: str) -> str:
        """The name of the frame whose poses a topic of poses has; empty where its messages have none."""
        self._require(topic, POSE_TYPES, "poses")
        first = next(self._messages(topic), None)
        return "" if first is None else frames_of_pose(first[1])[1]

    def _frames(
        self, name: str, every: int, rate: float | None, start: float | None, end: float | None
    ) -> Iterator[Frame]:
        index, due = 0, -np.inf
        period = 0.0 if rate is None else 1 / rate
        for log_time, message in self._messages(name, start, end):
            stamp = header_time(message.header, log_time)
            if (start is not None and stamp < start) or (end is not None and stamp > end):
                continue
            index += 1
            if (index - 1) % every or stamp < due - PERIOD_JITTER * period:
                continue
            if rate is not None:
                # The next turn on the grid that the first frame began.
                due = stamp if due == -np.inf else due
                due += period * max(1, np.floor((stamp - due) / period + PERIOD_JITTER) + 1)
            yield decode_frame(message, self._source(name, stamp), log_time)

    def _messages(self, name: str, start: float | None = None, end: float | None = None) -> Iterator[tuple[float, Any]]:
        """The messages of a topic whose stamps may lie between two times, each with the time of its record."""
        shift = 0.0 if start is None and end is None else self._delay(name)
        first = None if start is None else start + shift - DELAY_JITTER
        last = None if end is None else end + shift + DELAY_JITTER
        yield from self._records(name, first, last)

    def _records(self, name: str, start: float | None, end: float | None) -> Iterator[tuple[float, Any]]:
        """The messages of a topic that were recorded between two times."""
        limits = [None if time is None else int(np.clip(time, 0, self.end + 1) * NANOSECONDS) for time in (start, end)]
        records = self._reader.messages(self._connections[name], *limits)
        while True:
            with readable(self.path):
                record = next(records, None)
                if record is None:
                    return
                connection, log_time, data = record
                message = self._reader.deserialize(data, connection.msgtype)
            yield log_time / NANOSECONDS, message

    def _delay(self, name: str) -> float:
        """The time from the stamp of the topic's first message to its record, seconds."""
        if name not in self._delays:
            first = next(self._records(name, None, None), None)
            self._delays[name] = 0.0 if first is None else first[0] - header_time(first[1].header, first[0])
        return self._delays[name]

    def _topic(self, name: str) -> Topic:
        connections = self._connections[name]
        count = sum(int(connection.msgcount) for connection in connections)
        with readable(self.path):
            span = _span(self._reader, connections) if count else None
        start, end = (None, None) if span is None else (time / NANOSECONDS for time in span)
        return Topic(name, self._types[name], count, start, end)

    def _require(self, topic: str, types: Sequence[str], what: str) -> str:
        if topic not in self._types:
            raise InputError(f"{self.path}: has no topic {topic}; the topics are: {self._listed()}")
        if self._types[topic] not in types:
            raise InputError(
                f"{self.path}: {topic} is of type {self._types[topic]}, which are no {what} ({', '.join(types)}); the "
                f"topics are: {self._listed()}"
            )
        return topic

    def _listed(self) -> str:
        return ", ".join(f"{name} ({kind})" for name, kind in sorted(self._types.items())) or "none"

    def _source(self, name: str, time: float) -> str:
        return f"{self.path}: {name} at {time:.3f}"


@contextmanager
def open_bag(path: str | os.PathLike[str]) -> Iterator[Bag]:
    """A bag, open while the block runs; its messages are read one by one.

    Args:
        path: a `.bag` file of ROS 1, a folder that `ros2 bag record` made, or an `.mcap` or `.db3` file of ROS 2.

    Raises:
        InputError: rosbags is not installed, there is no such bag, or it is cut off or damaged.
    """
    bag = Path(path)
    with open_reader(bag) as reader:
        with readable(bag):
            opened = Bag(bag, reader)
        yield opened


def sensor_trajectory(
    bag: Bag,
    topic: str,
    sensor: str,
    *,
    parent: str | None = None,
    child: str | None = None,
    sensor_on_body: Float64[np.ndarray, "4 4"] | None = None,
    max_gap: float = MAX_GAP,
) -> Trajectory:
    """The poses of a sensor in the world.

    Where the poses are those of a body, the sensor's pose on it is taken from the bag's transforms, if it is not given.

    Args:
        bag: that is open.
        topic: of poses, or of transforms such as "/tf".
        sensor: the coordinate frame of the sensor, `Frame.name`.
        parent: of transforms: the coordinate frame of the world; None is the root of the tree.
        child: whose poses to take; None is the sensor for transforms, and what the messages say for other poses.
        sensor_on_body: the sensor's extrinsics, sensor to body.
        max_gap: of transforms, the longest gap that is interpolated over, seconds.

    Raises:
        InputError: as `Bag.trajectory`, or the transforms say that the sensor moves on the body.

    Warns:
        InputWarning: where the sensor is on the body is not known; the poses are then taken for the sensor's own.
    """
    sensor = frame_name(sensor)
    if bag.has_transforms(topic):
        body = frame_name(child or sensor)
        trajectory = bag.trajectory(topic, parent, body, max_gap)
    else:
        trajectory = bag.trajectory(topic)
        body = frame_name(child or bag.body_of(topic))
    if sensor_on_body is not None:
        return trajectory.of_sensor(sensor_on_body)
    if body == sensor:
        return trajectory
    if bag.transforms().connects(body, sensor):
        return trajectory.of_sensor(bag.transforms().fixed_pose(body, sensor))
    warn(
        f"{bag.path}: where the sensor {sensor!r} is on the body {body!r} is not known, the poses of {topic} are "
        "taken for the sensor's own; give its extrinsics (sensor_on_body, --sensor-on-body) if they are not"
    )
    return trajectory


def _span(reader: Any, connections: Sequence[Any]) -> tuple[int, int]:
    """When the first and the last message of some connections were recorded, nanoseconds; the last to a millisecond."""
    # The reader of ROS 1 holds the times of all messages; that of ROS 2 has only its `messages`, forwards.
    if all(hasattr(connection.owner, "indexes") for connection in connections):
        indexes = [connection.owner.indexes[connection.id] for connection in connections]
        times = [int(index[end].time) for index in indexes if index for end in (0, -1)]
        return min(times), max(times)

    first = _first_from(reader, connections, None)
    assert first is not None
    # Bisection for the latest time from which on there is a message.
    last, beyond = first, int(reader.end_time)
    probe = max(beyond - NANOSECONDS, last)
    while beyond - last > NANOSECONDS // 1000:
        found = _first_from(reader, connections, probe)
        last, beyond = (last, probe) if found is None else (max(found, last), beyond)
        probe = (last + beyond) // 2 + 1
    return first, last


def _first_from(reader: Any, connections: Sequence[Any], time: int | None) -> int | None:
    """When the first message at a time or after it was recorded, nanoseconds."""
    record = next(reader.messages(connections, time), None)
    return None if record is None else int(record[1])
