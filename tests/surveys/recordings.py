"""Frames, trajectories and bags for the tests."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gmmjax.surveys import Frame, Trajectory, pose_matrix

START = 1_600_000_000.0
CLOUDS = "/hw/depth_haz/points"
POSES = "/loc/ground_truth"
SENSOR_ON_BODY = pose_matrix([0.1, 0.0, 0.05], [0.5, 0.5, 0.5, 0.5])
# One bag of ROS 1, and all three forms of ROS 2.
BAGS = ("run.bag", "run.mcap", "run.db3", "run")


def frame(time, height=6, width=8, seed=0, name="haz_cam"):
    """A frame of random depths, a fifth of the pixels without a return."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    rays = np.stack([columns - 3.5, rows - 2.5, np.full((height, width), 8.0)], axis=-1) / 8
    image = rays * random.uniform(1, 3, size=(height, width, 1))
    image[random.random((height, width)) < 0.2] = np.nan
    return Frame.of_image(image, time, name)


def frames(count=10, period=0.2, **shape):
    """Frames at an even rate from `START` on."""
    return [frame(START + index * period, seed=index, **shape) for index in range(count)]


def trajectory(length=2.0, period=0.1):
    """A body that goes along x at 1 m/s and turns about z."""
    times = np.arange(0, length + 1e-9, period)
    turned = [[0, 0, np.sin(0.2 * time), np.cos(0.2 * time)] for time in times]
    poses = [pose_matrix([time, 0, 0], rotation) for time, rotation in zip(times, turned, strict=True)]
    return Trajectory(START + times, np.stack(poses))


class Recorder:
    """Writes messages of any type with rosbags alone, without our own writer."""

    def __init__(self, path):
        self.version = 1 if path.suffix == ".bag" else 2
        self.types = get_typestore(Stores.ROS1_NOETIC if self.version == 1 else Stores.ROS2_HUMBLE)
        if self.version == 1:
            self.types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf/msg/tfMessage"))
            self.writer = Writer1(path)
        else:
            self.writer = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self.connections = {}

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *error):
        self.writer.close()

    def make(self, kind, **values):
        return self.types.types[kind](**values)

    def header(self, time, name):
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(time), nanosec=round(time % 1 * 1e9))
        return self.make("std_msgs/msg/Header", **({"seq": 7} if self.version == 1 else {}), stamp=stamp, frame_id=name)

    def record(self, topic, kind, message, time, *, little_endian=True):
        """A message at the time of its record; `little_endian` is of the message itself, which ROS 2 leaves open."""
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.types)
        data = (
            self.types.serialize_ros1(message, kind)
            if self.version == 1
            else self.types.serialize_cdr(message, kind, little_endian=little_endian)
        )
        self.writer.write(self.connections[topic], round(time * 1e9), data)

    def cloud(self, time, name, packed):
        fields = [self.make("sensor_msgs/msg/PointField", **vars(field)) for field in packed.fields]
        values = {**vars(packed), "fields": fields}
        return self.make("sensor_msgs/msg/PointCloud2", header=self.header(time, name), **values)

    def pose(self, position, rotation=(0.0, 0.0, 0.0, 1.0)):
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", **dict(zip("xyz", map(float, position), strict=True))),
            orientation=self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", rotation, strict=True))),
        )

    def transform(self, time, parent, child, position, rotation=(0.0, 0.0, 0.0, 1.0)):
        moved = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, position), strict=True))),
            rotation=self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", rotation, strict=True))),
        )
        kind = "geometry_msgs/msg/TransformStamped"
        return self.make(kind, header=self.header(time, parent), child_frame_id=child, transform=moved)
