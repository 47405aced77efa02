"""The granite laboratory of the thesis: its room (figure 3.4) and the objects that its runs place in it."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gmmjax.scenes import ROOM_HALF_WIDTH, UNLABELLED, Solid, StandingObject

# Height of the walls, metres; they begin 0.1 m below the floor's upper side.
HEIGHT = 1.4
ROBOT, BAG, GEAR_BOX, BOARD, PANEL = "robot", "cargo bag", "gear box", "board", "panel"
ROOM = (
    "floor",
    "back wall",
    "docking wall",
    "shelf wall",
    "front wall, left",
    "front wall, right",
    "dock",
    "shelf",
    "handrails",
    "cupboard",
    "pillars",
)
# Everything that any run contains: a thing's index is its label, the same in every run.
THINGS = (*ROOM, ROBOT, BAG, GEAR_BOX, BOARD, PANEL)


def furnished_room() -> dict[str, StandingObject]:
    """The solids of walls and furniture by name: granite floor, open in front, two pillars outside (figure 3.4)."""
    wall, thick = ROOM_HALF_WIDTH + 0.05, 0.1
    dock = -ROOM_HALF_WIDTH + 0.06
    return {
        "floor": (_box((0, 0, -0.05), (2.4, 2.4, 0.1)),),
        "back wall": (_box((0, wall, HEIGHT / 2 - 0.1), (2.4, thick, HEIGHT)),),
        "docking wall": (_box((-wall, 0, HEIGHT / 2 - 0.1), (thick, 2.4, HEIGHT)),),
        "shelf wall": (_box((wall, 0, HEIGHT / 2 - 0.1), (thick, 2.4, HEIGHT)),),
        "front wall, left": (_box((-0.85, -wall, HEIGHT / 2 - 0.1), (0.7, thick, HEIGHT)),),
        "front wall, right": (_box((0.85, -wall, HEIGHT / 2 - 0.1), (0.7, thick, HEIGHT)),),
        "dock": (
            _box((dock, 0.0, 0.45), (0.12, 0.9, 0.34)),
            _box((dock + 0.08, 0.25, 0.45), (0.06, 0.14, 0.14)),
            _box((dock + 0.08, -0.25, 0.45), (0.06, 0.14, 0.14)),
        ),
        "shelf": (_box((ROOM_HALF_WIDTH - 0.15, -0.2, 0.62), (0.3, 0.8, 0.03)),),
        "handrails": (
            _box((0.1, ROOM_HALF_WIDTH - 0.05, 0.6), (0.7, 0.03, 0.03)),
            _box((ROOM_HALF_WIDTH - 0.05, 0.1, 1.1), (0.03, 0.7, 0.03)),
            dataclasses.replace(_box((ROOM_HALF_WIDTH - 0.05, 0.55, 0.65), (0.06, 0.06, 0.7)), round=True),
        ),
        "cupboard": (_box((0.82, -0.9, 0.25), (0.4, 0.36, 0.5)),),
        "pillars": (
            _box((-0.45, -2.0, 0.7), (0.2, 0.2, 1.4)),
            _box((0.45, -2.0, 0.7), (0.2, 0.2, 1.4)),
        ),
    }


def _robot() -> StandingObject:
    """A cube of 0.32 m that floats on its air carriage."""
    carriage = dataclasses.replace(_box((0, 0, 0.14), (0.28, 0.28, 0.28)), round=True)
    return _box((0, 0, 0.45), (0.32, 0.32, 0.32)), carriage


def _box(centre: Sequence[float | int], extent: Sequence[float | int]) -> Solid:
    return Solid(np.array(centre, float), np.array(extent, float), label=UNLABELLED)


# Each object at the origin of the floor, by name.
OBJECTS: Mapping[str, Callable[[], StandingObject]] = {
    ROBOT: _robot,
    BAG: lambda: (_box((0, 0, 0.21), (0.5, 0.25, 0.42)),),
    GEAR_BOX: lambda: (_box((0, 0, 0.13), (0.4, 0.3, 0.26)),),
    BOARD: lambda: (_box((0, 0, 0.015), (0.45, 0.35, 0.03)),),
    PANEL: lambda: (_box((0, 0, 0.2), (0.4, 0.02, 0.4)),),
}
