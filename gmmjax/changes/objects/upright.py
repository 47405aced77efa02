"""Transforms between two objects that keep them upright: support plane onto support plane."""

import dataclasses

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.rigid_match import Search
from gmmjax.changes.objects.support_plane import SupportPlane, SupportPlaneSettings
from gmmjax.changes.objects.top import TopSettings, level_points
from gmmjax.geometry import LocalSurface, rotation_about
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class UprightSettings:
    """Which transforms keep an object upright, and from which of them a search starts.

    Attributes:
        support: what an object stands on.
        top: what the top of an object is.
        rotations: about the upward direction, per full turn, that a search starts from. Empirical. 1: an object keeps
            its heading.
        lowest_top: the level points higher than this fraction of an object's height are its tops, such as the seat of a
            chair. Empirical. 1: only the whole objects are brought together.
        quantile: of the heights of an object's points: its height for this fraction. 1: a stray point has it.
    """

    support: SupportPlaneSettings = SupportPlaneSettings()
    top: TopSettings = TopSettings()
    rotations: int = 24
    lowest_top: float = 0.4
    quantile: float = 0.95


def stays_upright(
    transform: Float64[np.ndarray, "4 4"],
    planes: Pair[SupportPlane],
    middle: Float64[np.ndarray, " 3"],
    tolerance: float,
    settings: UprightSettings = UprightSettings(),
) -> bool:
    """Whether a transform brings the support plane of one object onto that of the other.

    Args:
        transform: from the first object to the second.
        planes: the support planes of both.
        middle: of the second object, where the heights of the planes are compared.
        tolerance: largest difference of the heights there.
        settings: largest angle between the planes.
    """
    first, second = planes
    up = transform[:3, :3] @ first.up
    height = first.height + float(up @ transform[:3, 3])
    apart = abs(float(middle @ (up - second.up)) - height + second.height)
    return bool(up @ second.up > settings.support.level and apart < tolerance)


def upright_searches(
    parts: Pair[LocalSurface],
    planes: Pair[SupportPlane],
    settings: UprightSettings = UprightSettings(),
) -> list[Search]:
    """Where transforms that keep an object upright are searched from: all headings.

    One search compares the whole objects and brings their centroids together. The other one compares their tops, of
    which two surveys see the same, and brings those together: from different sides two surveys see different sides of
    an object, whose centroids are apart.

    Args:
        parts: both objects.
        planes: the support planes of both.
        settings: which headings, and what the tops are.
    """
    first, second = planes
    level, _ = Rotation.align_vectors(second.up[None], first.up[None])
    angles = [2 * np.pi * step / settings.rotations for step in range(settings.rotations)]
    rotations = [(Rotation.from_rotvec(angle * second.up) * level).as_matrix() for angle in angles]

    def search(points: Pair[np.ndarray], whole: bool) -> Search:
        start, goal = each(_foot, points, planes)
        return Search(points, np.stack([rotation_about(rotation, start, goal) for rotation in rotations]), whole)

    searches = [search(parts.map(lambda part: part.points), True)]
    tops = each(lambda part, plane: _top_points(part, plane, settings), parts, planes)
    if min(map(len, tops)) > settings.top.fewest:
        searches.append(search(tops, False))
    return searches


def _foot(points: Float64[np.ndarray, "n 3"], plane: SupportPlane) -> Float64[np.ndarray, " 3"]:
    """The centroid of points, projected onto the support plane."""
    centroid = points.mean(axis=0)
    return np.asarray(centroid - plane.above(centroid[None])[0] * plane.up)


def _top_points(part: LocalSurface, plane: SupportPlane, settings: UprightSettings) -> Float64[np.ndarray, "n 3"]:
    """The level points of an object that are not near its foot."""
    heights = plane.above(part.points)
    high = heights > settings.lowest_top * np.quantile(heights, settings.quantile)
    return part.points[level_points(part, plane, settings.top) & high]
