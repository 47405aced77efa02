"""Poses of a body over time."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float64
from scipy.spatial.transform import Rotation, Slerp

from gmmjax.clouds import check_poses
from gmmjax.errors import InputError
from gmmjax.geometry import rigid_transform

# Between two poses further apart than this (seconds) nothing is known.
MAX_GAP = 0.5


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a body with their times.

    Attributes:
        times: seconds, strictly increasing.
        poses: body to world, rigid; the translations in metres.

    Raises:
        InputError: no pose, times that do not increase, or poses that are not rigid (which one is named).
    """

    times: Float64[np.ndarray, " t"]
    poses: Float64[np.ndarray, "t 4 4"]

    def __post_init__(self) -> None:
        check_poses(self.poses, "trajectory")
        if self.times.shape != (len(self.poses),) or not np.isfinite(self.times).all():
            raise InputError(f"trajectory: {len(self.poses)} poses need as many times, in seconds")
        if (np.diff(self.times) <= 0).any():
            index = int(np.argmax(np.diff(self.times) <= 0)) + 1
            raise InputError(f"trajectory: time {index} ({self.times[index]:.9f}) is not after the one before it")

    @classmethod
    def of_samples(cls, times: npt.ArrayLike, poses: npt.ArrayLike) -> "Trajectory":
        """From poses in any order; of several at one time the last counts.

        Args:
            times: [T], seconds.
            poses: [T, 4, 4], body to world.

        Raises:
            InputError: as the record.
        """
        sampled, matrices = np.asarray(times, np.float64), np.asarray(poses, np.float64)
        if sampled.ndim != 1 or len(sampled) != len(matrices):
            raise InputError(f"trajectory: {len(matrices)} poses need as many times, in seconds")
        distinct, last = np.unique(sampled[::-1], return_index=True)
        return cls(distinct, matrices[::-1][last])

    def __len__(self) -> int:
        """The number of poses."""
        return len(self.times)

    def at(
        self, times: npt.ArrayLike, max_gap: float = MAX_GAP
    ) -> tuple[Float64[np.ndarray, "n 4 4"], Bool[np.ndarray, " n"]]:
        """The poses at other times: positions between neighbours are linear, rotations by slerp.

        Args:
            times: [N], seconds.
            max_gap: a time between two poses further apart than this is not covered, seconds.

        Returns:
            The poses, and which of the times they cover; a pose that is not covered is the nearest one. Before the
            first pose and after the last none is.
        """
        asked = np.asarray(times, np.float64)
        inside = np.clip(asked, self.times[0], self.times[-1])
        if len(self) == 1:
            return np.repeat(self.poses, len(asked), axis=0), asked == self.times[0]
        after = np.clip(np.searchsorted(self.times, inside), 1, len(self) - 1)
        gap = self.times[after] - self.times[after - 1]
        on_sample = (inside == self.times[after]) | (inside == self.times[after - 1])
        covered = (asked == inside) & (on_sample | (gap <= max_gap))
        share = (inside - self.times[after - 1]) / gap
        share = np.where(on_sample | covered, share, np.round(share))
        between = self.times[after - 1] + share * gap
        rotations = Slerp(self.times, Rotation.from_matrix(self.poses[:, :3, :3]))(between).as_matrix()
        positions = self.poses[:, :3, 3]
        between_positions = positions[after - 1] + share[:, None] * (positions[after] - positions[after - 1])
        return rigid_transform(rotations, between_positions), covered

    def of_sensor(self, sensor_on_body: Float64[np.ndarray, "4 4"]) -> "Trajectory":
        """The trajectory of a sensor.

        Args:
            sensor_on_body: its extrinsics: sensor to body.
        """
        return Trajectory(self.times, self.poses @ sensor_on_body)


def pose_matrix(position: npt.ArrayLike, quaternion: npt.ArrayLike) -> Float64[np.ndarray, "4 4"]:
    """A rigid motion as a matrix.

    Args:
        position: x, y, z.
        quaternion: x, y, z, w, as ROS has them; of any length but zero.

    Raises:
        InputError: numbers that are not finite, or a quaternion of no length.
    """
    numbers = np.concatenate([np.asarray(position, np.float64), np.asarray(quaternion, np.float64)])
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(numbers[3:])
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or not 1e-6 <= length < np.inf:
        raise InputError(f"pose {numbers.tolist()}: must be x y z and a quaternion x y z w that is not zero")
    return rigid_transform(Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3])
