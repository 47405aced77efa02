"""The ground of a scan as a map: how many points there are in each cell of it, and how high."""

import dataclasses

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import percentile_filter


@dataclasses.dataclass(frozen=True)
class GroundSettings:
    """Settings that tell which points of a scan belong to the ground.

    All values are empirical, chosen with those of `StationSettings`.

    Attributes:
        lowest: which of the lowest points of a cell, and of the cells around it, is taken for the ground's height. 0:
            the lowest, which may be a stray point.
        block: cells along the side of a block, of which the lowest ground counts in the next one.
        window: blocks along the side of a neighbourhood, the ground of which is not more than `rise` below a cell's.
            1: below a station, where there is a hole, a roof is taken for the ground.
        rise: in cells. Infinite: roofs and tables are ground; 0: nothing is on slopes.
        thickness: in cells, within which points belong to the ground. Infinite: walls and goods on it, too.
    """

    lowest: float = 0.1
    block: int = 3
    window: int = 5
    rise: float = 3.0
    thickness: float = 0.3


@dataclasses.dataclass(frozen=True, eq=False)
class GroundMap:
    """The ground of a scan as a map, seen from above.

    Attributes:
        counts: number of points in each cell.
        heights: of the ground there, in the unit of the points; NaN where there are no points.
        corner: the map's lowest one, x and y, in that unit.
        cell: edge of a cell, in that unit.
        points_per_cell: in the mean.
    """

    counts: Float64[np.ndarray, "i j"]
    heights: Float64[np.ndarray, "i j"]
    corner: Float64[np.ndarray, "2"]
    cell: float
    points_per_cell: float

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        weights: Float64[np.ndarray, " n"],
        points_per_cell: float,
        settings: GroundSettings,
    ) -> "GroundMap | None":
        """The map of some points; None where they have no area.

        Args:
            points: finite coordinates in any unit; z points up.
            weights: how many points each of them stands for.
            points_per_cell: mean number of points in a cell.
            settings: what is the ground.
        """
        corner = points[:, :2].min(axis=0)
        extent = points[:, :2].max(axis=0) - corner
        cell = float(np.sqrt(np.prod(extent) * points_per_cell / len(points)))
        if not cell or (extent / cell).max() > len(points):
            return None
        shape = (extent / cell).astype(int) + 1
        index = np.ravel_multi_index(tuple(((points[:, :2] - corner) / cell).astype(int).T), shape)
        order = np.lexsort((points[:, 2], index))
        index, height = index[order], points[order, 2]
        starts = np.flatnonzero(np.append(True, index[1:] != index[:-1]))
        number = np.diff(starts, append=len(index))
        heights = np.full(shape.prod(), np.nan)
        heights[index[starts]] = height[starts + (settings.lowest * number).astype(int)]
        lowest = _lowest_around(heights.reshape(shape), settings).ravel()
        ground = (heights - lowest <= settings.rise * cell)[index]
        ground &= np.abs(height - heights[index]) <= settings.thickness * cell
        counts = np.bincount(index[ground], weights[order][ground], minlength=len(heights)).astype(float)
        return cls(counts.reshape(shape), heights.reshape(shape), corner, cell, points_per_cell)

    def offsets(
        self, centre: Float64[np.ndarray, "2"]
    ) -> tuple[Float64[np.ndarray, "i 1"], Float64[np.ndarray, "1 j"]]:
        """Offsets of each row and each column from a place, in cells.

        Args:
            centre: the place, by the rows and columns of the map.
        """
        rows, columns = np.ogrid[: self.counts.shape[0], : self.counts.shape[1]]
        return rows - centre[0], columns - centre[1]

    def distances(self, centre: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "i j"]:
        """Distance of each cell from a place, in cells.

        Args:
            centre: the place, by the rows and columns of the map.
        """
        return np.asarray(np.hypot(*self.offsets(centre)))


def _lowest_around(heights: Float64[np.ndarray, "i j"], settings: GroundSettings) -> Float64[np.ndarray, "i j"]:
    """The ground in the neighbourhood of each cell."""
    padding = [(0, -length % settings.block) for length in heights.shape]
    filled = np.pad(np.nan_to_num(heights, nan=np.inf), padding, constant_values=np.inf)
    shape = [length // settings.block for length in filled.shape]
    blocks = filled.reshape(shape[0], settings.block, shape[1], settings.block).min(axis=(1, 3))
    around = percentile_filter(blocks, 100 * settings.lowest, size=settings.window, mode="constant", cval=np.inf)
    lowest = np.repeat(np.repeat(around, settings.block, axis=0), settings.block, axis=1)
    return lowest[: heights.shape[0], : heights.shape[1]]
