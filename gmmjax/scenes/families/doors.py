"""Rooms in which a door or a cupboard is opened or closed, or a drawer pulled out or pushed in."""

import numpy as np
from jaxtyping import Float

from gmmjax.geometry import rigid_transform
from gmmjax.scenes.families import things
from gmmjax.scenes.families.room_surveys import surveyed_room
from gmmjax.scenes.families.staging import Arrangement, Support
from gmmjax.scenes.families.things import chance, cuboid, moved
from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.rigid_motions import turned
from gmmjax.scenes.surveyed_scene import SurveyedScene

_FURNITURE = things.one_of(
    *(things.bin_, things.box, things.cart, things.chair, things.chair, things.lamp, things.plant, things.table)
)


def doors(random: np.random.Generator) -> SurveyedScene:
    """A room with a door and cupboards with doors and drawers along one wall.

    One or two of them are opened or closed: leaves by 5 to 100 degrees about their hinge, drawers by 5 to 40 cm;
    nothing in a third of the scenes. A leaf, or a drawer with its front, is one object with its motion.
    """
    size = random.uniform([3.0, 2.8, 2.3], [6.0, 5.0, 2.8])
    arrangement = Arrangement()
    arrangement.stays(_room(random, size))
    movable = _wall_with_door(random, arrangement, size)
    movable += _cupboards(random, arrangement, size, movable[0][0][0].centre[0])
    changes = 0 if chance(random, 1 / 3) else 1 + chance(random, 0.25)
    changed = set(random.permutation(len(movable))[:changes])
    aim = np.array([random.uniform(-0.25, 0.25) * size[0], size[1] / 2, 0.9])
    for number, (thing, motion) in enumerate(movable):
        if number in changed:
            arrangement.moves(thing, motion)
            aim = np.array([thing[0].centre[0], size[1] / 2, 0.5 + thing[0].centre[2] / 2])
        else:
            arrangement.stays(thing)
    front = Support(turned(0.0, (0.0, -size[1] / 4, 0.0)), (size[0], size[1] / 2))
    arrangement.furnish(random, [front], _FURNITURE, int(random.integers(0, 5)))
    return surveyed_room(random, arrangement, size, aim)


def _room(random: np.random.Generator, size: np.ndarray) -> list[Solid]:
    """Floor and walls but for the one at the largest y, of one in two with a ceiling."""
    wide, deep, tall = size
    solids = [cuboid((0.0, 0.0, -0.05), (wide + 8.0, deep + 8.0, 0.1))]
    solids += [cuboid((side * (wide / 2 + 0.05), 0.0, tall / 2), (0.1, deep + 0.2, tall)) for side in (-1, 1)]
    solids.append(cuboid((0.0, -deep / 2 - 0.05, tall / 2), (wide, 0.1, tall)))
    if chance(random, 0.5):
        solids.append(cuboid((0.0, 0.0, tall + 0.05), (wide, deep, 0.1)))
    return solids


def _wall_with_door(
    random: np.random.Generator, arrangement: Arrangement, size: np.ndarray
) -> list[tuple[StandingObject, np.ndarray]]:
    """The back wall about an opening, a further room behind or none, and the door with the motion it may make."""
    wide, tall = random.uniform(0.7, 1.0), random.uniform(1.9, min(2.15, size[2] - 0.1))
    left = random.uniform(-size[0] / 2 + 0.15, size[0] / 2 - 0.15 - wide)
    right, back = left + wide, size[1] / 2
    arrangement.stays(_wall(-size[0] / 2, left, 0.0, size[2], back))
    arrangement.stays(_wall(right, size[0] / 2, 0.0, size[2], back))
    arrangement.stays(_wall(left, right, tall, size[2], back))
    if chance(random, 0.8):
        behind = back + random.uniform(1.0, 3.0)
        arrangement.stays([cuboid((0.0, behind, size[2] / 2), (size[0] + 4.0, 0.1, size[2]))])
    inward = chance(random, 0.5)
    hinge = np.array([0.0, back + (0.0 if inward else 0.1), 0.0])
    handle = random.uniform(0.9, 1.1)
    leaf = _leaf(wide - 0.01, tall - 0.01, 0.04, handle, sunk=inward)
    return [_swung(random, leaf, hinge, (left, right), inward)]


def _wall(left: float, right: float, low: float, high: float, back: float) -> list[Solid]:
    """A piece of the back wall."""
    middle = ((left + right) / 2, back + 0.05, (low + high) / 2)
    return [cuboid(middle, (right - left, 0.1, high - low))]


def _leaf(wide: float, tall: float, thick: float, handle: float, sunk: bool) -> StandingObject:
    """A leaf from the hinge at the origin along x, whose face is at y = 0, with a handle before and behind."""
    side = 0.5 if sunk else -0.5
    parts = [cuboid((wide / 2, side * thick, tall / 2), (wide, thick, tall))]
    if handle > 0:
        depth = 2 * 0.05 + thick
        parts.append(cuboid((wide - 0.07, side * thick, handle), (0.12, depth, 0.025)))
    return tuple(parts)


def _swung(
    random: np.random.Generator, leaf: StandingObject, hinge: np.ndarray, span: tuple[float, float], inward: bool
) -> tuple[StandingObject, np.ndarray]:
    """A leaf with its hinge on the left or on the right, closed or ajar, and its motion by 5 to 100 degrees.

    Args:
        random: of hinge and angles.
        leaf: from the hinge at the origin along x.
        hinge: y and z of the hinge.
        span: x of the left and of the right end of the opening.
        inward: whether it opens towards smaller y.
    """
    on_left = chance(random, 0.5)
    place = hinge + np.array([span[0] if on_left else span[1], 0.0, 0.0])
    if not on_left:
        leaf = tuple(_mirrored(part) for part in leaf)
    # Seen from above, a leaf on the left swings clockwise into the room.
    way = -1.0 if on_left == inward else 1.0
    first = 0.0 if chance(random, 0.6) else random.uniform(5, 90)
    step = random.uniform(5, 100)
    second = first + step if first + step <= 110 else first - min(step, first)
    angles = np.radians([first, second] if abs(second - first) >= 5 else [0.0, step])
    if chance(random, 0.3):
        angles = angles[::-1]
    ajar, wide = (turned(float(way * angle), place) for angle in angles)
    return moved(leaf, ajar), wide @ np.linalg.inv(ajar)


def _mirrored(part: Solid) -> Solid:
    """A box on the other side of x = 0."""
    return cuboid(part.centre * [-1.0, 1.0, 1.0], part.extent)


def _cupboards(
    random: np.random.Generator, arrangement: Arrangement, size: np.ndarray, door: float
) -> list[tuple[StandingObject, np.ndarray]]:
    """One to three cupboards along the back wall, away from the door; what moves of them, with its motion."""
    movable = []
    left = -size[0] / 2 + random.uniform(0.05, 0.3)
    for _ in range(int(random.integers(1, 4))):
        wide = random.uniform(0.4, 1.0)
        if left - 0.7 < door < left + wide + 0.7:
            left = door + 0.7
        if left + wide > size[0] / 2 - 0.05:
            break
        deep, tall = random.uniform(0.35, 0.6), random.uniform(0.6, 1.8)
        low = random.uniform(1.0, 1.4) if tall < 0.8 and chance(random, 0.3) else 0.0
        corner = np.array([left, size[1] / 2 - deep, low])
        extent = np.array([wide, deep, tall])
        arrangement.stays(_carcass(corner, extent))
        movable += _fronts(random, arrangement, corner, extent)
        left += wide + (0.005 if chance(random, 0.5) else random.uniform(0.1, 0.6))
    return movable


def _carcass(corner: np.ndarray, extent: np.ndarray) -> list[Solid]:
    """The panels of a cupboard that is open towards smaller y."""
    wide, deep, tall = extent
    panels = [
        ((wide / 2, deep - 0.009, tall / 2), (wide, 0.018, tall)),
        ((0.009, deep / 2, tall / 2), (0.018, deep, tall)),
        ((wide - 0.009, deep / 2, tall / 2), (0.018, deep, tall)),
        ((wide / 2, deep / 2, 0.009), (wide, deep, 0.018)),
        ((wide / 2, deep / 2, tall - 0.009), (wide, deep, 0.018)),
    ]
    return [cuboid(corner + middle, size) for middle, size in panels]


def _fronts(
    random: np.random.Generator, arrangement: Arrangement, corner: np.ndarray, extent: np.ndarray
) -> list[tuple[StandingObject, np.ndarray]]:
    """Drawers one above the other, or one or two leaves with shelves behind."""
    wide, deep, tall = extent
    if chance(random, 0.5):
        rows = int(random.integers(2, 6))
        step = tall / rows
        return [
            _drawer(random, corner + np.array([0.0, 0.0, row * step]), np.array([wide, deep, step - 0.004]))
            for row in range(rows)
        ]
    for share in np.linspace(0, 1, int(random.integers(2, 5)))[1:-1]:
        arrangement.stays([cuboid(corner + np.array([wide / 2, deep / 2, share * tall]), (wide, deep - 0.04, 0.018))])
    leaves = 1 if wide < 0.6 else 2
    swung = []
    for number in range(leaves):
        span = (corner[0] + number * wide / leaves, corner[0] + (number + 1) * wide / leaves)
        leaf = _leaf(wide / leaves - 0.003, tall, 0.018, random.uniform(0.3, 0.7) * tall, sunk=False)
        swung.append(_swung(random, leaf, np.array([0.0, corner[1], corner[2]]), span, inward=True))
    return swung


def _drawer(
    random: np.random.Generator, corner: np.ndarray, extent: np.ndarray
) -> tuple[StandingObject, Float[np.ndarray, "4 4"]]:
    """A front before the cupboard with an open box behind it, something in it or nothing, and its motion."""
    wide, deep, tall = extent
    inner, low, behind = wide - 0.06, 0.6 * tall, 0.9 * deep
    panels = [
        ((wide / 2, -0.009, tall / 2), (wide - 0.004, 0.018, tall)),
        ((wide / 2, behind / 2, 0.03), (inner, behind, 0.01)),
        ((wide / 2, behind, low / 2 + 0.03), (inner, 0.012, low)),
        *(((wide / 2 + side * inner / 2, behind / 2, low / 2 + 0.03), (0.012, behind, low)) for side in (-1, 1)),
        ((wide / 2, -0.03, 0.7 * tall), (min(0.15, 0.5 * wide), 0.03, 0.015)),
    ]
    if chance(random, 0.5):
        size = np.array([inner, behind, low]) * random.uniform(0.3, 0.8, 3)
        panels.append(((wide / 2, behind / 2, size[2] / 2 + 0.035), tuple(size)))
    most = min(0.4, 0.85 * deep)
    pulled = random.uniform(0.05, most)
    first = 0.0 if chance(random, 0.7) else random.uniform(0.0, most)
    second = first + pulled if first + pulled <= most else max(first - pulled, 0.0)
    if abs(second - first) < 0.05:
        first, second = 0.0, pulled
    drawer = tuple(cuboid(corner + middle + [0.0, -first, 0.0], size) for middle, size in panels)
    return drawer, rigid_transform(translation=np.array([0.0, first - second, 0.0]))
