"""The views of a sensor: where it stood, and what it could see from there."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float64

from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.clouds.stray_points import without_stray_points
from gmmjax.errors import InputError, one_line, shown
from gmmjax.geometry import rigid_transform

# Rounding in files with seven digits; a pose with a scale or a reflection is far beyond.
RIGID_TOLERANCE = 1e-3
WIDEST_PINHOLE = 180.0
# What a derived field of view and range are widened by, so that the outermost points are inside.
MARGIN = 1.02
# Axes of a level scanner in a world whose z points up, as columns: x right, y down, z forward along the world's y.
LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
# Full vertical angle of a scanner that sees up to the zenith, degrees.
WIDEST_ELEVATION = 179.8
# Largest angle between the direction to a point and the mean direction, degrees, for a sensor of which only the
# position is known to be a camera that looks there; the images of wider ones are stretched at the rim.
CAMERA_ANGLE = 75.0
# Largest distance of a position from the nearest point, in diagonals of the cloud: farther, it is in another unit.
FARTHEST = 100.0


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
        """Take whatever can be made an array [V, 4, 4], two angles and a number, and checks it; see `Raises`."""
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
        """True for a sensor that turns: its field of view is measured in azimuth and elevation."""
        return self.field_of_view[0] > WIDEST_PINHOLE

    @classmethod
    def at_origin(cls, points: npt.ArrayLike) -> "SensorViews":
        """One camera at the origin that looks along z, whose field of view and range just hold the points.

        For a single depth frame in its camera's own coordinates. Only the caller knows that it is one. Stray points, as
        of `scan_bounds`, do not count.

        Args:
            points: coordinates [N, 3], finite.

        Raises:
            InputError: points behind the camera, or none.
        """
        coordinates = without_stray_points(as_finite_points(points))
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

    @classmethod
    def from_positions(cls, points: npt.ArrayLike, positions: npt.ArrayLike) -> "SensorViews":
        """The views of a sensor of which only the positions are known: field of view and range are read from the cloud.

        Where all points lie to one side of every position the sensor is a camera that looks at them, upright where z
        points up. Otherwise it is a scanner that turns by 360 degrees about z. Its vertical angle just holds the
        points, and its range reaches all of them from every position.

        A direction without any point counts as not observed whatever the field of view. So what it is wider than the
        true one makes no empty space of what was never looked at.

        Args:
            points: coordinates [N, 3] of the cloud, finite.
            positions: of the sensor [V, 3], or [3] for a single one, in the frame and unit of the points.

        Raises:
            InputError: positions that are not finite or too far from the points to be theirs; no points.
        """
        coordinates = without_stray_points(as_finite_points(points))
        return cls.from_parts(lambda: [coordinates], positions)

    @classmethod
    def from_parts(
        cls, parts: Callable[[], Iterable[Float64[np.ndarray, "n 3"]]], positions: npt.ArrayLike
    ) -> "SensorViews":
        """Views by `from_positions`, for a cloud that is given in parts, such as one that is larger than the memory.

        Args:
            parts: gives the cloud's points, finite [N, 3], in parts; called twice or three times.
            positions: of the sensor [V, 3], or [3] for a single one, in the frame and unit of the points.

        Raises:
            InputError: positions that are not finite or too far from the points to be theirs; no points.
        """
        places = _checked_positions(positions)
        _check_distances(parts(), places)
        directions = [_Directions(place) for place in places]
        for points in parts():
            for own in directions:
                own.add(points)
        reach = max(own.reach for own in directions) * MARGIN
        cameras = _cameras(parts(), directions)
        if cameras is not None:
            rotations, tangents = (np.stack(part) for part in zip(*cameras, strict=True))
            angles = 2 * np.degrees(np.arctan(np.maximum(tangents.max(axis=0), 1e-3) * MARGIN))
            return cls(rigid_transform(rotations, places), np.minimum(angles, WIDEST_PINHOLE - 1), reach)
        level = np.tile(LEVEL, (len(places), 1, 1))
        elevation = max(own.elevation for own in directions)
        vertical = min(2 * np.degrees(np.arcsin(elevation)) * MARGIN + 1, WIDEST_ELEVATION)
        return cls(rigid_transform(level, places), (360.0, float(vertical)), reach)

    @classmethod
    def merged(cls, views: Sequence["SensorViews"]) -> "SensorViews":
        """All views of several scans of one survey, as far and as wide as the farthest and the widest of them.

        Where some are cameras' and others a turning scanner's, all turn, about z: a direction without any point counts
        as not observed whatever the field of view, so that nothing is taken for seen that was not.

        Args:
            views: of each scan, in one frame; at least one.
        """
        poses, reach = np.concatenate([own.poses for own in views]), max(own.max_range for own in views)
        width, height = (max(own.field_of_view[axis] for own in views) for axis in range(2))
        if len({own.turning for own in views}) == 2:
            poses[:, :3, :3] = np.where(
                np.repeat([own.turning for own in views], [len(own) for own in views])[:, None, None],
                poses[:, :3, :3],
                LEVEL,
            )
            height = WIDEST_ELEVATION
        return cls(poses, (width, height), reach)

    def moved(self, transform: Float64[np.ndarray, "4 4"]) -> "SensorViews":
        """The views after a rigid motion of the world: x becomes `transform @ x`."""
        return SensorViews(transform[None] @ self.poses, self.field_of_view, self.max_range)

    def relative_to(self, offset: Float64[np.ndarray, "3"]) -> "SensorViews":
        """The views in coordinates relative to an offset: x becomes x - offset."""
        poses = self.poses.copy()
        poses[:, :3, 3] -= offset
        return SensorViews(poses, self.field_of_view, self.max_range)

    def in_camera(self, points: Float64[np.ndarray, "n 3"], view: int) -> Float64[np.ndarray, "n 3"]:
        """The points in the coordinates of one camera."""
        rotation, position = self.poses[view, :3, :3], self.poses[view, :3, 3]
        return np.asarray((points - position) @ rotation)

    def in_field_of_view(self, camera_points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Mask of the points, in a camera's coordinates, within its angles and its range."""
        x, y, z = camera_points.T
        horizontal, vertical = (np.radians(angle) / 2 for angle in self.field_of_view)
        depth = np.hypot(x, z) if self.turning else z
        inside = (x * x + y * y + z * z <= self.max_range**2) & (np.abs(np.arctan2(y, depth)) <= vertical)
        # All directions are within half a turn to either side.
        return np.asarray(inside if horizontal >= np.pi else inside & (np.abs(np.arctan2(x, z)) <= horizontal))


def _checked_positions(positions: Any) -> Float64[np.ndarray, "v 3"]:
    try:
        array = np.array(positions, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"sensor positions must be numbers [V, 3] ({one_line(error)})") from error
    array = array[None] if array.shape == (3,) else array
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise InputError(f"sensor positions must have the shape [V, 3] with V at least 1, not {list(array.shape)}")
    if not np.isfinite(array).all():
        raise InputError("sensor positions must be finite numbers: x, y and z in the frame and unit of the cloud")
    return array


def _check_distances(parts: Iterable[Float64[np.ndarray, "n 3"]], places: Float64[np.ndarray, "v 3"]) -> None:
    """Check that the positions can be those that a cloud was taken from.

    Raises:
        InputError: one of them is too far away, or there are no points.
    """
    boxes = [np.stack([points.min(axis=0), points.max(axis=0)]) for points in parts if len(points)]
    if not boxes:
        raise InputError("sensor positions: the cloud has no points to read the field of view from")
    lower, upper = np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]
    # A position beyond the range of floats is infinitely far away.
    with np.errstate(over="ignore"):
        size = float(np.linalg.norm(upper - lower))
        # To the box around the points, which is never farther than the nearest of them.
        distances = np.linalg.norm(places - np.clip(places, lower, upper), axis=1)
    worst = int(np.argmax(distances))
    if distances[worst] > FARTHEST * size:
        place = ", ".join(f"{value:.6g}" for value in places[worst])
        raise InputError(
            f"the sensor position ({place}) is {distances[worst]:.3g} away from a cloud that is only {size:.3g} large; "
            "give it in the frame and unit of the cloud"
        )


class _Directions:
    """The directions from a position to the points of a cloud, summed up.

    Attributes:
        total: sum of the unit vectors.
        elevation: largest sine of the angle above or below the horizon.
        reach: distance of the farthest point.
    """

    def __init__(self, place: Float64[np.ndarray, "3"]) -> None:
        self._place = place
        self.total, self.elevation, self.reach = np.zeros(3), 0.0, 0.0

    def add(self, points: Float64[np.ndarray, "n 3"]) -> None:
        """Take some of the points into account."""
        directions, ranges = self.unit_vectors(points)
        self.total = self.total + directions.sum(axis=0)
        self.elevation = max(self.elevation, float(np.abs(directions[:, 2]).max(initial=0.0)))
        self.reach = max(self.reach, float(ranges.max(initial=0.0)))

    def unit_vectors(
        self, points: Float64[np.ndarray, "n 3"]
    ) -> tuple[Float64[np.ndarray, "m 3"], Float64[np.ndarray, " n"]]:
        """Directions to the points that are not at the position itself, such as missing returns, and all distances."""
        offsets = points - self._place
        ranges = np.linalg.norm(offsets, axis=1)
        return offsets[ranges > 0] / ranges[ranges > 0, None], ranges

    def axes(self) -> Float64[np.ndarray, "3 3"]:
        """Axes of a camera that looks along the mean direction, upright where z points up, else x right and y down."""
        forward = self.total / np.linalg.norm(self.total)
        down = np.array([0.0, 0.0, -1.0]) if abs(forward[2]) < 0.7 else np.array([0.0, 1.0, 0.0])
        right = np.cross(down, forward)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward], axis=1)


def _cameras(
    parts: Iterable[Float64[np.ndarray, "n 3"]], directions: list[_Directions]
) -> list[tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 2"]]] | None:
    """Axes of the camera at each position, and tangents of its half angles.

    Args:
        parts: of the points.
        directions: to all of them, from each position.

    Returns:
        None where one of the directions from a position is more than `CAMERA_ANGLE` from their mean.
    """
    if any(np.linalg.norm(own.total) == 0 for own in directions):
        return None
    axes = [own.axes() for own in directions]
    tangents = [np.zeros(2) for _ in directions]
    for points in parts:
        for index, own in enumerate(directions):
            inside = own.unit_vectors(points)[0] @ axes[index]
            if inside[:, 2].min(initial=1.0) < np.cos(np.radians(CAMERA_ANGLE)):
                return None
            tangents[index] = np.maximum(
                tangents[index], np.abs(inside[:, :2] / inside[:, 2:]).max(axis=0, initial=0.0)
            )
    return list(zip(axes, tangents, strict=True))


def _checked_poses(poses: Any) -> Float64[np.ndarray, "v 4 4"]:
    try:
        array = np.array(poses, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"views: poses must be numbers [V, 4, 4], camera to world ({one_line(error)})") from error
    check_poses(array, "views")
    return array


def check_poses(poses: Float64[np.ndarray, "..."], owner: str) -> None:
    """Check that poses are rigid motions.

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
