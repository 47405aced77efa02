"""How far points are off the surface of the other cloud that lies opposite them."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from gmmjax.changes.differences import DetectionLimits
from gmmjax.geometry import LocalSurface


@dataclasses.dataclass(frozen=True)
class DisplacementSettings:
    """From where on a point is displaced from the surface of the other cloud.

    Attributes:
        opposite: distance along the surface of the other cloud, in its spacings there, within which it lies opposite a
            point. Larger: the rim of a hole lies opposite what is in the hole; 0: nothing does.
        undisplaced: number of the unchanged points next to a candidate that tell how far the whole surface is off
            there. Few: a displacement that thins out is taken for that of the whole surface.
        sure: offset, in registration errors and in standard deviations of the offset there, from which on a point is
            surely off a surface. 0: by whatever it is off.
    """

    opposite: float = 1.5
    undisplaced: int = 400
    sure: float = 3.0


class Displacements(NamedTuple):
    """How far points are off the surface of the other cloud.

    Attributes:
        vectors: from that surface to each point, along its normal, in the unit of the clouds.
        opposite: whether the surface lies opposite the point, and neither beside it nor farther off than a spacing.
    """

    vectors: Float[np.ndarray, "m 3"]
    opposite: Bool[np.ndarray, " m"]

    @classmethod
    def of(
        cls,
        points: Float[np.ndarray, "m 3"],
        surface: LocalSurface,
        limits: DetectionLimits,
        settings: DisplacementSettings = DisplacementSettings(),
    ) -> "Displacements":
        """How far some points are off a surface.

        Args:
            points: of one cloud.
            surface: of the other cloud.
            limits: of distances and offsets.
            settings: what lies opposite a point.
        """
        there = surface.nearest(points)
        heights, spacing = surface.heights(points, there), surface.spacing(there)
        opposite = heights.beside <= settings.opposite * spacing
        opposite &= np.abs(heights.above) <= limits.settings.opposite_height * spacing
        return cls(heights.above[:, None] * surface.normals[there], opposite)

    def sure(
        self, error: Float[np.ndarray, " m"], settings: DisplacementSettings = DisplacementSettings()
    ) -> Bool[np.ndarray, " m"]:
        """Which points are surely off the surface opposite them, to either side.

        Args:
            error: standard deviation of the offset of an unchanged surface at each point, in the unit of the clouds.
            settings: by how many errors a point is surely off.
        """
        return np.asarray(self.opposite & (np.linalg.norm(self.vectors, axis=1) > settings.sure * error))
