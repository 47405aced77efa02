"""Where the sensor stood and what it could see from there."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float64

from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.errors import InputError, one_line, shown

# Rounding in files with seven digits; a pose with a scale or a reflection is far beyond.
RIGID_TOLERANCE = 1e-3
WIDEST_PINHOLE = 180.0
# What a derived field of view and range are widened by, so that the outermost points are inside.
MARGIN = 1.02


@dataclass(frozen=True, eq=False, init=False)
class SensorViews:
    """Poses of a depth camera (or a scanner) during one survey, with what it sees from each.

    A camera's axes are x right, y down, z forward. Up to 180 degrees wide the field of view is a pinhole camera's
    frustum; wider, it is measured in azimuth and elevation, as for a turning scanner.

    Attributes:
        poses: camera to world [V, 4, 4]; the translations in the unit of the clouds.
        field_of_view: full horizontal and vertical angle, degrees.
        max_range: beyond it the sensor returns nothing, in the unit of the clouds.

    Raises:
        InputError: poses that are not rigid (which one is named), angles or a range that no sensor has.
    """

    poses: Float64[np.ndarray, "v 4 4"]
    field_of_view: tuple[float, float]
    max_range: float

    def __init__(self, poses: Any, field_of_view: Any, max_range: Any) -> None:
        """Takes whatever can be made an array [V, 4, 4], two angles and a number, and checks it; see `Raises`."""
        object.__setattr__(self, "poses", _checked_poses(poses))
        object.__setattr__(self, "field_of_view", _checked_angles(field_of_view))
        object.__setattr__(self, "max_range", _checked_range(max_range))

    def __len__(self) -> int:
        """The number of views."""
        return len(self.poses)

    def __repr__(self) -> str:
        width, height = self.field_of_view
        views = f"{len(self):,} view{'s' * (len(self) != 1)}"
        return f"<SensorViews: {views} of {width:.4g}° × {height:.4g}°, range {self.max_range:.4g}>"

    @property
    def turning(self) -> bool:
        """Whether the sensor turns: its field of view is measured in azimuth and elevation."""
        return self.field_of_view[0] > WIDEST_PINHOLE

    @classmethod
    def at_origin(cls, points: npt.ArrayLike) -> "SensorViews":
        """One camera at the origin that looks along z, whose field of view and range just hold the points.

        For a single depth frame in its camera's own coordinates. Only the caller knows that it is one.

        Args:
            points: coordinates [N, 3], finite.

        Raises:
            InputError: points behind the camera, or none.
        """
        coordinates = as_finite_points(points)
        if not len(coordinates) or (coordinates[:, 2] <= 0).any():
            behind = int((coordinates[:, 2] <= 0).sum())
            raise InputError(
                f"views: {behind} of {len(coordinates)} points lie behind a camera at the origin that looks along z; "
                "give the camera's pose as SensorViews(poses, field_of_view, max_range)"
            )
        tangents = np.abs(coordinates[:, :2] / coordinates[:, 2:]).max(axis=0)
        angles = np.minimum(2 * np.degrees(np.arctan(np.maximum(tangents, 1e-3) * MARGIN)), WIDEST_PINHOLE - 1)
        farthest = float(np.linalg.norm(coordinates, axis=1).max())
        return cls(np.eye(4)[None], (float(angles[0]), float(angles[1])), farthest * MARGIN)

    def moved(self, transform: Float64[np.ndarray, "4 4"]) -> "SensorViews":
        """The views after a rigid motion of the world: x becomes `transform @ x`."""
        return SensorViews(transform[None] @ self.poses, self.field_of_view, self.max_range)

    def in_camera(self, points: Float64[np.ndarray, "n 3"], view: int) -> Float64[np.ndarray, "n 3"]:
        """The points in the coordinates of one camera."""
        rotation, position = self.poses[view, :3, :3], self.poses[view, :3, 3]
        return np.asarray((points - position) @ rotation)

    def in_field_of_view(self, camera_points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which points, in a camera's coordinates, are within its angles and its range."""
        x, y, z = camera_points.T
        horizontal, vertical = (np.radians(angle) / 2 for angle in self.field_of_view)
        depth = np.hypot(x, z) if self.turning else z
        inside = (np.abs(np.arctan2(x, z)) <= horizontal) & (np.abs(np.arctan2(y, depth)) <= vertical)
        return np.asarray(inside & (x * x + y * y + z * z <= self.max_range**2))


def _checked_poses(poses: Any) -> Float64[np.ndarray, "v 4 4"]:
    try:
        array = np.array(poses, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"views: poses must be numbers [V, 4, 4], camera to world ({one_line(error)})") from error
    check_poses(array, "views")
    return array


def check_poses(poses: Float64[np.ndarray, "..."], owner: str) -> None:
    """Whether these are rigid motions.

    Args:
        poses: what should be poses [V, 4, 4].
        owner: what they belong to, at the start of the message.

    Raises:
        InputError: they are not; it names the first that is wrong.
    """
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not len(poses):
        hint = "; give one pose as poses[None]" if poses.shape == (4, 4) else ""
        raise InputError(
            f"{owner}: poses must have the shape [V, 4, 4] with V at least 1, not {list(poses.shape)}{hint}"
        )
    finite = np.isfinite(poses).all(axis=(1, 2))
    if not finite.all():
        raise InputError(f"{owner}: pose {int(np.argmin(finite))} of {len(poses)} has NaN or inf; leave it out")
    rotations = poses[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        error_of_pose = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        rigid = (error_of_pose < RIGID_TOLERANCE) & (np.linalg.det(rotations) > 0)
    rigid &= np.abs(poses[:, 3] - np.array([0, 0, 0, 1])).max(axis=1) < RIGID_TOLERANCE
    if not rigid.all():
        raise InputError(
            f"{owner}: pose {int(np.argmin(rigid))} of {len(poses)} is not rigid; a pose is a rotation and a shift, "
            "camera to world, with the last row 0 0 0 1 (no scale, no reflection, not transposed)"
        )


def _checked_angles(angles: Any) -> tuple[float, float]:
    try:
        horizontal, vertical = (float(angle) for angle in angles)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"views: field_of_view={shown(angles)} must be two angles in degrees") from error
    if not (0 < horizontal <= 360 and 0 < vertical < 180):
        raise InputError(
            f"views: field_of_view={(horizontal, vertical)} must be the full horizontal angle in degrees, up to 360, "
            "and the vertical one, below 180"
        )
    return horizontal, vertical


def _checked_range(length: Any) -> float:
    number = isinstance(length, int | float | np.integer | np.floating) and not isinstance(length, bool)
    if not (number and 0 < float(length) < np.inf):
        raise InputError(
            f"views: max_range={shown(length)} must be a positive, finite length, in the unit of the clouds"
        )
    return float(length)
