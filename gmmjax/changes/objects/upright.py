"""What objects stand on, and the motions that keep them standing."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from gmmjax.geometry.local_surface import LocalSurface, evenly_chosen
from gmmjax.geometry.rigid import rotation_about

# The background touches an object that comes within so many of the object's spacings.
TOUCHING = 4.0
# What objects stand on: at least so many points, whose normals agree with the upward direction by this cosine.
FEWEST = 12
LEVEL = 0.9
# So much of an object is above what it stands on, but for so many of the noises.
ABOVE, NOISES = 0.96, 5.0
# Tops face upwards by this cosine, and are higher than one of these shares of the object; at least so many points are
# one.
FACING, HIGH, FEWEST_OF_TOP = 0.8, (0.6, 0.85), 20
# Normals that the upward direction is taken from.
MOST_NORMALS = 2000
# Turns about the upward direction that are tried.
TURNS = 24
# A top is as high as this share of the object's points, and so thick; outlines and heights of one object differ by no
# more than this. Both in noises.
TOP, LEVEL_OF_TOP, SAME_OUTLINE = 0.97, 10.0, 4.0
# Directions in which an outline is measured, within a quarter turn, and the share of the points beyond either side.
DIRECTIONS, BEYOND = 45, 0.015


class Ground(NamedTuple):
    """What an object stands on.

    Attributes:
        up: unit normal, towards the object.
        height: of the ground along it.
    """

    up: Float64[np.ndarray, " 3"]
    height: float

    def above(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """How far points are above the ground."""
        return np.asarray(points @ self.up - self.height)


class _Surroundings(NamedTuple):
    """Planes of the background where it touches an object."""

    centres: Float64[np.ndarray, "k 3"]
    normals: Float64[np.ndarray, "k 3"]


class Top(NamedTuple):
    """The upper side of an object.

    Attributes:
        sides: of the least rectangle around it, the shorter first.
        height: above the ground.
    """

    sides: Float64[np.ndarray, " 2"]
    height: float

    def like(self, other: "Top", noise: float) -> bool:
        """Whether the other one has the same outline and height."""
        reach = SAME_OUTLINE * noise
        return bool(np.abs(self.sides - other.sides).max() < reach and abs(self.height - other.height) < reach)


def top_of(part: LocalSurface, ground: Ground, noise: float) -> Top | None:
    """The upper side of an object that stands on a ground; None where too little of it was seen."""
    heights = ground.above(part.points)
    height = float(np.quantile(heights, TOP))
    own = (heights > height - LEVEL_OF_TOP * noise) & (np.abs(part.normals @ ground.up) > FACING)
    if own.sum() < FEWEST_OF_TOP:
        return None
    # Two axes along the ground.
    across = np.linalg.svd(ground.up[None])[2][1:]
    places = part.points[own] @ across.T
    angles = np.pi / 2 * np.arange(DIRECTIONS) / DIRECTIONS
    axes = np.stack([np.cos(angles), np.sin(angles)]), np.stack([-np.sin(angles), np.cos(angles)])
    sides = np.stack([np.ptp(np.quantile(places @ axis, [BEYOND, 1 - BEYOND], axis=0), axis=0) for axis in axes])
    return Top(np.sort(sides[:, np.argmin(sides.prod(axis=0))]), height)


def grounds(parts: Sequence[LocalSurface], background: Float64[np.ndarray, "n 3"], noise: float) -> list[Ground | None]:
    """What each object stands on; None where that was not seen.

    Upwards is the direction that most of what touches the objects faces. No gravity is known: where most objects hang
    on walls, they stand on them.

    Args:
        parts: the points of each object.
        background: points that did not change, of both clouds: each shows what the other one's objects cover.
        noise: standard deviation of the offset between local means of one surface.
    """
    touching = [_surroundings(part, background) for part in parts]
    up = _upwards(parts, touching)
    if up is None:
        return [None] * len(parts)
    return [_ground(part, around, up, noise) for part, around in zip(parts, touching, strict=True)]


def stays_standing(
    motion: Float64[np.ndarray, "4 4"], first: Ground, second: Ground, middle: Float64[np.ndarray, " 3"], reach: float
) -> bool:
    """Whether a motion brings what the one object stood on onto what the other one stands on.

    Args:
        motion: from the first object to the second.
        first: what the first one stood on.
        second: what the second one stands on.
        middle: of the second object, where both are compared.
        reach: how far they may be apart there.
    """
    up = motion[:3, :3] @ first.up
    height = first.height + float(up @ motion[:3, 3])
    return bool(up @ second.up > LEVEL and abs(float(middle @ (up - second.up)) - height + second.height) < reach)


def standing_motions(
    source: LocalSurface, target: LocalSurface, first: Ground, second: Ground
) -> list[Float64[np.ndarray, "4 4"]]:
    """Motions from one object to another that keep it standing: turned in all directions, middle over
    middle and top over top.

    Which sides of an object a survey sees depends on where it looked from; its top is mostly whole.
    """
    level, _ = Rotation.align_vectors(second.up[None], first.up[None])
    turns = [Rotation.from_rotvec(2 * np.pi * turn / TURNS * second.up) * level for turn in range(TURNS)]
    motions = []
    for start, goal in zip(_feet(source, first), _feet(target, second), strict=True):
        for turn in turns:
            motions.append(rotation_about(turn.as_matrix(), start, goal))
    return motions


def _surroundings(part: LocalSurface, background: Float64[np.ndarray, "n 3"]) -> _Surroundings:
    reach = TOUCHING * part.nearest_distance
    # Twice as far, so that the planes of what touches have their neighbours.
    distances = part.tree.query(background, distance_upper_bound=2 * reach, workers=-1)[0]
    near = np.isfinite(distances)
    if near.sum() < FEWEST:
        return _Surroundings(np.zeros((0, 3)), np.zeros((0, 3)))
    surface, touches = LocalSurface.of(background[near]), distances[near] < reach
    return _Surroundings(surface.centres[touches], surface.normals[touches])


def _upwards(parts: Sequence[LocalSurface], touching: Sequence[_Surroundings]) -> Float64[np.ndarray, " 3"] | None:
    """The normal that most of the touching points have, towards the objects."""
    normals = np.concatenate([around.normals for around in touching])
    normals = normals[evenly_chosen(len(normals), MOST_NORMALS)]
    if len(normals) < FEWEST:
        return None
    alike = np.abs(normals @ normals.T) > LEVEL
    leader = int(np.argmax(alike.sum(axis=1)))
    own = normals[alike[leader]]
    up = (own * np.sign(own @ normals[leader])[:, None]).sum(axis=0)
    up /= np.linalg.norm(up)
    above = [
        np.median(part.points @ up) - np.median(around.centres @ up)
        for part, around in zip(parts, touching, strict=True)
        if len(around.centres)
    ]
    return np.asarray(up if np.sum(above) > 0 else -up)


def _ground(part: LocalSurface, around: _Surroundings, up: Float64[np.ndarray, " 3"], noise: float) -> Ground | None:
    level = np.abs(around.normals @ up) > LEVEL
    if level.sum() < FEWEST:
        return None
    ground = Ground(up, float(np.median(around.centres[level] @ up)))
    return ground if np.mean(ground.above(part.points) > -NOISES * noise) > ABOVE else None


def _feet(part: LocalSurface, ground: Ground) -> list[Float64[np.ndarray, " 3"]]:
    """Places on the ground below the middle of all of an object, and of its top, which may have more than one level."""
    heights = ground.above(part.points)
    flat = np.abs(part.normals @ ground.up) > FACING
    chosen = [np.ones(len(part), bool), *(flat & (heights > high * np.quantile(heights, 0.95)) for high in HIGH)]
    middles = [part.points[top if top.sum() > FEWEST_OF_TOP else chosen[0]].mean(axis=0) for top in chosen]
    return [middle - ground.above(middle[None])[0] * ground.up for middle in middles]
