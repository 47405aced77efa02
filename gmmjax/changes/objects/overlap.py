"""Overlap and contradiction of two scanned objects, one laid onto the other.

Two surveys seldom see the same sides of an object, so much of it may have no counterpart in the other survey. A missing
counterpart contradicts the match only where the other survey must have observed it. The numbers come from development
on the scenes of docs/results.md.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from gmmjax.geometry import LocalSurface, evenly_chosen, transformed

# A point lies on a surface at most so far off its plane, in standard deviations of the noise, and at most so far from
# its nearest point, in spacings.
OFFSET, DISTANCE = 5.0, 2.5


class Overlap(NamedTuple):
    """The fit of an object to another one.

    Attributes:
        covered: fraction of its points that lie on the other object.
        contradicted: fraction that does not, although the survey of the other object must have observed it.
    """

    covered: float
    contradicted: float


def overlap(
    own: LocalSurface,
    transform: Float[np.ndarray, "4 4"],
    other: LocalSurface,
    scene: LocalSurface,
    noise: float,
    sample: int,
) -> Overlap:
    """Compare an object that is laid onto another one with it.

    A point that does not lie on the other object, nor on anything else in its cloud, contradicts when it is on or in
    front of the plane that the other object has nearest to it, and outside of that object's convex hull: where an
    observed surface ends, the object ends. A point behind the plane may be of a side that faced away from the sensor, a
    point inside the hull of a hole in the scan.

    Args:
        own: the one object.
        transform: rigid transform [4, 4] that lays it onto the other.
        other: the other object.
        scene: the whole cloud that the other object is in.
        noise: standard deviation of the offset between local means of one surface.
        sample: number of points, at most, that are compared, evenly chosen.
    """
    chosen = evenly_chosen(len(own), sample)
    points, means = transformed(own.points[chosen], transform), transformed(own.means(chosen), transform)
    spacing = max(own.nearest_distance, other.nearest_distance)
    covered = on_surface(points, means, other, noise, spacing)
    elsewhere = on_surface(points, means, scene, noise, spacing)
    both = np.concatenate([points, other.points])
    heights = _heights(means, other, (both.min(axis=0) + both.max(axis=0)) / 2)
    observed = (heights > -OFFSET * noise) & (other.beyond_hull(means) > OFFSET * noise)
    return Overlap(float(covered.mean()), float((observed & ~covered & ~elsewhere).mean()))


def on_surface(
    points: Float[np.ndarray, "n 3"],
    means: Float[np.ndarray, "n 3"],
    surface: LocalSurface,
    noise: float,
    spacing: float,
) -> Bool[np.ndarray, " n"]:
    """Select the points that are near a surface, and its local mean near the plane there.

    Args:
        points: of another cloud.
        means: the local mean of each.
        surface: on which they may lie.
        noise: standard deviation of the offset between local means of one surface.
        spacing: the coarser of both clouds' spacings.
    """
    lies = np.isfinite(surface.tree.query(points, distance_upper_bound=DISTANCE * spacing)[0])
    # Planes are only looked up for what is near: the way to the nearest point of a far surface is long.
    near = means[lies]
    lies[lies] = np.abs(surface.heights(near, surface.nearest(near)).above) < OFFSET * noise
    return np.asarray(lies)


def _heights(
    means: Float[np.ndarray, "n 3"], surface: LocalSurface, middle: Float64[np.ndarray, " 3"]
) -> Float[np.ndarray, " n"]:
    """Signed distance of each local mean from the surface's plane there; positive away from the middle."""
    there = surface.nearest(means)
    outwards = np.sign(((surface.centres[there] - middle) * surface.normals[there]).sum(axis=1))
    return np.asarray(surface.heights(means, there).above * outwards)
