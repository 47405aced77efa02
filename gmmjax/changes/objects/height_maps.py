"""Both scans about a change as heights in the cells of its plane."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy import ndimage

from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.changes.objects.difference_cells import SQUARE
from gmmjax.changes.objects.height_above import HeightAbove
from gmmjax.changes.objects.plane_grid import PlaneGrid
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class HeightMapSettings:
    """How the heights of a scan are measured.

    All values are empirical: they come from development on the scenes of `tests/benchmarks/volumes`.

    Attributes:
        parts: each cell is a grid of this many by this many parts, which count the same however many points they have.
            1: a scan whose density differs within a cell, as on a steep rim, counts its dense part too much.
        planes: number of local planes of the other scan whose mean the heights are measured from, so that a slope
            within a cell is no noise. 1: the edges between two planes are.
        steepest: least cosine between the normal of such a plane and that of the change. 0: upright surfaces, such as
            the trunks on a slope, have heights without bounds, and nothing is known to be a side of an object, between
            which nobody saw its top.
        beyond: points this far above or below all that is of the change, in its thickness, belong to something else,
            such as branches above a slope or a shelf above a floor. Infinite: they are taken for ground.
    """

    parts: int = 2
    planes: int = 4
    steepest: float = 0.3
    beyond: float = 1.0


class HeightMap(NamedTuple):
    """The heights of a scan in the cells, in its unit.

    Attributes:
        heights: mean over the points of each cell; NaN where it has none.
        spread: standard deviation of the heights of these points.
        highest: the greatest of them.
        partly: whether all points of the cell are in one of its parts.
    """

    heights: Float64[np.ndarray, "r c"]
    spread: Float64[np.ndarray, "r c"]
    highest: Float64[np.ndarray, "r c"]
    partly: Bool[np.ndarray, "r c"]

    def rise(self, edge: float, steepest: float) -> Float64[np.ndarray, "r c"]:
        """How far above the mean of a cell its upper end is, where it is steeper than a surface may be; 0 elsewhere.

        Args:
            edge: of the cells.
            steepest: least cosine between the normal of a surface and that of the cells.
        """
        rise = np.nan_to_num(self.highest - self.heights)
        return np.where(rise > edge / 2 * np.tan(np.arccos(steepest)), rise, 0.0)


def height_maps(
    change: ChangeSurface,
    across: Float64[np.ndarray, "2 3"],
    grid: PlaneGrid,
    settings: HeightMapSettings = HeightMapSettings(),
) -> Pair[HeightMap]:
    """The heights of both scans above the reference of the change.

    Args:
        change: with what both scans show there.
        across: unit vectors along the cells.
        grid: the cells.
        settings: how heights are measured.
    """
    heights = HeightAbove(change.reference, change.outward, settings.planes, settings.steepest)
    own = heights.of(change.points)
    lower, upper = min(float(own.min()), 0.0), max(float(own.max()), 0.0)
    margin = settings.beyond * (upper - lower)

    def map_of(cloud: Float64[np.ndarray, "n 3"], labelled: Float64[np.ndarray, "m 3"]) -> HeightMap:
        places, values = cloud @ across.T, heights.of(cloud)
        near = (values >= lower - margin) & (values <= upper + margin)
        found = grid.means(places[near], values[near], settings.parts)
        # What is seen below an overhang, such as the floor under a table, is not the surface of the change.
        whole = ndimage.binary_erosion(grid.counts(labelled @ across.T) > 0, SQUARE)
        squares = grid.means(places[near], values[near] ** 2, settings.parts)
        spread = np.sqrt(np.maximum(squares - found**2, 0))
        found = np.where(whole, grid.means(labelled @ across.T, heights.of(labelled), settings.parts), found)
        highest = grid.greatest(places[near], values[near])
        return HeightMap(found, spread, highest, (settings.parts > 1) & (grid.seen(places[near], settings.parts) == 1))

    return each(map_of, change.clouds, change.labelled)
