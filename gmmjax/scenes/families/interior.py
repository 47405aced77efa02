"""Rooms: their walls with what is fixed to them, the furniture, and where things can stand on it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.scenes.families import things
from gmmjax.scenes.families.staging import Support, top_of
from gmmjax.scenes.families.things import Drawing, between, chance, moved
from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.rigid_motions import turned

# Furniture whose upper faces carry things, and how many of its first solids do.
_CARRIERS: dict[Drawing, int] = {things.counter: 1, things.table: 1, things.shelves: 4, things.sofa: 1}
_ALONG_WALLS = (things.counter, things.cupboard, things.shelves, things.sofa, things.table)
_IN_THE_MIDDLE = [things.table, things.chair, things.chair, things.lamp, things.plant, things.chair]


@dataclasses.dataclass(frozen=True, eq=False)
class Interior:
    """A furnished room.

    Attributes:
        solids: walls and furniture.
        floor: where things can stand.
        tops: of the furniture, where smaller things can.
        size: of the room, metres.
    """

    solids: list[Solid]
    floor: Support
    tops: list[Support]
    size: Float[np.ndarray, "3"]

    def put(self, kind: Drawing, thing: StandingObject, pose: np.ndarray | None) -> None:
        """Add the thing, where it found a place, and the faces of it that carry others."""
        if pose is None:
            return
        standing = moved(thing, pose)
        self.solids.extend(standing)
        carriers = standing[: _CARRIERS.get(kind, 0)]
        levels = [float(solid.centre[2]) for solid in carriers]
        for index, solid in enumerate(carriers):
            below_another = kind is things.shelves and index + 1 < len(levels)
            above = levels[index + 1] - levels[index] - 0.06 if below_another else 1.5
            self.tops.append(top_of(solid, headroom=max(above, 0.0)))


def furnished_room(
    random: np.random.Generator,
    size: Float[np.ndarray, "3"],
    *,
    middle: Sequence[float] | np.ndarray = (0.0, 0.0),
    walls: bool = True,
) -> Interior:
    """A room with furniture along its walls and in its middle.

    Args:
        random: of everything.
        size: inner length, width and height, metres.
        middle: of the floor.
        walls: whether it has walls and a ceiling of its own.
    """
    floor = Support(np.eye(4), (float(size[0]), float(size[1])))
    room = Interior(shell(random, size) if walls else [], floor, [], size)
    for draw in random.permutation(np.array([*_ALONG_WALLS, things.shelves, things.cupboard], object))[
        : int(random.integers(2, 6))
    ]:
        thing = draw(random)
        room.put(draw, thing, _against_wall(random, thing, floor))
    for draw in _IN_THE_MIDDLE[: int(random.integers(1, 7))]:
        thing = draw(random)
        room.put(draw, thing, floor.pose(random, thing))
    motion = turned(0.0, (*middle, 0.0))
    tops = [dataclasses.replace(top, middle=motion @ top.middle) for top in room.tops]
    return Interior(list(moved(room.solids, motion)), dataclasses.replace(floor, middle=motion), tops, size)


def shell(random: np.random.Generator, size: Float[np.ndarray, "3"]) -> list[Solid]:
    """Floor, walls, mostly a ceiling, and what stands out of the walls: frames of doors, radiators, sills, columns."""
    x, y, z = size / 2 * [1, 1, 2]
    thick = 0.1
    solids = [between((-x - thick, -y - thick, -thick), (x + thick, y + thick, 0.0))]
    if chance(random, 0.7):
        solids.append(between((-x, -y, z), (x, y, z + thick)))
    for side in (-1.0, 1.0):
        solids.append(Solid(np.array([side * (x + thick / 2), 0.0, z / 2]), np.array([thick, 2 * y + 2 * thick, z])))
        solids.append(Solid(np.array([0.0, side * (y + thick / 2), z / 2]), np.array([2 * x, thick, z])))
    for _ in range(int(random.integers(3, 9))):
        pose, length = _at_wall(random, size)
        wide = random.uniform(0.1, min(1.2, 0.8 * length))
        deep, high = random.uniform([0.03, 0.1], [0.25, 1.0])
        relief = Solid(np.array([0.0, -deep / 2, random.uniform(high / 2, z - high / 2)]), np.array([wide, deep, high]))
        solids.append(relief.moved(pose @ turned(0.0, (random.uniform(-1, 1) * (length - wide) / 2, 0.0, 0.0))))
    return solids


def _at_wall(random: np.random.Generator, size: np.ndarray) -> tuple[np.ndarray, float]:
    """The pose whose y axis points into a wall from the middle of its foot, and the wall's length."""
    wall = int(random.integers(4))
    outward = np.pi / 2 * wall
    away = size[wall % 2] / 2
    place = (away * np.cos(outward), away * np.sin(outward), 0.0)
    return turned(outward - np.pi / 2, place), float(size[1 - wall % 2])


def _against_wall(random: np.random.Generator, thing: StandingObject, floor: Support) -> np.ndarray | None:
    """A free pose with the thing's back (+y) at a wall: it takes a row of circles."""
    reaches = np.abs([[*solid.centre[:2]] for solid in thing]) + [solid.extent[:2] / 2 for solid in thing]
    half_wide, half_deep = reaches.max(axis=0)
    for _ in range(20):
        wall, length = _at_wall(random, np.array([*floor.size, 0.0]))
        if length < 2 * half_wide:
            continue
        along = random.uniform(-1, 1) * (length / 2 - half_wide)
        pose = wall @ turned(0.0, (along, -half_deep - random.uniform(0.0, 0.05), 0.0))
        row = np.linspace(-half_wide, half_wide, max(2, int(np.ceil(half_wide / half_deep)) + 1))
        spots = (pose[:2, :2] @ np.stack([row, np.zeros_like(row)])).T + pose[:2, 3]
        if all(floor.free(spot, half_deep) for spot in spots):
            floor.taken.extend((spot, float(half_deep)) for spot in spots)
            return np.asarray(pose)
    return None
