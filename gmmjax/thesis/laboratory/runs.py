"""The granite laboratory of the thesis (figure 3.4), and the objects that its runs (figure 3.6) place in it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from jaxtyping import Float

from gmmjax.errors import check_choice
from gmmjax.scenes import ROOM_HALF_WIDTH, Solid, StandingObject, standing_at

RunName = Literal["run1", "run2", "run3", "run4", "run5"]
RUNS: tuple[RunName, ...] = get_args(RunName)
RunPair: TypeAlias = tuple[RunName, RunName]
# Pairs in which objects only appear or only disappear: run 5 has none.
ONE_TYPE: tuple[RunPair, ...] = (
    *(("run5", "run1"), ("run5", "run2"), ("run5", "run3"), ("run5", "run4")),
    *(("run1", "run5"), ("run2", "run5"), ("run3", "run5"), ("run4", "run5")),
)
PAIRS: tuple[RunPair, ...] = (*ONE_TYPE, ("run1", "run2"), ("run3", "run4"))

# Height of the walls, metres; they begin 0.1 m below the floor's upper side.
HEIGHT = 1.4
# Largest random displacement of an object on each axis, metres, and rotation, radians: they differ between seeds.
PLACE_NOISE, YAW_NOISE = 0.04, 0.12


@dataclasses.dataclass(frozen=True, eq=False)
class Laboratory:
    """The room and the objects in it.

    Attributes:
        things: the solids of each wall, piece of furniture and object by name; their label is the index in `THINGS`.
        objects: the pose [4, 4] of each thing that this run placed, by name.
    """

    things: Mapping[str, StandingObject]
    objects: Mapping[str, Float[np.ndarray, "4 4"]]

    @property
    def solids(self) -> list[Solid]:
        """The solids of all things."""
        return [solid for parts in self.things.values() for solid in parts]


def laboratory_of(run: RunName, seed: int) -> Laboratory:
    """The laboratory in one run: always the same room, with objects in places that vary with the seed.

    Args:
        run: "run1" to "run5" of figure 3.6; run 5 has no object.
        seed: of the places, which are the same in all runs of a seed that use them.

    Raises:
        InputError: an unknown run.
    """
    check_choice("run", run, RUNS)
    placed = {name: _placed(name, place, seed) for name, place in _OBJECTS_OF[run].items()}
    things = {name: _solids(name, parts) for name, parts in _ROOM.items()}
    things |= {name: placed[name] for name in THINGS if name in placed}
    return Laboratory(things, {name: things[name][0].pose() for name in THINGS if name in placed})


def object_changes(before: Laboratory, after: Laboratory) -> dict[str, str]:
    """The objects that differ between two laboratories: "appeared", "disappeared" or "moved", by name."""
    kinds = {}
    for name in dict.fromkeys([*before.objects, *after.objects]):
        if name not in before.objects:
            kinds[name] = "appeared"
        elif name not in after.objects:
            kinds[name] = "disappeared"
        elif not np.allclose(before.objects[name], after.objects[name]):
            kinds[name] = "moved"
    return kinds


_WALL, _DOCK, _MIDDLE = ROOM_HALF_WIDTH + 0.05, -ROOM_HALF_WIDTH + 0.06, HEIGHT / 2 - 0.1
# The boxes and cylinders of each thing: centre and extent, metres.
_ROOM: Mapping[str, Sequence[Sequence[Any]]] = {
    "floor": (((0, 0, -0.05), (2.4, 2.4, 0.1)),),
    "back wall": (((0, _WALL, _MIDDLE), (2.4, 0.1, HEIGHT)),),
    "docking wall": (((-_WALL, 0, _MIDDLE), (0.1, 2.4, HEIGHT)),),
    "shelf wall": (((_WALL, 0, _MIDDLE), (0.1, 2.4, HEIGHT)),),
    "front wall, left": (((-0.85, -_WALL, _MIDDLE), (0.7, 0.1, HEIGHT)),),
    "front wall, right": (((0.85, -_WALL, _MIDDLE), (0.7, 0.1, HEIGHT)),),
    "dock": (
        ((_DOCK, 0, 0.45), (0.12, 0.9, 0.34)),
        ((_DOCK + 0.08, 0.25, 0.45), (0.06, 0.14, 0.14)),
        ((_DOCK + 0.08, -0.25, 0.45), (0.06, 0.14, 0.14)),
    ),
    "shelf": (((ROOM_HALF_WIDTH - 0.15, -0.2, 0.62), (0.3, 0.8, 0.03)),),
    "handrails": (
        ((0.1, ROOM_HALF_WIDTH - 0.05, 0.6), (0.7, 0.03, 0.03)),
        ((ROOM_HALF_WIDTH - 0.05, 0.1, 1.1), (0.03, 0.7, 0.03)),
        ((ROOM_HALF_WIDTH - 0.05, 0.55, 0.65), (0.06, 0.06, 0.7), "round"),
    ),
    "cupboard": (((0.82, -0.9, 0.25), (0.4, 0.36, 0.5)),),
    "pillars": (((-0.45, -2, 0.7), (0.2, 0.2, 1.4)), ((0.45, -2, 0.7), (0.2, 0.2, 1.4))),
}
# Each object at the origin of the floor. The robot is a cube that floats on its air carriage.
_OBJECTS: Mapping[str, Sequence[Sequence[Any]]] = {
    "robot": (((0, 0, 0.45), (0.32, 0.32, 0.32)), ((0, 0, 0.14), (0.28, 0.28, 0.28), "round")),
    "cargo bag": (((0, 0, 0.21), (0.5, 0.25, 0.42)),),
    "gear box": (((0, 0, 0.13), (0.4, 0.3, 0.26)),),
}
# Everything that any run contains: a thing's index is its label, the same in every run.
THINGS = (*_ROOM, *_OBJECTS)

# Distance of a docked robot from the middle of the room, and of a bag with its back to a wall, metres.
_DOCKED, _ON_WALL = -ROOM_HALF_WIDTH + 0.12 + 0.05 + 0.16, ROOM_HALF_WIDTH - 0.125
# x, y and height of an object's base, metres, and its yaw, radians. The order numbers the seeds.
_PLACES: Mapping[str, tuple[float, float, float, float]] = {
    "in the corner near the dock": (-0.75, 0.78, 0.0, 0.3),
    "docked, away from the edge": (_DOCKED, 0.25, 0.0, 0.0),
    "docked, near the edge": (_DOCKED, -0.25, 0.0, 0.0),
    "back wall, high, middle": (0.05, _ON_WALL, 0.75, 0.0),
    "back wall, low, right": (0.62, _ON_WALL, 0.03, 0.0),
    "back wall, high, left": (-0.6, _ON_WALL, 0.75, 0.0),
    "docking wall": (-_ON_WALL, 0.72, 0.7, np.pi / 2),
    "opposite the dock, low, corner": (0.78, 0.78, 0.0, 0.4),
}
_OBJECTS_OF: Mapping[str, Mapping[str, str]] = {
    "run1": {"robot": "in the corner near the dock", "cargo bag": "back wall, high, middle"},
    "run2": {"robot": "docked, away from the edge", "cargo bag": "docking wall"},
    "run3": {"robot": "docked, near the edge", "cargo bag": "back wall, low, right"},
    "run4": {
        "robot": "docked, near the edge",
        "cargo bag": "back wall, high, left",
        "gear box": "opposite the dock, low, corner",
    },
    "run5": {},
}


def _solids(name: str, parts: Sequence[Sequence[Any]]) -> StandingObject:
    label = THINGS.index(name)
    return tuple(
        Solid(np.array(centre, float), np.array(extent, float), round=bool(form), label=label)
        for centre, extent, *form in parts
    )


def _placed(name: str, place: str, seed: int) -> StandingObject:
    x, y, base, yaw = _PLACES[place]
    random = np.random.default_rng([seed, list(_PLACES).index(place)])
    along, across, rotation = random.uniform(-1, 1, 3)
    if "back wall" in place:
        x += PLACE_NOISE * along
    elif "docking wall" in place or "docked" in place:
        y += PLACE_NOISE * along
    else:
        x, y, yaw = x + PLACE_NOISE * along, y + PLACE_NOISE * across, yaw + YAW_NOISE * rotation
    return standing_at(_solids(name, _OBJECTS[name]), np.array([x, y, base]), yaw)
