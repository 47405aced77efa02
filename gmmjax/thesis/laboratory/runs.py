"""The granite laboratory of the thesis: its room, its objects, and where they stand in each run (figure 3.6)."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
from jaxtyping import Float

from gmmjax.errors import check_choice
from gmmjax.scenes.objects import INNER, StandingObject, on_floor, standing_at
from gmmjax.scenes.ray_casting import UNLABELLED, Solid

HEIGHT = 1.4
ROBOT, BAG, GEAR_BOX, BOARD, PANEL = "robot", "cargo bag", "gear box", "board", "panel"
RunName = Literal[
    "run1", "run2", "run3", "run4", "run5", "bare", "thin", "bag", "stacked", "random-before", "random-after"
]
RUNS: tuple[RunName, ...] = get_args(RunName)
# Which runs are compared: the first before, the second after.
Preset = Literal["thesis", "thin", "stacked", "empty", "random"]
PRESETS: Mapping[Preset, tuple[tuple[RunName, RunName], ...]] = {
    "thesis": (
        ("run5", "run1"),
        ("run5", "run2"),
        ("run5", "run3"),
        ("run5", "run4"),
        ("run1", "run5"),
        ("run2", "run5"),
        ("run3", "run5"),
        ("run4", "run5"),
        ("run1", "run2"),
        ("run3", "run4"),
    ),
    "thin": (("bare", "thin"), ("thin", "bare")),
    "stacked": (("bag", "stacked"), ("stacked", "bag")),
    "empty": (("run5", "run5"),),
    "random": (("random-before", "random-after"),),
}
# How far an object may be from where its run has it, metres and radians: another laboratory for each seed.
ASTRAY, TURNED = 0.04, 0.12
# Of the random run.
RANDOM_OBJECTS = (ROBOT, BAG, GEAR_BOX)

Place: TypeAlias = tuple[float, float, float, float]
"""x, y and height of the foot, metres, and the turn about the vertical, radians."""


@dataclasses.dataclass(frozen=True, eq=False)
class Laboratory:
    """A room with what stands in it.

    Attributes:
        things: the solids of each wall, piece of furniture and object, by its name; they are labelled with the index.
        objects: those of the things that were put there for this run, with the pose [4, 4] of each.
    """

    things: Mapping[str, StandingObject]
    objects: Mapping[str, Float[np.ndarray, "4 4"]]

    @property
    def solids(self) -> list[Solid]:
        """Of all things."""
        return [solid for parts in self.things.values() for solid in parts]


# All that there may be, so that a thing has the same label in every run.
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
THINGS = (*ROOM, ROBOT, BAG, GEAR_BOX, BOARD, PANEL)


def laboratory(run: RunName, seed: int) -> Laboratory:
    """The laboratory as it was in one run.

    The room is always the same. Objects stand a little differently for every seed, and in the same place in all runs of
    a seed that put them there.

    Args:
        run: "run1" to "run5" of figure 3.6 (run 5 has no object); "thin": two boards of 2 to 3 cm; "bag" and "stacked":
            a cargo bag, and with the gear box on top of it; "random-before" and "random-after": some of the objects
            somewhere on the floor, of which some are gone, new and elsewhere later; "bare": as run 5.
        seed: of the places.

    Raises:
        InputError: an unknown run.
    """
    check_choice("run", run, RUNS)
    placed = _random_objects(seed, run == "random-after") if run.startswith("random") else _placed(run, seed)
    things = {**_room(), **placed}
    labelled = {
        name: tuple(dataclasses.replace(solid, label=THINGS.index(name)) for solid in things[name])
        for name in THINGS
        if name in things
    }
    return Laboratory(labelled, {name: parts[0].pose() for name, parts in labelled.items() if name in placed})


def changes(before: Laboratory, after: Laboratory) -> dict[str, str]:
    """What happened to the objects from one run to another: "appeared", "disappeared" or "moved", by name."""
    kinds = {}
    for name in dict.fromkeys([*before.objects, *after.objects]):
        if name not in before.objects:
            kinds[name] = "appeared"
        elif name not in after.objects:
            kinds[name] = "disappeared"
        elif not np.allclose(before.objects[name], after.objects[name]):
            kinds[name] = "moved"
    return kinds


def _room() -> dict[str, StandingObject]:
    """Walls about a floor of granite, open in front, where two pillars stand outside (figure 3.4)."""
    wall, thick = INNER + 0.05, 0.1
    dock = -INNER + 0.06
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
        "shelf": (_box((INNER - 0.15, -0.2, 0.62), (0.3, 0.8, 0.03)),),
        "handrails": (
            _box((0.1, INNER - 0.05, 0.6), (0.7, 0.03, 0.03)),
            _box((INNER - 0.05, 0.1, 1.1), (0.03, 0.7, 0.03)),
            dataclasses.replace(_box((INNER - 0.05, 0.55, 0.65), (0.06, 0.06, 0.7)), round=True),
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


OBJECTS: Mapping[str, Callable[[], StandingObject]] = {
    ROBOT: _robot,
    BAG: lambda: (_box((0, 0, 0.21), (0.5, 0.25, 0.42)),),
    GEAR_BOX: lambda: (_box((0, 0, 0.13), (0.4, 0.3, 0.26)),),
    BOARD: lambda: (_box((0, 0, 0.015), (0.45, 0.35, 0.03)),),
    PANEL: lambda: (_box((0, 0, 0.2), (0.4, 0.02, 0.4)),),
}

# Robots in the dock stand at this distance from the wall's middle, bags with their back to a wall.
_DOCKED, _ON_WALL = -INNER + 0.12 + 0.05 + 0.16, INNER - 0.125
_PLACES: Mapping[str, Place] = {
    "in the corner near the dock": (-0.75, 0.78, 0.0, 0.3),
    "docked, away from the edge": (_DOCKED, 0.25, 0.0, 0.0),
    "docked, near the edge": (_DOCKED, -0.25, 0.0, 0.0),
    "back wall, high, middle": (0.05, _ON_WALL, 0.75, 0.0),
    "back wall, low, right": (0.62, _ON_WALL, 0.03, 0.0),
    "back wall, high, left": (-0.6, _ON_WALL, 0.75, 0.0),
    "docking wall": (-_ON_WALL, 0.72, 0.7, np.pi / 2),
    "opposite the dock, low, corner": (0.78, 0.78, 0.0, 0.4),
    "floor, left": (-0.35, -0.3, 0.0, 0.5),
    "floor, right": (0.35, 0.2, 0.0, -0.4),
    "on the bag": (0.35, 0.2, 0.42, -0.2),
}
# What is fixed to a wall or docked is not turned.
_FIXED = ("wall", "docked")
_RUNS: Mapping[str, Mapping[str, str]] = {
    "run1": {ROBOT: "in the corner near the dock", BAG: "back wall, high, middle"},
    "run2": {ROBOT: "docked, away from the edge", BAG: "docking wall"},
    "run3": {ROBOT: "docked, near the edge", BAG: "back wall, low, right"},
    "run4": {
        ROBOT: "docked, near the edge",
        BAG: "back wall, high, left",
        GEAR_BOX: "opposite the dock, low, corner",
    },
    "run5": {},
    "bare": {},
    "thin": {BOARD: "floor, left", PANEL: "floor, right"},
    "bag": {BAG: "floor, right"},
    "stacked": {BAG: "floor, right", GEAR_BOX: "on the bag"},
}


def _placed(run: str, seed: int) -> dict[str, StandingObject]:
    placed = {}
    for name, where in _RUNS[run].items():
        x, y, foot, yaw = _PLACES[where]
        # What lies on the bag goes astray with it.
        random = np.random.default_rng([seed, list(_PLACES).index(where.replace("on the bag", "floor, right"))])
        along, aside, turn = random.uniform(-1, 1, 3)
        if any(word in where for word in _FIXED):
            side = "docking" in where or "docked" in where
            x, y = (x, y + ASTRAY * along) if side else (x + ASTRAY * along, y)
        else:
            x, y, yaw = x + ASTRAY * along, y + ASTRAY * aside, yaw + TURNED * turn
        placed[name] = standing_at(OBJECTS[name](), np.array([x, y, foot]), yaw)
    return placed


def _random_objects(seed: int, later: bool) -> dict[str, StandingObject]:
    """Of each object whether it is there at all, goes, comes, moves or stays; at least one of them changes."""
    random = np.random.default_rng([seed, len(_PLACES)])
    room = [solid for name, parts in _room().items() if name != "floor" for solid in parts]
    taken: list[tuple[np.ndarray, float]] = []
    while True:
        fates = random.choice(["gone", "new", "moved", "stays"], len(RANDOM_OBJECTS))
        if (fates != "stays").any():
            break
    placed: tuple[dict[str, StandingObject], dict[str, StandingObject]] = ({}, {})
    for name, fate in zip(RANDOM_OBJECTS, fates, strict=True):
        first, second = (on_floor(random, OBJECTS[name](), room, taken) for _ in range(2))
        if fate != "new":
            placed[0][name] = first
        if fate != "gone":
            placed[1][name] = first if fate == "stays" else second
    return placed[later]


def _box(centre: Sequence[float | int], extent: Sequence[float | int]) -> Solid:
    return Solid(np.array(centre, float), np.array(extent, float), label=UNLABELLED)
