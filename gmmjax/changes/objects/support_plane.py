"""The support planes of objects: the planes of the unchanged background that they stand on."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.geometry import (
    Contact,
    LocalSurface,
    UpwardSettings,
    upward_direction,
    within_box,
    workers_for,
)


@dataclasses.dataclass(frozen=True)
class SupportPlaneSettings:
    """Settings of the plane that an object stands on.

    All values are empirical: they come from development on the scenes of docs/results.md.

    Attributes:
        contact: the background touches an object within this distance of it, in the object's spacings. 0: no object has
            a support plane.
        fewest: number of background points, at least, that a support plane is found from.
        level: cosine of the angle between two normals from which on they are of one direction. Above 1: no object has a
            support plane.
        above: an object has more than this fraction of its points above its support plane. 0: it may be sunk into it.
        tolerance: points up to this far below the plane count as above it, in standard deviations of the offset between
            local means. 0: the noise of the lowest points counts against the plane.
        upward: when objects have a common upward direction.
    """

    contact: float = 4.0
    fewest: int = 12
    level: float = 0.9
    above: float = 0.96
    tolerance: float = 5.0
    upward: UpwardSettings = UpwardSettings()


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
    settings: SupportPlaneSettings = SupportPlaneSettings(),
) -> list[SupportPlane | None]:
    """The support plane of each object; None where it was not observed.

    Upwards is the normal of most of the background that touches the objects, because gravity is not known. Where most
    objects hang on walls, these are their support planes.

    Args:
        parts: the points of each object.
        background: unchanged points of both clouds: each shows what the other one's objects hide.
        noise: standard deviation of the offset between local means of one surface.
        settings: what an object stands on.
    """
    patches = [_contact_patches(part, background, settings) for part in parts]
    contacts = [_contact(part, own) for part, own in zip(parts, patches, strict=True)]
    up = upward_direction(contacts, settings.upward)
    if up is None:
        return [None] * len(parts)
    return [_support_plane(part, own, up, noise, settings) for part, own in zip(parts, patches, strict=True)]


def _contact_patches(
    part: LocalSurface, background: Float64[np.ndarray, "n 3"], settings: SupportPlaneSettings
) -> _ContactPatches:
    reach = settings.contact * part.nearest_distance
    # Twice as far, so that the local planes within reach have their neighbours.
    background = background[within_box(background, part.tree.mins - 2 * reach, part.tree.maxes + 2 * reach)]
    distances = part.tree.query(background, distance_upper_bound=2 * reach, workers=workers_for(len(background)))[0]
    near = np.isfinite(distances)
    if near.sum() < settings.fewest:
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
    settings: SupportPlaneSettings,
) -> SupportPlane | None:
    """The plane of an object's contact patches that face upwards; None where it is not below the object."""
    level = np.abs(patches.normals @ up) > settings.level
    if level.sum() < settings.fewest:
        return None
    plane = SupportPlane(up, float(np.median(patches.centres[level] @ up)))
    above = np.mean(plane.above(part.points) > -settings.tolerance * noise)
    return plane if above > settings.above else None
