"""The upward direction of a place: whether it is that of z, and that of the surface on which most things stand."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from gmmjax.geometry.local_surface import evenly_chosen


@dataclasses.dataclass(frozen=True)
class UpwardSettings:
    """When things have a common upward direction. All values are empirical.

    Attributes:
        fewest: number of background points that touch a thing, at least, for it to stand on them.
        level: cosine of the angle between two normals from which on they are of one direction. Above 1: there is no
            upward direction.
        agreement: fraction of the things that touch a background, at least, that touch one across the upward
            direction. Below, as where things float or hang on several walls, there is none. 0: there always is one.
        largest_sample: number of normals, at most, that the direction is found from.
    """

    fewest: int = 12
    level: float = 0.9
    agreement: float = 0.6
    largest_sample: int = 2000


class Contact(NamedTuple):
    """Contact of an object with the background.

    Attributes:
        normals: of the background there, of unit length and either sense.
        rise: from the middle of those points to that of the thing.
    """

    normals: Float64[np.ndarray, "k 3"]
    rise: Float64[np.ndarray, " 3"]


def z_is_height(points: Float64[np.ndarray, "n 3"]) -> bool:
    """True if z can only be a height: a scan is widest along x and y, and is not in view of a camera at the origin.

    In the frame of a camera z points away from it: what lies across z is seen from below. Nor is z a height where the
    origin is the centre of the Earth.

    Args:
        points: of a scan, in the frame that they were given in.
    """
    lower, upper = np.quantile(points, [0.01, 0.99], axis=0)
    x, y, z = points.T
    # No camera sees farther than 60 degrees to the side of its axis; one point in a hundred may be an outlier.
    within = np.hypot(x, y) <= np.tan(np.radians(60)) * np.abs(z)
    in_view = max(np.mean(within & (z > 0)), np.mean(within & (z < 0)))
    return bool(np.argmin(upper - lower) == 2 and in_view < 0.99) and not is_geocentric(points)


def is_geocentric(points: Float64[np.ndarray, "n 3"]) -> bool:
    """True if coordinates are geocentric, in metres: as far from the centre as the ground, z far from 0.

    Args:
        points: of a scan, in the frame that they were given in.
    """
    centre = np.median(points, axis=0)
    # The ground is 6,353 to 6,384 km from the centre. A northing may be as large, but no height is above 10 km.
    return bool(abs(np.linalg.norm(centre) - 6.37e6) < 0.03e6 and abs(centre[2]) > 1e4)


def upward_direction(
    contacts: Sequence[Contact], settings: UpwardSettings = UpwardSettings()
) -> Float64[np.ndarray, " 3"] | None:
    """The normal of most of the background that touches things, towards the things; None where they do not agree.

    Args:
        contacts: of each thing.
        settings: when they agree.
    """
    touching = [contact for contact in contacts if len(contact.normals) >= settings.fewest]
    if not touching:
        return None
    normals = np.concatenate([contact.normals for contact in contacts])
    normals = normals[evenly_chosen(len(normals), settings.largest_sample)]
    parallel = np.abs(normals @ normals.T) > settings.level
    leader = int(np.argmax(parallel.sum(axis=1)))
    across = [(np.abs(contact.normals @ normals[leader]) > settings.level).sum() for contact in touching]
    if sum(count >= settings.fewest for count in across) < settings.agreement * len(touching):
        return None
    own = normals[parallel[leader]]
    up = (own * np.sign(own @ normals[leader])[:, None]).sum(axis=0)
    up /= np.linalg.norm(up)
    rise = np.sum([contact.rise @ up for contact in contacts if len(contact.normals)])
    return np.asarray(up if rise > 0 else -up)
