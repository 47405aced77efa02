"""How far two scanned objects, one laid onto the other, overlap and contradict each other.

Two surveys seldom see the same sides of an object, so much of it may have no counterpart in the other survey. A missing
counterpart contradicts the match only where the other survey must have observed it.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from gmmjax.geometry import LocalSurface, evenly_chosen, transformed


@dataclasses.dataclass(frozen=True)
class OverlapSettings:
    """When a point lies on a surface.

    All values are empirical: they come from development on the scenes of docs/results.md.

    Attributes:
        offset: at most this far off the surface's plane, in standard deviations of the offset between local means.
            Infinite: every point near the surface lies on it.
        distance: at most this far from the nearest point of the surface, in the coarser of both objects' spacings.
            Infinite: a surface has no edges.
        overhang: quantile of the distances beyond the convex hull that is reported. 1: a stray point decides.
    """

    offset: float = 5.0
    distance: float = 2.5
    overhang: float = 0.95


class Overlap(NamedTuple):
    """How an object fits another one.

    Attributes:
        covered: fraction of its points that lie on the other object.
        contradicted: fraction that does not, although the survey of the other object must have observed it.
        residual: root mean square offset of the covered points from the other object's planes, in standard deviations
            of the offset between local means; 0 where none is covered.
        overhang: how far its points reach beyond the convex hull of the other object, in standard deviations of the
            offset between local means.
    """

    covered: float
    contradicted: float
    residual: float = 0.0
    overhang: float = 0.0


def overlap(
    own: LocalSurface,
    transform: Float[np.ndarray, "4 4"],
    other: LocalSurface,
    scene: LocalSurface,
    noise: float,
    sample: int,
    settings: OverlapSettings = OverlapSettings(),
) -> Overlap:
    """How an object that is laid onto another one fits it.

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
        settings: when a point lies on a surface.
    """
    chosen = evenly_chosen(len(own), sample)
    points, means = transformed(own.points[chosen], transform), transformed(own.means(chosen), transform)
    offset = settings.offset * noise
    distance = settings.distance * max(own.nearest_distance, other.nearest_distance)
    both = np.concatenate([points, other.points])
    heights = _heights(means, other, (both.min(axis=0) + both.max(axis=0)) / 2)
    covered = _near(points, other, distance) & (np.abs(heights) < offset)
    elsewhere = _lies_on(points, means, scene, offset, distance)
    beyond = other.beyond_hull(means)
    observed = (heights > -offset) & (beyond > offset)
    residual = float(np.sqrt((heights[covered] ** 2).mean())) / noise if covered.any() else 0.0
    overhang = max(float(np.quantile(beyond, settings.overhang)), 0.0) / noise
    return Overlap(float(covered.mean()), float((observed & ~covered & ~elsewhere).mean()), residual, overhang)


def on_surface(
    points: Float[np.ndarray, "n 3"],
    means: Float[np.ndarray, "n 3"],
    surface: LocalSurface,
    noise: float,
    spacing: float,
    settings: OverlapSettings = OverlapSettings(),
) -> Bool[np.ndarray, " n"]:
    """Which points lie on a surface.

    Args:
        points: of another cloud.
        means: the local mean of each.
        surface: on which they may lie.
        noise: standard deviation of the offset between local means of one surface.
        spacing: the coarser of both clouds' spacings.
        settings: when a point lies on a surface.
    """
    return _lies_on(points, means, surface, settings.offset * noise, settings.distance * spacing)


def _heights(
    means: Float[np.ndarray, "n 3"], surface: LocalSurface, middle: Float64[np.ndarray, " 3"]
) -> Float[np.ndarray, " n"]:
    """Signed distance of each local mean from the surface's plane there; positive away from the middle."""
    there = surface.nearest(means)
    centres, normals = surface.centres[there], surface.normals[there]
    outwards = np.sign(((centres - middle) * normals).sum(axis=1))
    return np.asarray(((means - centres) * normals).sum(axis=1) * outwards)


def _lies_on(
    points: Float[np.ndarray, "n 3"],
    means: Float[np.ndarray, "n 3"],
    surface: LocalSurface,
    offset: float,
    distance: float,
) -> Bool[np.ndarray, " n"]:
    """Which points are near a surface, and their local means near its planes."""
    lies = _near(points, surface, distance)
    # Planes are only looked up for what is near: the way to the nearest point of a far surface is long.
    there = surface.nearest(means[lies])
    offsets = ((means[lies] - surface.centres[there]) * surface.normals[there]).sum(axis=1)
    lies[lies] = np.abs(offsets) < offset
    return lies


def _near(points: Float[np.ndarray, "n 3"], surface: LocalSurface, distance: float) -> Bool[np.ndarray, " n"]:
    return np.isfinite(surface.tree.query(points, distance_upper_bound=distance)[0])
