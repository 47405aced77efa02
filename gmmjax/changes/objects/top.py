"""The top of an object: its outline along the support plane and its height above it.

Which sides of an object a survey observes depends on the sensor's position; the top is mostly complete.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.geometry import LocalSurface


@dataclasses.dataclass(frozen=True)
class TopSettings:
    """What the top of an object is.

    All values are empirical: they come from development on the scenes of docs/results.md.

    Attributes:
        level: cosine, at least, between the normal of a point of the top and the upward direction. 0: rims of the
            vertical sides are of the top.
        fewest: number of points, at least, of a top that was observed.
        quantile: of the heights of an object's points: the height of its top. 1: the highest stray point has it.
        thickness: of the top below its height, in standard deviations of the offset between local means. Infinite: all
            level surfaces are of the top.
        directions: in which an outline is measured, within a quarter turn. 1: along arbitrary axes only.
        beyond: fraction of the points that is left out at either end of a side. 0: stray points lengthen a side.
        same: difference, at most, of the sides and heights of equal tops, in the unit of `thickness`. 0: no two tops
            are equal.
    """

    level: float = 0.8
    fewest: int = 20
    quantile: float = 0.97
    thickness: float = 10.0
    directions: int = 45
    beyond: float = 0.015
    same: float = 4.0


class Top(NamedTuple):
    """The upper side of an object.

    Attributes:
        sides: of the rectangle of least area around it, the shorter first.
        height: above the support plane.
    """

    sides: Float64[np.ndarray, " 2"]
    height: float

    def equals(self, other: "Top", noise: float, settings: TopSettings = TopSettings()) -> bool:
        """Whether the other one has the same outline and height, up to a few standard deviations of the noise."""
        reach = settings.same * noise
        return bool(np.abs(self.sides - other.sides).max() < reach and abs(self.height - other.height) < reach)


def top_of(part: LocalSurface, plane: SupportPlane, noise: float, settings: TopSettings = TopSettings()) -> Top | None:
    """The top of an object; None where too little of it was observed.

    Args:
        part: the object.
        plane: its support plane.
        noise: standard deviation of the offset between local means of one surface.
        settings: what a top is.
    """
    heights = plane.above(part.points)
    height = float(np.quantile(heights, settings.quantile))
    own = (heights > height - settings.thickness * noise) & level_points(part, plane, settings)
    if own.sum() < settings.fewest:
        return None
    # Two axes along the support plane.
    across = np.linalg.svd(plane.up[None])[2][1:]
    return Top(_outline(part.points[own] @ across.T, settings), height)


def level_points(
    part: LocalSurface, plane: SupportPlane, settings: TopSettings = TopSettings()
) -> Bool[np.ndarray, " n"]:
    """Which points of an object have a normal along that of its support plane."""
    return np.asarray(np.abs(part.normals @ plane.up) > settings.level)


def _outline(places: Float[np.ndarray, "n 2"], settings: TopSettings) -> Float64[np.ndarray, " 2"]:
    """The sides, the shorter first, of the rectangle of least area around most of the points."""
    angles = np.pi / 2 * np.arange(settings.directions) / settings.directions
    axes = np.stack([np.cos(angles), np.sin(angles)]), np.stack([-np.sin(angles), np.cos(angles)])
    ends = [settings.beyond, 1 - settings.beyond]
    sides = np.stack([np.ptp(np.quantile(places @ axis, ends, axis=0), axis=0) for axis in axes])
    return np.sort(sides[:, np.argmin(sides.prod(axis=0))])
