"""Rooms in which something was turned or shifted within its old place."""

import numpy as np
from jaxtyping import Float

from gmmjax.scenes.families import things
from gmmjax.scenes.families.interior import furnished_room
from gmmjax.scenes.families.room_surveys import surveyed_room
from gmmjax.scenes.families.staging import Arrangement, Support, displaced
from gmmjax.scenes.families.things import chance, moved
from gmmjax.scenes.rigid_motions import turned
from gmmjax.scenes.surveyed_scene import SurveyedScene

_SHIFTED = things.one_of(
    *(things.box, things.box, things.cart, things.drum, things.machine, things.machine, things.stack)
)
_STAYING = things.one_of(things.bin_, things.box, things.chair, things.machine, things.suitcase)


def small_motions(random: np.random.Generator) -> SurveyedScene:
    """Furnished rooms: a chair is turned by 5 to 60 degrees, or a box or a machine shifted by 2 to 15 cm.

    Now and then two things; nothing in a third of the scenes.
    """
    size = random.uniform([3.0, 3.0, 2.3], [6.0, 6.0, 3.0])
    room = furnished_room(random, size)
    arrangement = Arrangement()
    arrangement.stays(room.solids)
    aim = np.array([0.0, 0.15 * size[1], 0.4])
    for _ in range(0 if chance(random, 1 / 3) else 1 + chance(random, 0.3)):
        place = _move(random, arrangement, room.floor)
        aim = aim if place is None else np.array([place[0], place[1], 0.4])
    arrangement.furnish(random, [room.floor], _STAYING, int(random.integers(1, 5)))
    return surveyed_room(random, arrangement, size, aim)


def _move(random: np.random.Generator, arrangement: Arrangement, floor: Support) -> Float[np.ndarray, "3"] | None:
    """Moves a thing a little, and tells where it stands; None where there is no place for it."""
    turns = chance(random, 0.4)
    thing = things.chair(random) if turns else _SHIFTED(random)
    pose = floor.pose(random, thing, 0.1)
    if pose is None:
        return None
    if turns:
        angle = np.radians(random.uniform(5, 60)) * random.choice([-1, 1])
        shift = random.uniform(-0.05, 0.05, 2) if chance(random, 0.5) else np.zeros(2)
        motion = pose @ turned(float(angle), (*shift, 0.0)) @ np.linalg.inv(pose)
    else:
        motion = displaced(random, pose, (0.02, 0.15), np.radians(5) if chance(random, 1 / 3) else 0.0)
    arrangement.moves(moved(thing, pose), np.asarray(motion))
    return np.asarray(pose[:3, 3])
