"""Where the planes of a matched object leave it free to slide, its outline says where it lies: panels, doors, drums."""

import dataclasses

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from gmmjax.geometry import LocalSurface, evenly_chosen, offset_derivatives, rotation_about, transformed
from gmmjax.pair import Pair


@dataclasses.dataclass(frozen=True)
class OutlineSettings:
    """How an object is slid until the outlines agree.

    Attributes:
        determined: mean squared offset from the planes, at least, by a unit of a motion that the planes determine. 0:
            no object is slid.
        inside: distance to the other object's nearest point, in spacings, up to which a point lies within its outline.
            0: the pattern in which the points lie on the surface counts.
        most: largest distance that counts, in spacings: what only one survey observed lies further away. Infinite: it
            pulls.
        least_gain: by which a step lowers the mean of these distances, in spacings, at least. 0: noise rotates a round
            object.
        steps: lengths of the steps that are tried, in spacings, in their order.
        sample: number of points of either object, at most.
    """

    determined: float = 0.02
    inside: float = 1.2
    most: float = 6.0
    least_gain: float = 0.02
    steps: tuple[float, ...] = (3.0, 1.5, 0.75)
    sample: int = 1200


def aligned_outlines(
    parts: Pair[LocalSurface], transform: Float64[np.ndarray, "4 4"], settings: OutlineSettings = OutlineSettings()
) -> Float64[np.ndarray, "4 4"]:
    """The transform after the object was slid, along itself, to where the outlines agree best.

    Args:
        parts: what disappeared from the before cloud, and what appeared in the after cloud.
        transform: rigid transform [4, 4] from the first to the second, by their planes.
        settings: how far the object is slid.
    """
    spacing = max(part.nearest_distance for part in parts)
    few = parts.map(lambda part: part.points[evenly_chosen(len(part), settings.sample)])

    def misfit(candidate: np.ndarray) -> float:
        there = parts.after.tree.query(transformed(few.before, candidate))[0]
        back = parts.before.tree.query(transformed(few.after, np.linalg.inv(candidate)))[0]
        return float(sum(np.clip(own / spacing - settings.inside, 0, settings.most).mean() for own in (there, back)))

    best, least, gain = transform, misfit(transform), settings.least_gain
    for step in settings.steps:
        for motion in _free_motions(parts.before, settings):
            for sense in (-1, 1):
                while (
                    now := misfit(slid := best @ _moved(parts.before, sense * step * spacing * motion))
                ) < least - gain:
                    best, least = slid, now
    return best


def _free_motions(part: LocalSurface, settings: OutlineSettings) -> Float64[np.ndarray, "f 6"]:
    """The motions along and about the principal axes that leave the object in its planes.

    A motion of unit length moves its points by about one.
    """
    chosen = evenly_chosen(len(part), settings.sample)
    middle = part.points.mean(axis=0)
    axes = np.linalg.eigh(np.cov(part.points.T, bias=True))[1].T
    none = np.zeros_like(axes)
    motions = np.concatenate([np.hstack([none, axes]), np.hstack([axes, none])])
    rows = offset_derivatives(part.points[chosen], part.normals[chosen], middle, _radius(part))
    information = ((rows @ motions.T) ** 2).mean(axis=0)
    return np.asarray(motions[information < settings.determined])


def _moved(part: LocalSurface, motion: Float[np.ndarray, " 6"]) -> Float64[np.ndarray, "4 4"]:
    """The transform of a rotation vector about the middle of the object, in radii, and a translation."""
    centre = part.points.mean(axis=0)
    return rotation_about(Rotation.from_rotvec(motion[:3] / _radius(part)).as_matrix(), centre, centre + motion[3:])


def _radius(part: LocalSurface) -> float:
    return max(float(np.sqrt(part.points.var(axis=0).sum())), np.finfo(np.float64).tiny)
