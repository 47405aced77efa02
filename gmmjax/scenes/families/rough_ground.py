"""Rough ground: its relief, the rocks and bushes on it, and scanners on tripods that stand there."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.scenes.families.arrangements import Arrangement, chance
from gmmjax.scenes.families.room_surveys import level_poses
from gmmjax.scenes.families.things import moved
from gmmjax.scenes.objects import StandingObject
from gmmjax.scenes.ray_casting import UNLABELLED, Solid
from gmmjax.scenes.shapes import Ellipsoid, Ground, Vegetation


def rough(random: np.random.Generator, nodes: int, cells: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Smooth random heights: white noise, filtered over so many cells, of these standard deviations."""
    total = np.zeros((nodes, nodes))
    for cell, height in zip(cells, heights, strict=True):
        part = gaussian_filter(random.standard_normal((nodes, nodes)), cell, mode="wrap")
        total += part * (height / part.std())
    return total


def lifted(ground: Ground, place: np.ndarray) -> np.ndarray:
    """The point of the ground above x and y."""
    return np.array([*place, ground.height_at(place[None])[0]])


def rock(random: np.random.Generator, size: float) -> StandingObject:
    """Of one to three ellipsoids or blocks, half in the ground at the origin."""
    parts = []
    for _ in range(int(random.integers(1, 4))):
        kind = Ellipsoid if chance(random, 0.6) else Solid
        extent = size * random.uniform(0.5, 1.2, 3)
        centre = size * random.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.3])
        parts.append(kind(centre, extent, axes=_any_rotation(random)))
    return tuple(parts)


def _any_rotation(random: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    return np.asarray(Rotation.from_quat(random.standard_normal(4)).as_matrix())


def on_ground(random: np.random.Generator, ground: Ground, half: float) -> Float[np.ndarray, "4 4"]:
    """The motion from the origin to a random place of the ground."""
    return rigid_transform(translation=lifted(ground, random.uniform(-half, half, 2)))


def cover(random: np.random.Generator, arrangement: Arrangement, ground: Ground, edge: float) -> None:
    """Rocks and bushes that stay, few or many."""
    for _ in range(int(random.integers(0, 25))):
        size = edge * np.exp(random.uniform(np.log(0.005), np.log(0.05)))
        arrangement.stays(moved(rock(random, size), on_ground(random, ground, 0.48 * edge)))
    if chance(random, 0.3):
        return
    free_path, tall = random.uniform(0.05, 0.6), random.uniform(0.2, 3.0)
    for _ in range(int(random.integers(3, 40))):
        extent = tall * random.uniform([0.5, 0.5, 0.4], [1.5, 1.5, 1.2])
        bush = Vegetation(np.array([0.0, 0.0, 0.35 * extent[2]]), extent, free_path=free_path)
        arrangement.stays(moved((bush,), on_ground(random, ground, 0.48 * edge)))


def is_displaced(solid: Solid) -> bool:
    """Whether it is ground that came or went."""
    return isinstance(solid, Ground) and solid.label != UNLABELLED


def on_tripods(random: np.random.Generator, ground: Ground, places: np.ndarray) -> Float[np.ndarray, "v 4 4"]:
    """Poses of scanners that stand level at these places [v, 2]."""
    return level_poses(random, places, list(ground.height_at(places) + random.uniform(1.5, 2.5)), np.zeros(3))
