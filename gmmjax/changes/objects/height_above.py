"""Heights above the surface of a scan, in the direction that a change is measured in."""

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from gmmjax.geometry import LocalSurface, nearest_neighbours


class HeightAbove:
    """Heights above the local planes of a surface, along the normal of a change."""

    def __init__(self, surface: LocalSurface, outward: Float64[np.ndarray, " 3"], planes: int, steepest: float) -> None:
        """Heights above a surface.

        Args:
            surface: at least one point.
            outward: unit normal of the change.
            planes: number of local planes whose mean the heights are measured from.
            steepest: least cosine between the normal of such a plane and that of the change; it is level below it.
        """
        across, steep = np.linalg.svd(outward[None])[2][1:], surface.normals @ outward
        fair = np.abs(steep) >= steepest
        # Level where the surface is too steep to have a slope.
        slopes = np.where(fair[:, None], -(surface.normals @ across.T) / np.where(fair, steep, 1.0)[:, None], 0.0)
        self._across, self._outward, self._count = across, outward, planes
        self._places, self._slopes = surface.centres @ across.T, slopes
        self._heights, self._tree = surface.centres @ outward, cKDTree(surface.centres @ across.T)

    def of(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """The height of each point, in the unit of the surface."""
        places = points @ self._across.T
        near = nearest_neighbours(self._tree, places, self._count)[1]
        offsets = places[:, None] - self._places[near]
        planes = self._heights[near] + (offsets * self._slopes[near]).sum(axis=2)
        return np.asarray(points @ self._outward - planes.mean(axis=1))
