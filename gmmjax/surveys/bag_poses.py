"""Poses in the messages of a bag: of stamped poses and odometry, and of the transforms on /tf and /tf_static."""

from array import array
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.errors import InputError, warn
from gmmjax.geometry import rigid_transform
from gmmjax.surveys.point_cloud2 import header_time
from gmmjax.surveys.trajectory import Trajectory
from gmmjax.surveys.transforms import Edge, TransformTree

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
POSE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
# Numbers of a sample: time, x, y, z and the quaternion x, y, z, w.
SAMPLE = 8


def pose_trajectory(messages: Iterable[tuple[float, Any]], source: str) -> Trajectory:
    """The trajectory in messages of one of `POSE_TYPES`; poses that are none (NaN, a quaternion of zeros) are left out.

    Args:
        messages: each with the time of its record, seconds.
        source: the bag and the topic, for messages.

    Raises:
        InputError: no pose.
    """
    samples = array("d")
    for log_time, message in messages:
        samples.extend(_sample(header_time(message.header, log_time), _position_and_rotation(message)))
    return _trajectory(samples, source)


def frames_of_pose(message: Any) -> tuple[str, str]:
    """The names of the frame that a pose is given in, and of what has the pose; empty where the message has none."""
    return frame_name(message.header.frame_id), frame_name(getattr(message, "child_frame_id", ""))


def frame_name(name: str) -> str:
    """The name of a coordinate frame without the leading slash of old bags."""
    return str(name).removeprefix("/")


def transform_tree(messages: Iterable[tuple[str, float, Any]], source: str) -> TransformTree:
    """The tree in messages of `TF_TYPES`.

    Args:
        messages: each with its topic and the time of its record, seconds; transforms of a topic that ends in
            "tf_static" hold at all times.
        source: the bag, for messages.

    Raises:
        InputError: an edge without any pose.
    """
    samples: dict[tuple[str, str], array[float]] = {}
    fixed: set[tuple[str, str]] = set()
    for topic, log_time, message in messages:
        for transform in message.transforms:
            pair = frames_of_pose(transform)
            time = header_time(transform.header, log_time)
            samples.setdefault(pair, array("d")).extend(_sample(time, _position_and_rotation(transform)))
            if topic.endswith("tf_static"):
                fixed.add(pair)
    return TransformTree(
        {pair: Edge(_trajectory(own, f"{source}, {' > '.join(pair)}"), pair in fixed) for pair, own in samples.items()}
    )


def _position_and_rotation(message: Any) -> tuple[Any, Any]:
    if hasattr(message, "transform"):
        return message.transform.translation, message.transform.rotation
    pose = message.pose
    # With a covariance the pose is one level further down.
    pose = getattr(pose, "pose", pose)
    return pose.position, pose.orientation


def _sample(time: float, pose: tuple[Any, Any]) -> tuple[float, ...]:
    position, rotation = pose
    return (time, position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w)


def _trajectory(samples: Sequence[float], source: str) -> Trajectory:
    rows: Float64[np.ndarray, "t 8"] = np.array(samples, np.float64).reshape(-1, SAMPLE)
    # The length of a damaged quaternion may be beyond the range of floats.
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(rows[:, 4:], axis=1)
    usable = np.isfinite(rows).all(axis=1) & np.isfinite(lengths) & (lengths > 1e-6)
    if not usable.any():
        raise InputError(f"{source}: none of {len(rows)} messages has a pose; choose another topic")
    if not usable.all():
        warn(f"{source}: {int((~usable).sum())} of {len(rows)} poses are NaN or have no rotation and are left out")
        rows = rows[usable]
    poses = rigid_transform(Rotation.from_quat(rows[:, 4:]).as_matrix(), rows[:, 1:4])
    return Trajectory.of_samples(rows[:, 0], poses)
