"""Writing ROS bags as a robot records them: point clouds, the robot's poses, and the transforms."""

import heapq
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.clouds import check_poses, clear_folders, temporary_folder
from gmmjax.errors import InputError
from gmmjax.surveys.bags import load_rosbags
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.point_cloud2 import encode_cloud
from gmmjax.surveys.trajectory import Trajectory

PoseMessage = Literal["Odometry", "PoseStamped"]
IN_PLACE = np.eye(4)
TRANSFORMS = "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True)
class BagNames:
    """How topics and coordinate frames are called; the defaults are those of the Astrobee robot.

    Attributes:
        clouds: topic of the point clouds.
        poses: topic of the body's poses.
        world: coordinate frame that the poses are given in.
        body: coordinate frame of the robot.
        sensor: coordinate frame of frames without a name.
    """

    clouds: str = "/hw/depth_haz/points"
    poses: str = "/loc/ground_truth"
    world: str = "world"
    body: str = "body"
    sensor: str = "haz_cam"


def write_bag(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    trajectory: Trajectory,
    *,
    sensor_on_body: Float64[np.ndarray, "4 4"] = IN_PLACE,
    names: BagNames = BagNames(),
    pose_message: PoseMessage = "Odometry",
    other_poses: Mapping[str, Trajectory] = MappingProxyType({}),
    big_endian: bool = False,
    point_step: int = 12,
) -> None:
    """Writes a bag, whole or not at all: clouds, poses, /tf and /tf_static; the frames are taken one by one.

    Messages are recorded at the time that they are stamped with.

    Args:
        path: ends with `.bag` (ROS 1), `.mcap` or `.db3` (one file of ROS 2), or has no ending: a folder of ROS 2, with
            an `.mcap` file and `metadata.yaml`. A file that is there is replaced, a folder is not.
        frames: in their sensor's coordinates, in the order of their times.
        trajectory: of the body, in the world.
        sensor_on_body: the sensor's extrinsics, sensor to body.
        names: of topics and coordinate frames.
        pose_message: the type of the poses, `nav_msgs/Odometry` or `geometry_msgs/PoseStamped`.
        other_poses: further poses of the body, such as after bundle adjustment, by their topics; they are not in /tf.
        big_endian: the byte order of the clouds' numbers.
        point_step: bytes of a point, at least 12.

    Raises:
        InputError: rosbags is not installed, the path has another ending or cannot be written, or times that bags do
            not have (before 1970, or after 2038).
        OSError: from writing, such as a full disk; what was there before is left as it was.
    """
    load_rosbags(str(path))
    check_poses(np.asarray(sensor_on_body)[None], "sensor_on_body")
    with _open_writer(Path(path)) as (record, messages):
        stream = iter(frames)
        first = next(stream, None)
        sensor = names.sensor if first is None else first.name or names.sensor
        static = messages.transforms(float(trajectory.times[0]), [(names.body, sensor, sensor_on_body)])
        record("/tf_static", TRANSFORMS, float(trajectory.times[0]), static)
        pose = messages.odometry if pose_message == "Odometry" else messages.pose_stamped
        pose_kind = "nav_msgs/msg/Odometry" if pose_message == "Odometry" else "geometry_msgs/msg/PoseStamped"
        timed: list[Iterable[tuple[float, str, Any]]] = [
            zip(known.times.tolist(), itertools.repeat(topic), known.poses, strict=False)
            for topic, known in {names.poses: trajectory, **other_poses}.items()
        ]
        timed.append(
            (frame.time, names.clouds, frame) for frame in itertools.chain([] if first is None else [first], stream)
        )
        for time, topic, what in heapq.merge(*timed, key=lambda message: message[0]):
            if isinstance(what, Frame):
                cloud = messages.cloud(what, what.name or sensor, big_endian, point_step)
                record(topic, "sensor_msgs/msg/PointCloud2", time, cloud)
                continue
            record(topic, pose_kind, time, pose(time, names.world, names.body, what))
            if topic == names.poses:
                record("/tf", TRANSFORMS, time, messages.transforms(time, [(names.world, names.body, what)]))


class _Messages:
    """Makes messages of one version of ROS."""

    def __init__(self, typestore: Any, version: int) -> None:
        self._types = typestore.types
        self._version = version

    def cloud(self, frame: Frame, sensor: str, big_endian: bool, point_step: int) -> Any:
        packed = encode_cloud(frame, big_endian=big_endian, point_step=point_step)
        return self._make(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(frame.time, sensor),
            height=packed.height,
            width=packed.width,
            fields=[self._make("sensor_msgs/msg/PointField", **vars(field)) for field in packed.fields],
            is_bigendian=packed.is_bigendian,
            point_step=packed.point_step,
            row_step=packed.row_step,
            data=packed.data,
            is_dense=packed.is_dense,
        )

    def odometry(self, time: float, world: str, body: str, pose: Float64[np.ndarray, "4 4"]) -> Any:
        zero = {axis: 0.0 for axis in "xyz"}
        still = self._make(
            "geometry_msgs/msg/Twist",
            linear=self._make("geometry_msgs/msg/Vector3", **zero),
            angular=self._make("geometry_msgs/msg/Vector3", **zero),
        )
        unknown = np.zeros(36)
        return self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(time, world),
            child_frame_id=body,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=self._pose(pose), covariance=unknown),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=unknown),
        )

    def pose_stamped(self, time: float, world: str, body: str, pose: Float64[np.ndarray, "4 4"]) -> Any:
        del body
        return self._make("geometry_msgs/msg/PoseStamped", header=self._header(time, world), pose=self._pose(pose))

    def transforms(self, time: float, edges: list[tuple[str, str, Float64[np.ndarray, "4 4"]]]) -> Any:
        stamped = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(time, parent),
                child_frame_id=child,
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._make("geometry_msgs/msg/Vector3", **_position(pose)),
                    rotation=self._quaternion(pose),
                ),
            )
            for parent, child, pose in edges
        ]
        return self._make(TRANSFORMS, transforms=stamped)

    def _pose(self, pose: Float64[np.ndarray, "4 4"]) -> Any:
        point = self._make("geometry_msgs/msg/Point", **_position(pose))
        return self._make("geometry_msgs/msg/Pose", position=point, orientation=self._quaternion(pose))

    def _quaternion(self, pose: Float64[np.ndarray, "4 4"]) -> Any:
        numbers = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        return self._make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", numbers, strict=True)))

    def _header(self, time: float, name: str) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(time), 1_000_000_000)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        number = {"seq": 0} if self._version == 1 else {}
        return self._make("std_msgs/msg/Header", **number, stamp=stamp, frame_id=name)

    def _make(self, kind: str, **values: Any) -> Any:
        return self._types[kind](**values)


def _position(pose: Float64[np.ndarray, "4 4"]) -> dict[str, float]:
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
    connections: dict[str, Any] = {}
    with _staged(target) as (staged, make_writer), make_writer(staged) as writer:

        def record(topic: str, kind: str, time: float, message: Any) -> None:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=typestore)
            serialize = typestore.serialize_ros1 if version == 1 else typestore.serialize_cdr
            writer.write(connections[topic], _nanoseconds(time), serialize(message, kind))

        yield record, _Messages(typestore, version)


@contextmanager
def _staged(target: Path) -> Iterator[tuple[Path, Callable[[Path], Any]]]:
    """Where the bag is written at first, and what makes its writer; when the block ends it is moved to its place."""
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

    def make_writer(path: Path) -> Any:
        if target.suffix == ".bag":
            return Writer1(path)
        return Writer2(path, version=Writer2.VERSION_LATEST, storage_plugin=plugins[target.suffix])

    parent = target.absolute().parent
    clear_folders(parent)
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(temporary_folder(parent))
        except OSError as error:
            raise InputError(
                f"{target}: cannot be written ({error.strerror}); "
                f"create the folder {target.parent} or choose another one"
            ) from error
        # The files in a folder of ROS 2 are called after it.
        staged = folder / (target.name if target.suffix in (".bag", "") else target.stem)
        yield staged, make_writer
        written = staged if target.suffix in (".bag", "") else staged / f"{staged.name}{target.suffix}"
        os.replace(written, target)
