"""What a cloud looks like from one place: the nearest surface in every direction."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64
from scipy.ndimage import minimum_filter

# One image serves fields of view up to this wide (degrees); wider ones are cut into the six faces of a cube, on which
# the angles atan(x / z) and atan(y / z) are nearly true to scale.
WIDEST_IMAGE = 110.0
CUBE_FACE = 90.0
# Angles (radians) that a point of the cloud may cover, and how many sizes of bins there are for a factor of two.
FINEST_BIN = np.radians(0.25)
COARSEST_BIN = np.radians(4.0)
LEVELS_PER_OCTAVE = 2
# Just below 90 degrees, radians.
RIGHT_ANGLE = 1.57
# A bin is at least this many times the spacing of the points that fill it, so that a surface leaves none empty.
BIN_PER_SPACING = 1.2


class Camera(NamedTuple):
    """One image of a view.

    Attributes:
        rotation: its axes, as columns, in the coordinates of the view.
        half_angles: how far it sees to the sides, and up and down, radians.
    """

    rotation: Float64[np.ndarray, "3 3"]
    half_angles: Float64[np.ndarray, " 2"]

    def seen(
        self, points: Float64[np.ndarray, "n 3"], rim: float = 1e-9
    ) -> tuple[Int64[np.ndarray, " m"], Float64[np.ndarray, "m 2"], Float64[np.ndarray, " m"]]:
        """The points in the image.

        Args:
            points: in the coordinates of the view.
            rim: angle by which the image is larger, radians.

        Returns:
            Which points these are, their directions (radians) and their ranges.
        """
        x, y, z = self.rotation.T @ points.T
        limits = np.tan(np.minimum(self.half_angles + rim, RIGHT_ANGLE))
        inside = np.flatnonzero((z > 0) & (np.abs(x) <= limits[0] * z) & (np.abs(y) <= limits[1] * z))
        x, y, z = x[inside], y[inside], z[inside]
        angles = np.stack([np.arctan2(x, z), np.arctan2(y, z)], axis=1)
        return inside, angles, np.sqrt(x * x + y * y + z * z)


def cameras(field_of_view: tuple[float, float]) -> list[Camera]:
    """The images that a view is made of: one, or a cube of six where the view is wide.

    Args:
        field_of_view: horizontal and vertical, degrees.
    """
    if max(field_of_view) <= WIDEST_IMAGE:
        return [Camera(np.eye(3), np.radians(np.array(field_of_view)) / 2)]
    x, y, z = np.eye(3)
    faces = [(x, y, z), (-z, y, x), (-x, y, -z), (z, y, -x), (x, -z, y), (x, z, -y)]
    return [Camera(np.stack(face, axis=1), np.radians(np.full(2, CUBE_FACE)) / 2) for face in faces]


class _Resolution(NamedTuple):
    """The nearest range in each bin of one size, and the nearest in it and the eight bins around; inf where empty."""

    bin_size: float
    nearest: Float64[np.ndarray, "h w"]
    nearest_around: Float64[np.ndarray, "h w"]


class DepthImage(NamedTuple):
    """Nearest ranges by direction, at several resolutions: what is near and therefore sparse has larger bins.

    Attributes:
        reach: how far the image reaches to the sides, and up and down, radians.
        levels: from fine to coarse bins; each point of the cloud is in the one that fits its spacing.
    """

    reach: Float64[np.ndarray, " 2"]
    levels: tuple[_Resolution, ...]

    @classmethod
    def of(cls, points: Float64[np.ndarray, "n 3"], spacing: Float64[np.ndarray, " n"], camera: Camera) -> "DepthImage":
        """The image of points in the coordinates of a view.

        Args:
            points: x right, y down, z forward.
            spacing: distance of each point to those beside it on the surface.
            camera: what to see; a little more is seen, so that the bins at the rim have neighbours.
        """
        inside, directions, ranges = camera.seen(points, rim=COARSEST_BIN)
        reach = camera.half_angles + COARSEST_BIN
        footprint = BIN_PER_SPACING * spacing[inside] / np.maximum(ranges, np.finfo(float).tiny)
        finer = np.log2(np.clip(footprint, FINEST_BIN, COARSEST_BIN) / FINEST_BIN)
        level = np.ceil(LEVELS_PER_OCTAVE * finer - 1e-9).astype(int)
        levels = [
            _resolution(directions[level == which], ranges[level == which], _bin_size(int(which)), reach)
            for which in np.unique(level)
        ]
        return cls(reach, tuple(levels))

    def nearest(self, directions: Float64[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray]:
        """The nearest range in each direction: in its own bins, and in the bins around as well; inf where empty.

        Args:
            directions: angles within the image, radians.
        """
        own, around = np.full(len(directions), np.inf), np.full(len(directions), np.inf)
        for level in self.levels:
            row, column = _bins(directions, level.bin_size, self.reach).T
            own = np.minimum(own, level.nearest[row, column])
            around = np.minimum(around, level.nearest_around[row, column])
        return own, around


def _bins(
    directions: Float64[np.ndarray, "n 2"], bin_size: float, reach: Float64[np.ndarray, " 2"]
) -> Int64[np.ndarray, "n 2"]:
    return ((directions + reach) / bin_size).astype(np.int64)


def _bin_size(level: int) -> float:
    return float(FINEST_BIN * 2.0 ** (level / LEVELS_PER_OCTAVE))


def _resolution(
    directions: Float64[np.ndarray, "n 2"],
    ranges: Float64[np.ndarray, " n"],
    bin_size: float,
    reach: Float64[np.ndarray, " 2"],
) -> _Resolution:
    shape = _bins(reach[None], bin_size, reach)[0] + 1
    row, column = _bins(directions, bin_size, reach).T
    nearest = np.full(shape, np.inf)
    np.minimum.at(nearest.reshape(-1), row * shape[1] + column, ranges)
    return _Resolution(bin_size, nearest, minimum_filter(nearest, size=3, mode="constant", cval=np.inf))
