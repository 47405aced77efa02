"""Whether two scanned objects can be one: what of the one lies on the other, and what contradicts it.

Two surveys seldom see the same sides of an object, so much of it may have no counterpart. It speaks against one object
only where the other survey must have seen it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from gmmjax.geometry.local_surface import LocalSurface, evenly_chosen

# A point lies on a surface when it is off it by no more than so many standard deviations of local means.
ON_IT = 5.0
# And when it has a point of the surface within so many spacings.
BESIDE = 2.5


class Agreement(NamedTuple):
    """How an object fits another one.

    Attributes:
        covered: share of its points that lie on the other.
        contradicted: share that does not, although the survey of the other must have seen it.
    """

    covered: float
    contradicted: float


def agreement(placed: LocalSurface, other: LocalSurface, scene: LocalSurface, noise: float, tested: int) -> Agreement:
    """How an object that was laid onto another one fits it.

    A point that does not lie on the other object, nor on anything else in its cloud, contradicts when it is on or in
    front of the plane that the other object has nearest to it, and outside of that object's convex hull: where a
    surface was seen to end, it ends. What lies behind may be a side that was turned away, what lies within a hole.

    Args:
        placed: the one object, laid onto the other.
        other: the other object.
        scene: the whole cloud that the other object is in.
        noise: standard deviation of the offset between local means of one surface.
        tested: at most so many points, evenly chosen.
    """
    chosen = evenly_chosen(len(placed), tested)
    points, means = placed.points[chosen], placed.means(chosen)
    spacing = max(placed.nearest_distance, other.nearest_distance)
    both = np.concatenate([placed.points, other.points])
    heights = _heights(means, other, (both.min(axis=0) + both.max(axis=0)) / 2)
    covered = _lies_on(points, heights, other, noise, spacing)
    elsewhere = _lies_on(points, _heights(means, scene, means.mean(axis=0)), scene, noise, spacing)
    seen = (heights > -ON_IT * noise) & (other.beyond_hull(means) > ON_IT * noise)
    return Agreement(float(covered.mean()), float((seen & ~covered & ~elsewhere).mean()))


def _heights(
    means: Float[np.ndarray, "n 3"], surface: LocalSurface, middle: Float64[np.ndarray, " 3"]
) -> Float[np.ndarray, " n"]:
    """How far each local mean is off the surface's plane there; positive away from the middle."""
    there = surface.nearest(means)
    centres, normals = surface.centres[there], surface.normals[there]
    outwards = np.sign(((centres - middle) * normals).sum(axis=1))
    return np.asarray(((means - centres) * normals).sum(axis=1) * outwards)


def _lies_on(
    points: np.ndarray, heights: np.ndarray, surface: LocalSurface, noise: float, spacing: float
) -> Bool[np.ndarray, " n"]:
    beside = np.isfinite(surface.tree.query(points, distance_upper_bound=BESIDE * spacing)[0])
    return np.asarray(beside & (np.abs(heights) < ON_IT * noise))
