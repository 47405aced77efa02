"""Depots: halls with racks full of goods, which a scanner sees through, and with slender things on the floor."""

import numpy as np

from gmmjax.scenes.families.halls import building, station_places
from gmmjax.scenes.families.staging import Support, Turnover, staged, top_of
from gmmjax.scenes.families.things import (
    box,
    clutter,
    drum,
    machine,
    moved,
    one_of,
    pallet,
    rack,
    rod,
    stack,
)
from gmmjax.scenes.families.tripods import TripodSurveys, scene_from_tripods
from gmmjax.scenes.objects import StandingObject
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.surveyed_scene import SurveyedScene


def depots(
    random: np.random.Generator,
    surveys: TripodSurveys = TripodSurveys(
        (250_000, 1_000_000), (30_000, 200_000), 15_000, hidden_by=0.06, highest=(30.0, 80.0), fused=0.4
    ),
) -> SurveyedScene:
    """Halls of 15 to 40 m with racks, in which goods, cartons, pipes and boards come, go and move.

    Args:
        random: of everything.
        surveys: how they are surveyed.
    """
    size = random.uniform([15.0, 8.0, 3.5], [40.0, 18.0, 8.0])
    floor = Support(np.eye(4), (float(size[0]), float(size[1])), gap=0.1)
    places = station_places(random, floor)
    fixed = building(random, size, floor)
    decks: list[Support] = []
    for _ in range(int(random.integers(1, 5))):
        rack_and_goods, shelves = _filled_rack(random, floor)
        fixed += rack_and_goods
        decks += shelves
    things = one_of(pallet, pallet, _carton, _carton, rod, rod, drum, stack, clutter, machine)
    # As likely on the floor as in the racks.
    somewhere = [floor] * max(1, len(decks)) + decks
    solids = staged(random, fixed, somewhere, things, int(random.integers(8, 25)), Turnover(appeared=4, disappeared=4))
    return scene_from_tripods(random, solids, places, surveys)


def _filled_rack(random: np.random.Generator, floor: Support) -> tuple[list[Solid], list[Support]]:
    """A rack on the floor with goods that stay, and its decks; nothing where there is no room for one."""
    levels = int(random.integers(1, 4))
    thing = rack(random, levels)
    pose = floor.pose(random, thing)
    if pose is None:
        return [], []
    solids = list(moved(thing, pose))
    headroom = float(thing[0].centre[2]) - 0.15
    decks = [top_of(deck, headroom) for deck in solids[:levels]]
    for deck in decks:
        for _ in range(int(random.integers(0, 5))):
            goods = one_of(pallet, _carton, _carton, drum, stack, clutter)(random)
            there = deck.pose(random, goods)
            solids += moved(goods, there) if there is not None else ()
    return solids, decks


def _carton(random: np.random.Generator) -> StandingObject:
    return box(random, 0.2, 1.0)
