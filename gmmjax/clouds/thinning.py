"""A cloud of any size, read once and thinned to the means of voxels: what stands for all of it in memory."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float64, Int64

from gmmjax.clouds.cloud_file import Bounds, CloudChunk
from gmmjax.clouds.stray_points import scan_bounds
from gmmjax.clouds.voxel_grid import AXIS_BITS, voxel_keys

# Voxels along the longest side of the first chunk, before they are doubled: fewer, and small clouds are thinned, too.
FIRST_CELLS = 4096


@dataclasses.dataclass(frozen=True, eq=False)
class ThinnedCloud:
    """A cloud in voxels of one size, and a few single points far from them.

    Attributes:
        points: the mean of each voxel's points, then the single points; none where the cloud has none.
        counts: how many points each voxel has; 1 for single points.
        bounds: of all points; None: there are none.
        size: edge of the voxels.
    """

    points: Float64[np.ndarray, "m 3"]
    counts: Int64[np.ndarray, " m"]
    bounds: Bounds | None
    size: float

    @property
    def total(self) -> int:
        """The number of points that it stands for."""
        return int(self.counts.sum())


def thinned_cloud(chunks: Iterable[CloudChunk], most: int) -> ThinnedCloud:
    """Read a cloud, and keep the means of voxels as small as they may be without being more than a given number.

    Args:
        chunks: of the cloud, some points at a time.
        most: number of voxels. Fewer: less memory, and larger voxels.
    """
    thinning = _Thinning(most)
    for chunk in chunks:
        if len(chunk.points):
            thinning.add(chunk.points)
    return thinning.result()


class _Thinning:
    """The voxels so far, by the indices of a grid that is doubled when they become too many."""

    def __init__(self, most: int):
        self._most = most
        self._corner, self._size = np.zeros(3), 0.0
        self._boxes: list[Float64[np.ndarray, "2 3"]] = []
        self._indices = np.empty((0, 3), np.int64)
        # The sum of the offsets from the corner, and the number of points.
        self._sums = np.empty((0, 4))
        # Points beyond the grid: as long as they are few they may be stray.
        self._far = np.empty((0, 3))

    def add(self, points: Float64[np.ndarray, "n 3"]) -> None:
        """Take in some points."""
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        self._boxes.append(box)
        if not self._size:
            bounds = scan_bounds(points)
            scan = box if bounds is None else bounds
            self._corner = scan[0]
            self._size = float(np.ptp(scan, axis=0).max()) / FIRST_CELLS or 1.0
        offsets = self._near(points) - self._corner
        indices = np.floor(offsets / self._size).astype(np.int64)
        own = _gathered(indices, np.c_[offsets, np.ones(len(offsets))])
        both = (np.concatenate(parts) for parts in zip((self._indices, self._sums), own, strict=True))
        self._indices, self._sums = _gathered(*both)
        while len(self._indices) > self._most:
            self._double()

    def _near(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
        """The points in the grid, which is enlarged for those beyond it when they are more than a few."""
        beyond = self._are_beyond(points)
        if not beyond.any():
            return points
        self._far, points = np.concatenate([self._far, points[beyond]]), points[~beyond]
        if 100 * len(self._far) > self._most:
            self._far, points = self._far[:0], np.concatenate([points, self._far])
            while self._are_beyond(points).any():
                self._double()
        return points

    def _are_beyond(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Mask of the points without indices in the grid."""
        return np.asarray(np.abs(points - self._corner).max(axis=1) / self._size >= 2 ** (AXIS_BITS - 2))

    def _double(self) -> None:
        self._size *= 2
        self._indices, self._sums = _gathered(self._indices >> 1, self._sums)

    def result(self) -> ThinnedCloud:
        """The means of the voxels."""
        points = np.concatenate([self._corner + self._sums[:, :3] / self._sums[:, 3:], self._far])
        counts = np.append(self._sums[:, 3], np.ones(len(self._far)))
        boxes = np.array(self._boxes)
        bounds = Bounds(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)) if len(boxes) else None
        return ThinnedCloud(points, counts.astype(np.int64), bounds, self._size)


def _gathered(
    indices: Int64[np.ndarray, "n 3"], sums: Float64[np.ndarray, "n 4"]
) -> tuple[Int64[np.ndarray, "m 3"], Float64[np.ndarray, "m 4"]]:
    """The different voxels, in the order of their indices, with the sums of each."""
    if not len(indices):
        return indices, sums
    keys = voxel_keys((indices + 2 ** (AXIS_BITS - 1)).T)
    _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    gathered = [np.bincount(place, weights=values, minlength=len(first)) for values in sums.T]
    return indices[first], np.stack(gathered, axis=1)
