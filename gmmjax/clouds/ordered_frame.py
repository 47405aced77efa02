"""The view that an ordered depth frame was taken from, where its file has the pose and its pixels confirm it."""

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError
from gmmjax.geometry import rigid_transform

# How far (standard deviation, as a share of the image) the directions of pixels may be from a pinhole camera's: lens
# distortion is less, a wrong pose or a turning scanner more.
PINHOLE_TOLERANCE = 0.02
# A quaternion in a text file is a unit one up to rounding.
QUATERNION_TOLERANCE = 1e-2
MIN_PIXELS = 16
# Of points in the coordinates of the sensor.
AT_ORIGIN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def frame_views(
    points: Float64[np.ndarray, "n 3"],
    pixels: Int64[np.ndarray, " n"],
    width: int,
    viewpoint: tuple[float, ...],
) -> SensorViews | None:
    """The view of an ordered frame, never guessed: the pose is the file's, and the points must agree with it.

    In the camera's coordinates (x right, y down, z forward, as the frames of the Point Cloud Library) all points must
    lie in front of it, x / z must grow evenly with the column and y / z with the row of the image, as in a pinhole
    camera. Field of view and range just hold the points.

    Args:
        points: the frame's points that have a depth.
        pixels: the index of each in the image, row by row.
        width: columns of the image.
        viewpoint: the sensor's position and its orientation as a quaternion w, x, y, z, in the frame of the points.

    Returns:
        One view, or None where the pose is not one or the points do not fit it.
    """
    pose = pose_of(viewpoint)
    if pose is None or len(points) < MIN_PIXELS:
        return None
    # Numbers beyond the range of floats fit no camera, and comparisons with what becomes of them are false.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _view_from(pose, points, pixels, width)


def _view_from(
    pose: Float64[np.ndarray, "4 4"], points: Float64[np.ndarray, "n 3"], pixels: Int64[np.ndarray, " n"], width: int
) -> SensorViews | None:
    camera_points = (points - pose[:3, 3]) @ pose[:3, :3]
    if (camera_points[:, 2] <= 0).any():
        return None
    rows, columns = np.divmod(pixels, width)
    tangents = camera_points[:, :2] / camera_points[:, 2:]
    if not (_grows_evenly(tangents[:, 0], columns) and _grows_evenly(tangents[:, 1], rows)):
        return None
    try:
        return SensorViews.at_origin(camera_points).moved(pose)
    except InputError:
        return None


def pose_of(viewpoint: tuple[float, ...]) -> Float64[np.ndarray, "4 4"] | None:
    """The pose, sensor to the frame of the points, that PCD's position and quaternion are; None where they are none.

    Args:
        viewpoint: x, y, z and w, x, y, z.
    """
    numbers = np.array(viewpoint)
    if numbers.shape != (7,) or not np.isfinite(numbers).all():
        return None
    # No component of a unit quaternion is above 1; the squares of greater ones may overflow.
    if np.abs(numbers[3:]).max() > 2 or abs(float(np.linalg.norm(numbers[3:])) - 1) > QUATERNION_TOLERANCE:
        return None
    return rigid_transform(Rotation.from_quat(numbers[[4, 5, 6, 3]]).as_matrix(), numbers[:3])


def viewpoint_of(pose: Float64[np.ndarray, "4 4"]) -> tuple[float, ...]:
    """Position and quaternion w, x, y, z, as PCD has them.

    Args:
        pose: sensor to the frame of the points, rigid.
    """
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return tuple(float(number) for number in (*pose[:3, 3], w, x, y, z))


def _grows_evenly(tangents: Float64[np.ndarray, " n"], pixels: Int64[np.ndarray, " n"]) -> bool:
    offsets = pixels - pixels.mean()
    spread = float(offsets @ offsets)
    if spread == 0:
        return False
    slope = float(offsets @ tangents) / spread
    error = tangents - tangents.mean() - slope * offsets
    return slope > 0 and float(error.std()) < PINHOLE_TOLERANCE * slope * float(np.ptp(offsets))
