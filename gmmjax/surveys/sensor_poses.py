"""The trajectory of the sensor that took a bag's frames, from whatever poses the bag has."""

import numpy as np
from jaxtyping import Float64

from gmmjax.errors import warn
from gmmjax.surveys.bag_poses import frame_name
from gmmjax.surveys.bags import Bag
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory


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
