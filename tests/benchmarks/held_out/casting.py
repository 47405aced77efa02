"""Rays from one place against triangle meshes: with one origin the signs of three products tell which are met."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CHUNK = 3_000_000


@dataclasses.dataclass(frozen=True, eq=False)
class Thing:
    """A mesh with what became of it.

    Attributes:
        triangles: [t, 3, 3], metres.
        change: the id of its change; -1: it is there at both times, in one place.
    """

    triangles: np.ndarray
    change: int = -1

    @functools.cached_property
    def sphere(self) -> tuple[np.ndarray, float]:
        """Centre and radius of a sphere about it."""
        corners = self.triangles.reshape(-1, 3)
        centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return centre, float(np.linalg.norm(corners - centre, axis=1).max())


class Hits(NamedTuple):
    """What each ray meets first.

    Attributes:
        ranges: inf where it meets nothing.
        thing: its index; -1 where there is none.
        facing: cosine between the ray and the surface's normal.
    """

    ranges: np.ndarray
    thing: np.ndarray
    facing: np.ndarray


def first_hits(things: Sequence[Thing], origin: np.ndarray, directions: np.ndarray) -> Hits:
    """Casts rays of unit direction [n, 3] from one place."""
    hits = Hits(np.full(len(directions), np.inf), np.full(len(directions), -1), np.ones(len(directions)))
    for number, thing in enumerate(things):
        rays = _near_rays(thing, origin, directions)
        step = max(1, CHUNK // len(thing.triangles))
        for start in range(0, len(rays), step):
            part = rays[start : start + step]
            ranges, facing = _meet(thing.triangles - origin, directions[part])
            nearer = ranges < hits.ranges[part]
            hits.ranges[part[nearer]] = ranges[nearer]
            hits.thing[part[nearer]] = number
            hits.facing[part[nearer]] = facing[nearer]
    return hits


def _near_rays(thing: Thing, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The rays that meet the sphere about the thing."""
    centre, radius = thing.sphere
    centre = centre - origin
    square = float(centre @ centre)
    if square <= radius**2:
        return np.arange(len(directions))
    return np.flatnonzero(directions @ centre >= np.sqrt(square - radius**2) - 1e-9)


def _meet(triangles: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest range of each ray, and how it faces the surface there; the origin is at zero."""
    a, b, c = triangles.transpose(1, 0, 2)
    sides = [directions @ np.cross(*pair).T for pair in ((a, b), (b, c), (c, a))]
    inside = (np.minimum(np.minimum(*sides[:2]), sides[2]) >= -1e-12) | (
        np.maximum(np.maximum(*sides[:2]), sides[2]) <= 1e-12
    )
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ray, which = np.nonzero(inside)
    along = (directions[ray] * normal[which]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (a[which] * normal[which]).sum(axis=1) / along
    ahead = distance > 1e-6
    ray, distance, along = ray[ahead], distance[ahead], along[ahead]
    order = np.argsort(distance, kind="stable")[::-1]
    ranges, facing = np.full(len(directions), np.inf), np.ones(len(directions))
    # Of a ray's several hits the last one written is the nearest.
    ranges[ray[order]], facing[ray[order]] = distance[order], np.abs(along[order])
    return ranges, facing
