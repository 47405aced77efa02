"""A cloud of any size, read once and thinned to the means of voxels: what stands for all of it in memory."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds.cloud_file import Bounds, CloudChunk
from gmmjax.clouds.voxel_grid import AXIS_BITS, voxel_keys


@dataclasses.dataclass(frozen=True, eq=False)
class ThinnedCloud:
    """A cloud in voxels of one size.

    Attributes:
        points: the mean of each voxel's points; none where the cloud has none.
        counts: how many points each voxel has.
        bounds: of all points; None: there are none.
    """

    points: Float64[np.ndarray, "m 3"]
    counts: Int64[np.ndarray, " m"]
    bounds: Bounds | None

    @property
    def total(self) -> int:
        """The number of points that it stands for."""
        return int(self.counts.sum())


def thinned_cloud(chunks: Iterable[CloudChunk], most: int, first_cells: int = 4096) -> ThinnedCloud:
    """Reads a cloud, and keeps the means of voxels as small as they may be without being more than a given number.

    Args:
        chunks: of the cloud, some points at a time.
        most: number of voxels. Fewer: less memory, and larger voxels.
        first_cells: voxels along the longest side of the first chunk, before they are doubled. Few: small clouds are
            thinned, too.
    """
    thinning = _Thinning(most, first_cells)
    for chunk in chunks:
        if len(chunk.points):
            thinning.add(chunk.points)
    return thinning.result()


class _Thinning:
    """The voxels so far, by the indices of a grid that is doubled when they become too many."""

    def __init__(self, most: int, first_cells: int):
        self._most, self._first_cells = most, first_cells
        self._corner, self._size = np.zeros(3), 0.0
        self._boxes: list[Float64[np.ndarray, "2 3"]] = []
        self._indices = np.empty((0, 3), np.int64)
        # The sum of the offsets from the corner, and the number of points.
        self._sums = np.empty((0, 4))

    def add(self, points: Float64[np.ndarray, "n 3"]) -> None:
        """Takes in some points."""
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        self._boxes.append(box)
        if not self._size:
            self._corner = box[0]
            self._size = float(np.ptp(box, axis=0).max()) / self._first_cells or 1.0
        offsets = points - self._corner
        while np.abs(offsets).max() / self._size >= 2 ** (AXIS_BITS - 2):
            self._double()
        indices = np.floor(offsets / self._size).astype(np.int64)
        own = _gathered(indices, np.c_[offsets, np.ones(len(offsets))])
        both = (np.concatenate(parts) for parts in zip((self._indices, self._sums), own, strict=True))
        self._indices, self._sums = _gathered(*both)
        while len(self._indices) > self._most:
            self._double()

    def _double(self) -> None:
        self._size *= 2
        self._indices, self._sums = _gathered(self._indices >> 1, self._sums)

    def result(self) -> ThinnedCloud:
        """The means of the voxels."""
        counts = self._sums[:, 3]
        points = self._corner + self._sums[:, :3] / counts[:, None]
        boxes = np.array(self._boxes)
        bounds = Bounds(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)) if len(boxes) else None
        return ThinnedCloud(points, counts.astype(np.int64), bounds)


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
