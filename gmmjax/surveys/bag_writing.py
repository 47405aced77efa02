"""Writing ROS bags as a robot records them: point clouds, the robot's poses, and the transforms."""

import functools
import heapq
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.clouds import check_poses, working_folder
from gmmjax.errors import InputError
from gmmjax.surveys.bag_opening import load_rosbags
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.point_cloud2 import encode_cloud
from gmmjax.surveys.trajectory import Trajectory

Pose: TypeAlias = Float64[np.ndarray, "4 4"]

IN_PLACE = np.eye(4)
CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
# The names that the Astrobee robot gives its topics and coordinate frames.
CLOUD_TOPIC, POSE_TOPIC = "/hw/depth_haz/points", "/loc/ground_truth"
WORLD, BODY, SENSOR = "world", "body", "haz_cam"


def write_bag(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    trajectory: Trajectory,
    *,
    sensor_on_body: Pose = IN_PLACE,
    other_poses: Mapping[str, Trajectory] = MappingProxyType({}),
) -> None:
    """Write a bag, whole or not at all: clouds, poses, /tf and /tf_static; the frames are taken one by one.

    Messages are recorded at the time that they are stamped with. Topics and coordinate frames have the names of the
    Astrobee robot.

    Args:
        path: ends with `.bag` (ROS 1), `.mcap` or `.db3` (one file of ROS 2), or has no ending: a folder of ROS 2, with
            an `.mcap` file and `metadata.yaml`. A file that is there is replaced, a folder is not.
        frames: in their sensor's coordinates, in the order of their times.
        trajectory: of the body, in the world.
        sensor_on_body: the sensor's extrinsics, sensor to body.
        other_poses: further poses of the body, such as after bundle adjustment, by their topics; they are not in /tf.

    Raises:
        InputError: rosbags is not installed, the path has another ending or cannot be written, or times that bags do
            not have (before 1970, or after 2038).
        OSError: from writing, such as a full disk; what was there before is left as it was.
    """
    load_rosbags(str(path))
    check_poses(np.asarray(sensor_on_body)[None], "sensor_on_body")
    stream = iter(frames)
    first = next(stream, None)
    sensor = SENSOR if first is None else first.name or SENSOR
    timed: list[Iterable[tuple[float, str, Any]]] = [
        zip(known.times.tolist(), itertools.repeat(topic), known.poses, strict=False)
        for topic, known in {POSE_TOPIC: trajectory, **other_poses}.items()
    ]
    timed.append(
        (frame.time, CLOUD_TOPIC, frame) for frame in itertools.chain(() if first is None else (first,), stream)
    )
    with _open_writer(Path(path)) as (record, messages):
        start = float(trajectory.times[0])
        record("/tf_static", TRANSFORMS, start, messages.transform(start, BODY, sensor, sensor_on_body))
        for time, topic, what in heapq.merge(*timed, key=lambda message: message[0]):
            if isinstance(what, Frame):
                record(topic, CLOUD, time, messages.cloud(what, what.name or sensor))
                continue
            record(topic, ODOMETRY, time, messages.odometry(time, what))
            if topic == POSE_TOPIC:
                record("/tf", TRANSFORMS, time, messages.transform(time, WORLD, BODY, what))


class _Messages:
    """Maker of messages of one version of ROS."""

    def __init__(self, typestore: Any, version: int) -> None:
        self._types = typestore.types
        self._version = version

    def cloud(self, frame: Frame, sensor: str) -> Any:
        packed = vars(encode_cloud(frame))
        fields = [self._make("sensor_msgs/msg/PointField", **vars(field)) for field in packed["fields"]]
        return self._make(CLOUD, **{**packed, "fields": fields}, header=self._header(frame.time, sensor))

    def odometry(self, time: float, pose: Pose) -> Any:
        zero = self._make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        still = self._make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        position = self._make("geometry_msgs/msg/Point", **_position(pose))
        there = self._make("geometry_msgs/msg/Pose", position=position, orientation=self._quaternion(pose))
        unknown = np.zeros(36)
        return self._make(
            ODOMETRY,
            header=self._header(time, WORLD),
            child_frame_id=BODY,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=there, covariance=unknown),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=unknown),
        )

    def transform(self, time: float, parent: str, child: str, pose: Pose) -> Any:
        translation, rotation = self._make("geometry_msgs/msg/Vector3", **_position(pose)), self._quaternion(pose)
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(time, parent),
            child_frame_id=child,
            transform=self._make("geometry_msgs/msg/Transform", translation=translation, rotation=rotation),
        )
        return self._make(TRANSFORMS, transforms=[stamped])

    def _quaternion(self, pose: Pose) -> Any:
        numbers = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        return self._make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", numbers, strict=True)))

    def _header(self, time: float, name: str) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(time), 1_000_000_000)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        number = {"seq": 0} if self._version == 1 else {}
        return self._make("std_msgs/msg/Header", **number, stamp=stamp, frame_id=name)

    def _make(self, kind: str, **values: Any) -> Any:
        return self._types[kind](**values)


def _position(pose: Pose) -> dict[str, float]:
    return dict(zip("xyz", pose[:3, 3].tolist(), strict=True))


def _nanoseconds(time: float) -> int:
    nanoseconds = round(time * 1e9)
    # ROS 2 has the seconds in 32 bits with a sign.
    if not 0 <= nanoseconds < 2**31 * 1_000_000_000:
        raise InputError(f"time {time} s: bags have times from 1970 to 2038; give seconds since 1970")
    return nanoseconds


@contextmanager
def _open_writer(target: Path) -> Iterator[tuple[Callable[[str, str, float, Any], None], _Messages]]:
    """A function that records a message on a topic, and what makes the messages; the bag is in place at the end."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    version = 1 if target.suffix == ".bag" else 2
    typestore = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    if TRANSFORMS not in typestore.types:
        typestore.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    serialize = typestore.serialize_ros1 if version == 1 else typestore.serialize_cdr
    with _staged(target) as writer:
        connect = functools.cache(functools.partial(writer.add_connection, typestore=typestore))

        def record(topic: str, kind: str, time: float, message: Any) -> None:
            writer.write(connect(topic, kind), _nanoseconds(time), serialize(message, kind))

        yield record, _Messages(typestore, version)


@contextmanager
def _staged(target: Path) -> Iterator[Any]:
    """The writer of a bag that takes its place when the block ends."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    plugins = {".mcap": StoragePlugin.MCAP, ".db3": StoragePlugin.SQLITE3, "": StoragePlugin.MCAP}
    if target.suffix != ".bag" and target.suffix not in plugins:
        raise InputError(
            f"{target}: a bag's name ends with .bag, .mcap or .db3, or is that of a folder, without ending"
        )
    if target.is_dir():
        raise InputError(f"{target}: is a folder that is there already; choose another name, or remove it")
    with working_folder(target.absolute().parent) as folder:
        if target.suffix == ".bag":
            written = staged = folder / target.name
            writer: Any = Writer1(staged)
        else:
            # The files in a folder of ROS 2 are called after it.
            staged = folder / target.stem
            written = staged / f"{target.stem}{target.suffix}" if target.suffix else staged
            writer = Writer2(staged, version=Writer2.VERSION_LATEST, storage_plugin=plugins[target.suffix])
        with writer:
            yield writer
        os.replace(written, target)
