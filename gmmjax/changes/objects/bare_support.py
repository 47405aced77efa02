"""Whether a survey shows the bare support where an object would stand: then the object is not there."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.geometry import LocalSurface, evenly_chosen, transformed


@dataclasses.dataclass(frozen=True)
class BareSupportSettings:
    """Where a support is bare. All values are empirical.

    Attributes:
        sample: number of points of an object, at most, below which the support is looked for.
        height: largest distance of the support's points from its plane, in standard deviations of the noise. 0: no
            support is bare.
        beside: distance along the plane, in spacings, up to which a point is beside the support's points. 0: no support
            is bare.
        clear: distance along the plane, in spacings, from the object that was observed there, from which on a support
            can be bare. 0: the support at the foot of an object counts against itself.
    """

    sample: int = 300
    height: float = 4.0
    beside: float = 1.5
    clear: float = 3.0


class Footing(NamedTuple):
    """Where an object stands, along its support plane.

    Attributes:
        plane: its support plane.
        across: two unit vectors along the plane.
        object: places of the object's points.
        support: places of the points of the support; None: none were seen.
        spacing: of neighbouring points.
        settings: where a support is bare.
    """

    plane: SupportPlane
    across: Float64[np.ndarray, "2 3"]
    object: cKDTree
    support: cKDTree | None
    spacing: float
    settings: BareSupportSettings

    @classmethod
    def of(
        cls,
        part: LocalSurface,
        scene: LocalSurface,
        plane: SupportPlane,
        noise: float,
        settings: BareSupportSettings = BareSupportSettings(),
    ) -> "Footing":
        """Where an object stands.

        Args:
            part: the object.
            scene: the whole cloud that it is in.
            plane: its support plane.
            noise: standard deviation of the offset between local means of one surface.
            settings: where a support is bare.
        """
        across = np.linalg.svd(plane.up[None])[2][1:]
        level = scene.points[np.abs(plane.above(scene.points)) < settings.height * noise] @ across.T
        spacing = max(part.nearest_distance, scene.nearest_distance)
        support = cKDTree(level) if len(level) else None
        return cls(plane, across, cKDTree(part.points @ across.T), support, spacing, settings)

    def bare_share(self, other: LocalSurface, transform: Float64[np.ndarray, "4 4"]) -> float:
        """The fraction of another object's points below which the bare support was seen.

        An object hides what it stands on. Where the surface of the object here ends, it may be that the survey saw no
        more of it; the bare support shows that there is nothing above it.

        Args:
            other: the other object.
            transform: rigid transform [4, 4] that lays it onto the one here.
        """
        if self.support is None:
            return 0.0
        points = transformed(other.points[evenly_chosen(len(other), self.settings.sample)], transform) @ self.across.T
        clear, beside = self.settings.clear * self.spacing, self.settings.beside * self.spacing
        apart = np.isinf(self.object.query(points, distance_upper_bound=clear)[0])
        bare = np.isfinite(self.support.query(points[apart], distance_upper_bound=beside)[0])
        return float(bare.sum()) / len(points)
