"""Objects of about 0.3 m, and their random placement in a room without collisions."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.errors import InputError
from gmmjax.scenes.families.things import block, pillar
from gmmjax.scenes.ray_casting import Solid, StandingObject

# Half the inner width of the room, and largest distance of an object from its middle on each axis, metres.
ROOM_HALF_WIDTH, STANDING = 1.1, 0.78
ROBOT = "robot"
KINDS = (ROBOT, "bag", "drum", "box", "stack")
# Share of the objects that are put on the shelf where they fit.
ON_SHELF = 0.15
# Two objects that change differ by so much in some extent, metres: of two more alike the scans could not tell that one
# did not become the other by moving.
MIN_DIFFERENCE = 0.03


def placed_objects(
    random: np.random.Generator, room: Sequence[Solid], shelf: Solid, appeared: int, disappeared: int, moved: int
) -> tuple[list[tuple[StandingObject, StandingObject]], list[StandingObject]]:
    """Place the objects before and after each change, and those that stay, none where another one stands.

    The changes are those that disappear, those that appear, and those that move.
    """
    taken: list[tuple[np.ndarray, float]] = []
    others: list[StandingObject] = []

    def placed(parts: StandingObject) -> StandingObject:
        on_shelf = _on_shelf(random, parts, shelf, taken) if random.random() < ON_SHELF else None
        return on_shelf or on_floor(random, parts, room, taken)

    changes: list[tuple[StandingObject, StandingObject]] = []
    for here, there in [(True, False)] * disappeared + [(False, True)] * appeared + [(True, True)] * moved:
        parts = _object(random)
        while any(_alike(parts, other) for other in others):
            parts = _object(random)
        others.append(parts)
        places = [placed(parts) for _ in range(here + there)]
        changes.append((places[0] if here else (), places[-1] if there else ()))
    staying = int(random.integers(1, 4)) if appeared + disappeared + 2 * moved < 4 else 1
    return changes, [placed(_object(random)) for _ in range(staying)]


def _object(random: np.random.Generator) -> StandingObject:
    """A robot's cube, a cargo bag, a drum, a box, or a box on a box, standing at the origin."""
    kind = str(random.choice(KINDS))
    extent = {
        ROBOT: np.full(3, 0.32),
        "bag": np.array([0.45, 0.3, 0.25]) * random.uniform(0.85, 1.1, 3),
        "stack": random.uniform([0.28, 0.24, 0.15], [0.4, 0.36, 0.22]),
    }.get(kind, random.uniform(0.22, 0.42, 3))
    if kind == "drum":
        return (pillar(extent[0], extent[2]),)
    if kind != "stack":
        return (block(extent),)
    upper = extent * random.uniform(0.55, 0.8, 3)
    aside = (extent - upper)[:2] / 2 * random.uniform(-1, 1, 2)
    return block(extent), block(upper, (*aside, extent[2]))


def _alike(parts: StandingObject, other: StandingObject) -> bool:
    """True if two objects at the origin have nearly the same side lengths, on whichever side they stand."""
    sizes = [np.sort([*each[0].extent[:2], sum(part.extent[2] for part in each)]) for each in (parts, other)]
    return bool(np.abs(sizes[0] - sizes[1]).max() < MIN_DIFFERENCE)


def standing_at(parts: StandingObject, place: Float[np.ndarray, "3"], yaw: float) -> StandingObject:
    """An object in another pose.

    Args:
        parts: the object at the origin of the floor.
        place: of the middle of its base, metres.
        yaw: rotation about the vertical, radians.
    """
    rotation = Solid(np.zeros(3), np.ones(3), yaw).rotation
    return tuple(dataclasses.replace(part, centre=place + rotation @ part.centre, yaw=yaw) for part in parts)


def on_floor(
    random: np.random.Generator, parts: StandingObject, room: Sequence[Solid], taken: list[tuple[np.ndarray, float]]
) -> StandingObject:
    """An object in a random free place on the floor, with a random yaw.

    Args:
        random: of place and yaw.
        parts: the object at the origin of the floor.
        room: solids that it must not touch; the floor is no obstacle.
        taken: middle and radius of the places of other objects; this one is appended.

    Raises:
        InputError: no free place was found.
    """
    radius = (1.0 if parts[0].round else 2**0.5) * max(parts[0].extent[:2]) / 2
    obstacles = [solid for solid in room if solid.centre[2] > 0]
    gap = 0.05
    for _ in range(10_000):
        place = random.uniform(-STANDING, STANDING, 2)
        yaw = float(random.uniform(0, 2 * np.pi))
        standing = standing_at(parts, np.array([*place, 0.0]), yaw)
        free = all(np.linalg.norm(place - other) > radius + reach + gap for other, reach in taken)
        if free and not any(_touches(part, solid) for part in standing for solid in obstacles):
            taken.append((place, radius))
            return standing
        gap *= 0.999
    raise InputError("there is no room left for so many objects; ask for fewer, or take another key")


def _on_shelf(
    random: np.random.Generator, parts: StandingObject, shelf: Solid, taken: list[tuple[np.ndarray, float]]
) -> StandingObject | None:
    """On the shelf, its longer side along the wall, where it fits and nothing stands there or below."""
    if parts[0].round or min(parts[0].extent[:2]) > shelf.extent[0] + 0.05:
        return None
    yaw = float(np.pi / 2 if parts[0].extent[0] > parts[0].extent[1] else 0.0) + random.uniform(-0.1, 0.1)
    deep, wide = sorted(parts[0].extent[:2])
    free = max(0.0, (shelf.extent[1] - wide) / 2)
    x = -ROOM_HALF_WIDTH + deep / 2 + 0.1 * wide + random.uniform(0.0, 0.03)
    place = np.array([x, shelf.centre[1] + random.uniform(-free, free)])
    radius = float(np.hypot(deep, wide)) / 2
    if not all(np.linalg.norm(place - other) > radius + reach for other, reach in taken):
        return None
    taken.append((place, radius))
    return standing_at(parts, np.array([*place, shelf.centre[2] + shelf.extent[2] / 2]), yaw)


def _touches(part: Solid, solid: Solid) -> bool:
    """True if the bounding boxes of an upright object and a solid are within 2 cm along the axes of the room."""
    reach = np.abs(part.rotation) @ part.extent / 2
    if part.round:
        reach = part.extent / 2
    return bool((np.abs(part.centre - solid.centre) < reach + solid.extent / 2 + 0.02).all())
