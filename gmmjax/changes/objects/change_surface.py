"""A change with what both scans show about its place: what its volume is measured from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from gmmjax.changes.objects.plane_grid import PlaneGrid
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


class ChangeSurface(NamedTuple):
    """A change with what both scans show about its place. Coordinates are relative to the change.

    Attributes:
        labelled: points of the change, without outliers, in either scan; of one that is found in one scan only the
            other one has none.
        clouds: all points of both scans about its place.
        others: points of the other changes of both scans about its place.
        reference: the other scan's surface about its place.
        outward: unit normal of that surface, to the outer side.
    """

    labelled: Pair[Float64[np.ndarray, "_ 3"]]
    clouds: Pair[Float64[np.ndarray, "_ 3"]]
    others: Float64[np.ndarray, "m 3"]
    reference: LocalSurface
    outward: Float64[np.ndarray, " 3"]

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """Of the change, in both scans."""
        return np.concatenate([*self.labelled])

    def across(self) -> Float64[np.ndarray, "2 3"]:
        """Unit vectors in its plane, along and across its longest extent: they turn with the change."""
        points = self.points
        axes = np.linalg.svd(self.outward[None])[2][1:]
        places = points @ axes.T
        places = places - places.mean(axis=0)
        first = np.linalg.eigh(places.T @ places)[1][:, -1] @ axes
        # Towards the longer tail.
        along = places @ (axes @ first)
        first = first if (along**3).sum() >= 0 else -first
        return np.stack([first, np.cross(self.outward, first)])

    def divided(self, grid: PlaneGrid, cells: Bool[np.ndarray, "r c"]) -> tuple["ChangeSurface", "ChangeSurface"]:
        """The change without some cells of its plane, and that in these cells; to each the other one is another change.

        Args:
            grid: of its plane, along `across`.
            cells: of the second part.
        """
        across = self.across()
        inside = self.labelled.map(lambda own: cells.ravel()[grid.cells(own @ across.T)])

        def part(chosen: Pair[Bool[np.ndarray, " _"]]) -> "ChangeSurface":
            own = each(lambda points, rows: points[rows], self.labelled, chosen)
            rest = each(lambda points, rows: points[~rows], self.labelled, chosen)
            return self._replace(labelled=own, others=np.concatenate([self.others, *rest]))

        return part(inside.map(np.logical_not)), part(inside)
