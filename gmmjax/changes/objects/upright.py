"""Transforms between two objects that keep them upright: support plane onto support plane."""

import dataclasses

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

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
        levels: the horizontal points higher than each of these fractions of an object's height are one of its tops,
            such as the seat and the back of a chair. Empirical. Empty: only the whole objects are brought together.
        quantile: of the heights of an object's points: its height for these fractions. 1: a stray point has it.
    """

    support: SupportPlaneSettings = SupportPlaneSettings()
    top: TopSettings = TopSettings()
    rotations: int = 24
    levels: tuple[float, ...] = (0.6, 0.85)
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


def upright_transforms(
    parts: Pair[LocalSurface],
    planes: Pair[SupportPlane],
    settings: UprightSettings = UprightSettings(),
) -> list[Float64[np.ndarray, "4 4"]]:
    """Transforms from one object to another that keep it upright, with all headings.

    They bring the centroid of the whole object, or that of a top, over that of the other object.

    Args:
        parts: both objects.
        planes: the support planes of both.
        settings: which headings, and what the tops are.
    """
    first, second = planes
    level, _ = Rotation.align_vectors(second.up[None], first.up[None])
    angles = [2 * np.pi * step / settings.rotations for step in range(settings.rotations)]
    rotations = [(Rotation.from_rotvec(angle * second.up) * level).as_matrix() for angle in angles]
    centres = zip(*each(lambda part, plane: _projections(part, plane, settings), parts, planes), strict=True)
    return [rotation_about(rotation, start, goal) for start, goal in centres for rotation in rotations]


def _projections(part: LocalSurface, plane: SupportPlane, settings: UprightSettings) -> list[Float64[np.ndarray, " 3"]]:
    """The centroids of an object and of its tops, projected onto the support plane."""
    heights = plane.above(part.points)
    level, height = level_points(part, plane, settings.top), np.quantile(heights, settings.quantile)
    whole = np.ones(len(part), bool)
    chosen = [whole, *(level & (heights > fraction * height) for fraction in settings.levels)]
    centroids = [part.points[own if own.sum() > settings.top.fewest else whole].mean(axis=0) for own in chosen]
    return [centroid - plane.above(centroid[None])[0] * plane.up for centroid in centroids]
