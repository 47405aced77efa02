"""Points gathered in cubes, each with its number of points as mass."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64, Int64

from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.errors import InputError

AXIS_BITS = 21
"""Bits of a voxel's index on an axis: three of them fit a 64-bit integer."""

SIZE_TOLERANCE = 1.02
# Of the number of voxels over their size, on logarithms: where the search begins, and the least that it believes.
FIRST_SLOPE, MIN_SLOPE = 2.5, 0.3


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """The occupied voxels of a cloud, in the order of their x, then y, then z index.

    Attributes:
        points: the mean of each voxel's points, in their unit.
        mass: how many points each voxel has.
        voxel_of_point: the voxel of each point of the cloud.
    """

    points: Float64[np.ndarray, "m 3"]
    mass: Float64[np.ndarray, " m"]
    voxel_of_point: Int64[np.ndarray, " n"]

    def scatter(self, points: npt.ArrayLike) -> Float64[np.ndarray, "m 3 3"]:
        """The covariance of each voxel's points about their mean, in the square of their unit.

        Args:
            points: the cloud of which this is the grid, [n, 3].
        """
        deviations = np.asarray(points, np.float64) - self.points[self.voxel_of_point]
        covariances = np.empty((len(self.mass), 3, 3))
        for row, column in zip(*np.triu_indices(3), strict=True):
            products = deviations[:, row] * deviations[:, column]
            sums = np.bincount(self.voxel_of_point, weights=products, minlength=len(self.mass))
            covariances[:, row, column] = covariances[:, column, row] = sums / self.mass
        return covariances


def voxel_grid(points: npt.ArrayLike, size: float) -> VoxelGrid:
    """Gather points in cubes whose common corner is the cloud's lowest x, y and z.

    Args:
        points: coordinates [N, 3], in any unit, finite.
        size: the edge of a cube, in the unit of the points.

    Returns:
        The occupied voxels.

    Raises:
        InputError: points that are not finite [N, 3], or a size that is not positive or is less than the cloud's
            longest side divided by 2^21.
    """
    coordinates = as_finite_points(points)
    if not len(coordinates):
        return VoxelGrid(coordinates.copy(), np.zeros(0), np.zeros(0, np.int64))
    corner, offsets = _offsets(coordinates)
    _check_size(size, float(offsets.max()))
    keys, voxel_of_point = np.unique(_keys(offsets, size), return_inverse=True)
    mass = np.bincount(voxel_of_point, minlength=len(keys)).astype(np.float64)
    # Sums of offsets, not of coordinates: at 1e6 m the latter would cost six digits.
    sums = [np.bincount(voxel_of_point, weights=offsets[axis], minlength=len(keys)) for axis in range(3)]
    return VoxelGrid(corner + np.stack(sums, axis=1) / mass[:, None], mass, voxel_of_point.astype(np.int64, copy=False))


def voxel_size_for(points: npt.ArrayLike, max_voxels: int) -> float:
    """The smallest voxel size, within 2 %, whose grid has at most `max_voxels` occupied voxels.

    The number of voxels falls with the size but for small ripples, so that a size below the answer may fit too.

    Args:
        points: coordinates [N, 3], in any unit, finite.
        max_voxels: the highest number of occupied voxels.

    Returns:
        The size, in the unit of the points, with which `voxel_grid` gives at most `max_voxels` voxels. Where the cloud
        has no more points than that, the smallest size that `voxel_grid` takes.

    Raises:
        InputError: points that are not finite [N, 3] or all at the same place, or `max_voxels` below 1.
    """
    coordinates = as_finite_points(points)
    if max_voxels < 1:
        raise InputError(f"max_voxels must be at least 1, not {max_voxels}; 10000 is usual")
    if not len(coordinates):
        raise InputError("points: there are none, so no voxel size follows from them; give at least two")
    _, offsets = _offsets(coordinates)
    extent = float(offsets.max())
    if _smallest_size(extent) < np.finfo(np.float64).tiny:
        raise InputError("points: all are at the same place, so no voxel size follows from them; give a size")
    smallest, largest = _smallest_size(extent), extent * SIZE_TOLERANCE
    if len(coordinates) <= max_voxels or _occupied(offsets, smallest) <= max_voxels:
        return smallest
    return _bracketed(lambda size: _occupied(offsets, size), max_voxels, smallest, largest)


def _bracketed(occupied: Callable[[float], int], max_voxels: int, smallest: float, largest: float) -> float:
    """The right end of a bracket of 2 %, by secants on the logarithms of size and number, which are near linear there.

    A secant aims a little beyond the answer, so that the next one closes the bracket from the other side. One that
    leaves the bracket, and the tenth, give way to the middle.
    """
    low, high = math.log(smallest), math.log(largest)
    margin = 0.4 * math.log(SIZE_TOLERANCE)
    # A cloud that fills space has voxels as the cube of the size, one of surfaces as the square.
    guess, slope, previous = high - math.log(max_voxels) / FIRST_SLOPE, -FIRST_SLOPE, None
    step = 0
    while high - low > math.log(SIZE_TOLERANCE):
        step += 1
        if not low < guess < high or step % 10 == 0:
            guess = (low + high) / 2
        excess = math.log(occupied(math.exp(guess)) / max_voxels)
        low, high = (low, guess) if excess <= 0 else (guess, high)
        if previous is not None and guess != previous[0]:
            # Where nearly every point has a voxel of its own, the number hardly falls.
            slope = min((excess - previous[1]) / (guess - previous[0]), -MIN_SLOPE)
        previous = guess, excess
        guess = guess - excess / slope + (margin if excess > 0 else -margin)
    return math.exp(high)


def _offsets(coordinates: Float64[np.ndarray, "n 3"]) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 n"]]:
    """The lowest corner, and the points relative to it, axis by axis: NumPy is many times as fast along rows."""
    columns = np.ascontiguousarray(coordinates.T)
    corner = columns.min(axis=1)
    with np.errstate(over="ignore"):
        offsets = columns - corner[:, None]
    if not np.isfinite(offsets.max()):
        raise InputError("points: the cloud is larger than a float64 can hold; check its unit")
    return corner, offsets


def _smallest_size(extent: float) -> float:
    """The smallest size with indices below 2^21; a little more than the quotient, so that rounding cannot undo it."""
    return extent / float(2**AXIS_BITS) * (1 + 1e-6)


def _check_size(size: float, extent: float) -> None:
    if not (size > 0 and math.isfinite(size)):
        raise InputError(
            f"size: the voxel size must be positive and finite, not {size}; 0.01 (1 cm) is usual for scans"
        )
    if size < _smallest_size(extent):
        raise InputError(
            f"size: a voxel size of {size} m is too small for a cloud {extent} m long; "
            f"give at least {_smallest_size(extent)} m"
        )


def _keys(offsets: Float64[np.ndarray, "3 n"], size: float) -> Int64[np.ndarray, " n"]:
    """The three indices of each point's voxel in one integer."""
    return voxel_keys((offsets / size).astype(np.int64))


def voxel_keys(indices: Int64[np.ndarray, "3 n"]) -> Int64[np.ndarray, " n"]:
    """The three indices of voxels in one integer, in the order of the first, then the second and the third.

    Args:
        indices: from 0, below 2^21.
    """
    x, y, z = indices
    keys: Int64[np.ndarray, " n"] = (x << 2 * AXIS_BITS) | (y << AXIS_BITS) | z
    return keys


def _occupied(offsets: Float64[np.ndarray, "3 n"], size: float) -> int:
    """The number of voxels with points; sorting beats hashing here."""
    keys = np.sort(_keys(offsets, size))
    return 1 + int(np.count_nonzero(keys[1:] != keys[:-1]))
