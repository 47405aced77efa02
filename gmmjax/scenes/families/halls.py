"""Halls with pillars, machines and goods, depots with racks, and open yards, surveyed by scanners on tripods."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families import things
from gmmjax.scenes.families.scanners import TripodSurveys
from gmmjax.scenes.families.staging import Support, Turnover, staged, top_of
from gmmjax.scenes.families.things import between, chance, moved, pillar
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.rigid_motions import upright
from gmmjax.scenes.surveyed_scene import SurveyedScene

_HALL_SURVEYS = TripodSurveys(
    (140_000, 1_000_000), (30_000, 250_000), 12_000, hidden_by=0.06, highest=(15.0, 70.0), fused=0.5
)
_DEPOT_SURVEYS = TripodSurveys(
    (250_000, 1_000_000), (30_000, 200_000), 15_000, hidden_by=0.06, highest=(30.0, 80.0), fused=0.4
)
_CRATE, _CARTON, _CASE = things.boxes(0.8, 2.2), things.boxes(0.2, 1.0), things.boxes(0.3, 1.8)
_HALL_THINGS = things.one_of(
    *(things.pallet, things.pallet, _CRATE, _CRATE, things.cart, things.stack, things.drum, things.machine),
    *(things.clutter, things.shelves, things.table, things.cupboard, things.tripod),
)
_DEPOT_THINGS = things.one_of(
    *(things.pallet, things.pallet, _CARTON, _CARTON, things.rod, things.rod, things.drum, things.stack),
    *(things.clutter, things.machine),
)
_GOODS = things.one_of(things.pallet, _CARTON, _CARTON, things.drum, things.stack, things.clutter)
_YARD_THINGS = things.one_of(
    *(things.box, _CASE, _CASE, things.drum, things.machine, things.pallet, things.stack, things.cart),
    *(things.clutter, things.ball),
)
_YARD_SURVEYS = TripodSurveys(
    (40_000, 120_000), (3_000, 30_000), 2_000, hidden_by=0.04, highest=(5.0, 40.0), misregistration=(0.05, 0.3)
)
_TURNOVER = Turnover(appeared=4, disappeared=4)


def halls(random: np.random.Generator) -> SurveyedScene:
    """Halls of 15 to 35 m in which pallets, crates and carts come, go and move, scanned from one to three stations."""
    size = random.uniform([15.0, 8.0, 3.5], [35.0, 14.0, 6.0])
    floor = Support(np.eye(4), (float(size[0]), float(size[1])), gap=0.1)
    places = _station_places(random, floor)
    fixed = _building(random, size, floor)
    solids = staged(random, fixed, [floor], _HALL_THINGS, int(random.integers(5, 20)), _TURNOVER)
    return _HALL_SURVEYS.scene_from(random, solids, places)


def depots(random: np.random.Generator, surveys: TripodSurveys = _DEPOT_SURVEYS) -> SurveyedScene:
    """Halls of 15 to 40 m with racks, in which goods, cartons, pipes and boards come, go and move.

    A scanner sees through the racks, and slender things lie on the floor.
    """
    size = random.uniform([15.0, 8.0, 3.5], [40.0, 18.0, 8.0])
    floor = Support(np.eye(4), (float(size[0]), float(size[1])), gap=0.1)
    places = _station_places(random, floor)
    fixed = _building(random, size, floor)
    decks: list[Support] = []
    for _ in range(int(random.integers(1, 5))):
        rack_and_goods, shelves = _filled_rack(random, floor)
        fixed += rack_and_goods
        decks += shelves
    # As likely on the floor as in the racks.
    somewhere = [floor] * max(1, len(decks)) + decks
    solids = staged(random, fixed, somewhere, _DEPOT_THINGS, int(random.integers(8, 25)), _TURNOVER)
    return surveys.scene_from(random, solids, places)


def _station_places(random: np.random.Generator, floor: Support) -> Pair[list[Float[np.ndarray, "2"]]]:
    """Stations of the scanner in each survey: some are nearly the same in both, and no object stands on them."""
    spread = np.array(floor.size) * 0.35
    shared = [random.uniform(-spread, spread) for _ in range(int(random.integers(0, 3)))]
    own = Pair(*(int(random.integers(0 if shared else 1, 2)) for _ in range(2)))
    places = own.map(
        lambda count: [
            *(place + random.normal(0, random.choice([0.05, 0.5]), 2) for place in shared),
            *(random.uniform(-spread, spread) for _ in range(count)),
        ]
    )
    floor.taken.extend((place, 1.0) for side in places for place in side)
    return places


def _building(random: np.random.Generator, size: np.ndarray, floor: Support) -> list[Solid]:
    """Floor, walls with what stands out of them, pillars, trusses or a roof, and pipes along the walls."""
    x, y, z = size / 2 * [1, 1, 2]
    solids = [between((-x - 0.2, -y - 0.2, -0.2), (x + 0.2, y + 0.2, 0.0))]
    solids += [between((s * (x + 0.1) - 0.1, -y, 0), (s * (x + 0.1) + 0.1, y, z)) for s in (-1, 1)]
    solids += [between((-x, s * (y + 0.1) - 0.1, 0), (x, s * (y + 0.1) + 0.1, z)) for s in (-1, 1)]
    if chance(random, 0.6):
        solids.append(between((-x, -y, z), (x, y, z + 0.2)))
    wide, rows = random.uniform(0.25, 0.7), random.uniform(4.0, 8.0)
    for across in random.choice([-y, y, 0.0, y / 2], size=2, replace=False):
        for along in np.arange(-x + rows / 2, x, rows):
            column = pillar(wide, z, (along, across, 0.0))
            solids.append(column)
            floor.taken.append((np.array([along, across]), wide / 2))
    for _ in range(int(random.integers(2, 8))):
        thick, high = random.uniform(0.1, 0.5), random.uniform(0.4, 0.9) * z
        if chance(random, 0.5):
            across = random.uniform(-1, 1) * (y - thick)
            solids.append(between((-x, across - thick / 2, high), (x, across + thick / 2, high + thick)))
        else:
            along = random.uniform(-1, 1) * (x - thick)
            solids.append(between((along - thick / 2, -y, high), (along + thick / 2, y, high + thick)))
    for _ in range(int(random.integers(2, 8))):
        side, along = random.choice([-1.0, 1.0]), random.uniform(-0.9, 0.9) * x
        deep, long, high = random.uniform([0.1, 0.5, 0.5], [0.6, 3.0, 2.5])
        low = random.uniform(0.0, max(0.1, z - high - 1.0))
        faces = sorted((side * y, side * (y - deep)))
        solids.append(between((along - long / 2, faces[0], low), (along + long / 2, faces[1], low + high)))
        floor.taken.append((np.array([along, side * y]), max(deep, long / 2)))
    return solids


def _filled_rack(random: np.random.Generator, floor: Support) -> tuple[list[Solid], list[Support]]:
    """A rack on the floor with goods that stay, and its decks; nothing where there is no room for one."""
    levels = int(random.integers(1, 4))
    thing = things.rack(random, levels)
    pose = floor.pose(random, thing)
    if pose is None:
        return [], []
    solids = list(moved(thing, pose))
    headroom = float(thing[0].centre[2]) - 0.15
    decks = [top_of(deck, headroom) for deck in solids[:levels]]
    for deck in decks:
        for _ in range(int(random.integers(0, 5))):
            goods = _GOODS(random)
            there = deck.pose(random, goods)
            solids += moved(goods, there) if there is not None else ()
    return solids, decks


def yards(random: np.random.Generator) -> SurveyedScene:
    """Ground of 4 to 24 m with a wall or without, on which few things come, go and move; scanners stand all around."""
    half = random.uniform(2.0, 12.0, 2)
    ground = Support(np.eye(4), (float(1.8 * half[0]), float(1.8 * half[1])), gap=0.1)
    staying = int(random.choice([0, 1, 2, 4], p=[0.4, 0.25, 0.2, 0.15]))
    turnover = Turnover(appeared=2, disappeared=2, moved=1)
    solids = staged(random, _ground(random, half), [ground], _YARD_THINGS, staying, turnover)
    scanners = _YARD_SURVEYS.scanners(random)
    poses = Pair(_all_around(random, half), _all_around(random, half))
    return _YARD_SURVEYS.scene(random, solids, poses, scanners)


def _ground(random: np.random.Generator, half: np.ndarray) -> list[Solid]:
    """The ground, and now and then a wall or a fence behind it."""
    x, y = half
    solids = [between((-x, -y, -0.3), (x, y, 0.0))]
    for side in (-1, 1):
        if chance(random, 0.2):
            high = random.uniform(0.8, 4.0)
            solids.append(between((-x, side * y - 0.1, -0.3), (x, side * y + 0.1, high)))
    return solids


def _all_around(random: np.random.Generator, half: np.ndarray) -> Float[np.ndarray, "v 4 4"]:
    """Level poses about the ground, on tripods or masts that see the tops of things."""
    count = int(random.integers(3, 7))
    height = random.uniform(1.5, 5.0)
    angles = random.uniform(0, 2 * np.pi) + 2 * np.pi * (np.arange(count) + random.uniform(-0.2, 0.2, count)) / count
    places = 0.9 * half * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.stack([upright(np.array([*place, height]), random.uniform(0, 2 * np.pi)) for place in places])
