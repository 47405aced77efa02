"""The runs of the thesis's laboratory (figure 3.6): the objects and their places, and the changes between two runs."""

import dataclasses
from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

import numpy as np
from jaxtyping import Float

from gmmjax.errors import check_choice
from gmmjax.scenes import ROOM_HALF_WIDTH, Solid, StandingObject, on_floor, standing_at
from gmmjax.thesis.laboratory.room import BAG, BOARD, GEAR_BOX, OBJECTS, PANEL, ROBOT, THINGS, furnished_room

RunName = Literal[
    "run1", "run2", "run3", "run4", "run5", "bare", "thin", "bag", "stacked", "random-before", "random-after"
]
RUNS: tuple[RunName, ...] = get_args(RunName)
Preset = Literal["thesis", "thin", "stacked", "empty", "random"]
# The pairs of runs of each preset, before and after.
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
# Largest random displacement of an object on each axis, metres, and rotation, radians: they differ between seeds.
PLACE_NOISE, YAW_NOISE = 0.04, 0.12
# The objects of the random runs.
RANDOM_OBJECTS = (ROBOT, BAG, GEAR_BOX)

Place: TypeAlias = tuple[float, float, float, float]
"""x, y and height of an object's base, metres, and its yaw, radians."""


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
    """The laboratory in one run.

    The room is always the same. The places of the objects vary with the seed, and are the same in all runs of a seed
    that use them.

    Args:
        run: "run1" to "run5" of figure 3.6 (run 5 has no object); "thin": two boards of 2 to 3 cm; "bag" and "stacked":
            a cargo bag, and with the gear box on top of it; "random-before" and "random-after": some of the objects
            somewhere on the floor, of which some disappear, appear and move; "bare": as run 5.
        seed: of the places.

    Raises:
        InputError: an unknown run.
    """
    check_choice("run", run, RUNS)
    placed = _random_objects(seed, run == "random-after") if run.startswith("random") else _placed(run, seed)
    things = {**furnished_room(), **placed}
    labelled = {
        name: tuple(dataclasses.replace(solid, label=THINGS.index(name)) for solid in things[name])
        for name in THINGS
        if name in things
    }
    return Laboratory(labelled, {name: parts[0].pose() for name, parts in labelled.items() if name in placed})


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


# Distance of a docked robot from the middle of the room, and of a bag with its back to a wall, metres.
_DOCKED, _ON_WALL = -ROOM_HALF_WIDTH + 0.12 + 0.05 + 0.16, ROOM_HALF_WIDTH - 0.125
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
# Objects in these places vary along the wall only, and are not rotated.
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
        x, y, base, yaw = _PLACES[where]
        # What lies on the bag is displaced with it.
        random = np.random.default_rng([seed, list(_PLACES).index(where.replace("on the bag", "floor, right"))])
        along, across, turn = random.uniform(-1, 1, 3)
        if any(word in where for word in _FIXED):
            side = "docking" in where or "docked" in where
            x, y = (x, y + PLACE_NOISE * along) if side else (x + PLACE_NOISE * along, y)
        else:
            x, y, yaw = x + PLACE_NOISE * along, y + PLACE_NOISE * across, yaw + YAW_NOISE * turn
        placed[name] = standing_at(OBJECTS[name](), np.array([x, y, base]), yaw)
    return placed


def _random_objects(seed: int, later: bool) -> dict[str, StandingObject]:
    """The objects before or after, each of which disappears, appears, moves or stays; at least one changes."""
    random = np.random.default_rng([seed, len(_PLACES)])
    obstacles = [solid for name, parts in furnished_room().items() if name != "floor" for solid in parts]
    taken: list[tuple[np.ndarray, float]] = []
    while True:
        fates = random.choice(["gone", "new", "moved", "stays"], len(RANDOM_OBJECTS))
        if (fates != "stays").any():
            break
    placed: tuple[dict[str, StandingObject], dict[str, StandingObject]] = ({}, {})
    for name, fate in zip(RANDOM_OBJECTS, fates, strict=True):
        first, second = (on_floor(random, OBJECTS[name](), obstacles, taken) for _ in range(2))
        if fate != "new":
            placed[0][name] = first
        if fate != "gone":
            placed[1][name] = first if fate == "stays" else second
    return placed[later]
