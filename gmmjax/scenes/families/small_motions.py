"""Rooms in which something was turned or shifted within its old place."""

import numpy as np
from jaxtyping import Float

from gmmjax.scenes.families.arrangements import Arrangement, FreePlaces, Thing, chance, moved, reach, standing_on
from gmmjax.scenes.families.furnishings import chair, crate, furniture, machine
from gmmjax.scenes.families.interiors import room, surveyed_room
from gmmjax.scenes.surveyed_scene import SurveyedScene


def small_motions_scene(random: np.random.Generator) -> SurveyedScene:
    """A room with furniture: a chair is turned by 5 to 60 degrees, or a box or a machine shifted by 2 to 15 cm.

    Now and then two things; nothing in a third of the scenes.

    Args:
        random: of everything.
    """
    size = random.uniform([3.0, 3.0, 2.3], [6.0, 6.0, 3.0])
    arrangement = Arrangement()
    arrangement.stays(room(random, size))
    places = FreePlaces(size[:2] / 2, gap=0.03)
    aim = np.array([0.0, 0.15 * size[1], 0.4])
    moving = 0 if chance(random, 1 / 3) else 1 + chance(random, 0.3)
    for _ in range(moving):
        thing, turns = _movable(random)
        place = places.take(random, reach(thing) + 0.15)
        if place is not None:
            pose = standing_on((*place, 0.0), random.uniform(0, 2 * np.pi))
            motion = _turn(random, place) if turns else _shift(random, pose)
            arrangement.moves(moved(thing, pose), motion)
            aim = np.array([*place, 0.4])
    for _ in range(int(random.integers(2, 8))):
        thing = furniture(random)
        place = places.take(random, reach(thing))
        if place is not None:
            arrangement.stays(moved(thing, standing_on((*place, 0.0), random.uniform(0, 2 * np.pi))))
    return surveyed_room(random, arrangement, size, aim)


def _movable(random: np.random.Generator) -> tuple[Thing, bool]:
    """A chair, which turns, or a box or a machine, which is shifted."""
    kind = int(random.integers(3))
    return (chair, crate, machine)[kind](random), kind == 0


def _turn(random: np.random.Generator, place: np.ndarray) -> Float[np.ndarray, "4 4"]:
    """By 5 to 60 degrees about a vertical through the thing, with hardly a shift."""
    angle = np.radians(random.uniform(5, 60)) * random.choice([-1, 1])
    there = place + (random.uniform(-0.05, 0.05, 2) if chance(random, 0.5) else 0.0)
    return np.asarray(standing_on((*there, 0.0), angle) @ standing_on((*(-place), 0.0), 0.0))


def _shift(random: np.random.Generator, pose: np.ndarray) -> Float[np.ndarray, "4 4"]:
    """By 2 to 15 cm along the floor, of one in three with a rotation of up to 5 degrees."""
    direction, length = random.uniform(0, 2 * np.pi), random.uniform(0.02, 0.15)
    there = pose.copy()
    there[:2, 3] += length * np.array([np.cos(direction), np.sin(direction)])
    yaw = np.radians(random.uniform(-5, 5)) if chance(random, 1 / 3) else 0.0
    return np.asarray(there @ standing_on((0.0, 0.0, 0.0), float(yaw)) @ np.linalg.inv(pose))
