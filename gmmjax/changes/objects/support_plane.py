"""The support planes of objects: the planes of the unchanged background that they stand on."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.geometry import (
    Contact,
    LocalSurface,
    upward_direction,
    within_box,
    workers_for,
)

# Empirical, by the scenes of docs/results.md. The background touches an object within so many of the object's spacings;
# a support plane is found from so many background points, at least, whose normals are within this cosine of upwards.
CONTACT, FEWEST, LEVEL = 4.0, 12, 0.9
# More than this fraction of an object is above its support plane, or below it by no more than so many standard
# deviations of the offset between local means.
ABOVE, TOLERANCE = 0.96, 5.0


class SupportPlane(NamedTuple):
    """The plane that an object stands on.

    Attributes:
        up: unit normal, towards the object.
        height: of the plane along the normal.
    """

    up: Float64[np.ndarray, " 3"]
    height: float

    def above(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Signed distance of points from the plane, positive above it."""
        return np.asarray(points @ self.up - self.height)


class _ContactPatches(NamedTuple):
    """Local planes of the background where it touches an object."""

    centres: Float64[np.ndarray, "k 3"]
    normals: Float64[np.ndarray, "k 3"]


def support_planes(
    parts: Sequence[LocalSurface],
    background: Float64[np.ndarray, "n 3"],
    noise: float,
) -> list[SupportPlane | None]:
    """The support plane of each object; None where it was not observed.

    Upwards is the normal of most of the background that touches the objects, because gravity is not known. Where most
    objects hang on walls, these are their support planes.

    Args:
        parts: the points of each object.
        background: unchanged points of both clouds: each shows what the other one's objects hide.
        noise: standard deviation of the offset between local means of one surface.
    """
    patches = [_contact_patches(part, background) for part in parts]
    contacts = [_contact(part, own) for part, own in zip(parts, patches, strict=True)]
    up = upward_direction(contacts)
    if up is None:
        return [None] * len(parts)
    return [_support_plane(part, own, up, noise) for part, own in zip(parts, patches, strict=True)]


def _contact_patches(part: LocalSurface, background: Float64[np.ndarray, "n 3"]) -> _ContactPatches:
    reach = CONTACT * part.nearest_distance
    # Twice as far, so that the local planes within reach have their neighbours.
    background = background[within_box(background, part.tree.mins - 2 * reach, part.tree.maxes + 2 * reach)]
    distances = part.tree.query(background, distance_upper_bound=2 * reach, workers=workers_for(len(background)))[0]
    near = np.isfinite(distances)
    if near.sum() < FEWEST:
        return _ContactPatches(np.zeros((0, 3)), np.zeros((0, 3)))
    surface, touches = LocalSurface.of(background[near]), distances[near] < reach
    return _ContactPatches(surface.centres[touches], surface.normals[touches])


def _contact(part: LocalSurface, patches: _ContactPatches) -> Contact:
    rise = part.points.mean(axis=0) - patches.centres.mean(axis=0) if len(patches.centres) else np.zeros(3)
    return Contact(patches.normals, rise)


def _support_plane(
    part: LocalSurface,
    patches: _ContactPatches,
    up: Float64[np.ndarray, " 3"],
    noise: float,
) -> SupportPlane | None:
    """The plane of an object's contact patches that face upwards; None where it is not below the object."""
    level = np.abs(patches.normals @ up) > LEVEL
    if level.sum() < FEWEST:
        return None
    plane = SupportPlane(up, float(np.median(patches.centres[level] @ up)))
    above = np.mean(plane.above(part.points) > -TOLERANCE * noise)
    return plane if above > ABOVE else None
