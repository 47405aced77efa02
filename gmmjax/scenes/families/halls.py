"""Halls with pillars, machines and goods that a terrestrial scanner surveys from few stations."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families.interior import between
from gmmjax.scenes.families.staging import Support, Turnover, staged
from gmmjax.scenes.families.things import (
    box,
    cart,
    clutter,
    cupboard,
    drum,
    machine,
    one_of,
    pallet,
    pillar,
    shelves,
    stack,
    table,
    tripod,
)
from gmmjax.scenes.families.tripods import TripodSurveys, scene_from_tripods
from gmmjax.scenes.objects import StandingObject
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.surveyed_scene import SurveyedScene


def halls(random: np.random.Generator) -> SurveyedScene:
    """Halls of 15 to 35 m in which pallets, crates and carts come, go and move, scanned from one to three stations."""
    size = random.uniform([15.0, 8.0, 3.5], [35.0, 14.0, 6.0])
    floor = Support(np.eye(4), (float(size[0]), float(size[1])), gap=0.1)
    places = station_places(random, floor)
    fixed = building(random, size, floor)
    things = one_of(
        pallet, pallet, _crate, _crate, cart, stack, drum, machine, clutter, shelves, table, cupboard, tripod
    )
    solids = staged(random, fixed, [floor], things, int(random.integers(5, 20)), Turnover(appeared=4, disappeared=4))
    rays, most = (140_000, 1_000_000), (30_000, 250_000)
    surveys = TripodSurveys(rays, most, 12_000, hidden_by=0.06, highest=(15.0, 70.0), fused=0.5)
    return scene_from_tripods(random, solids, places, surveys)


def station_places(random: np.random.Generator, floor: Support) -> Pair[list[Float[np.ndarray, "2"]]]:
    """Where the scanner stands in either survey: some stations are shared, nearly; nothing stands in their way."""
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


def building(random: np.random.Generator, size: np.ndarray, floor: Support) -> list[Solid]:
    """Floor, walls with what stands out of them, pillars, trusses or a roof, and pipes along the walls."""
    x, y, z = size / 2 * [1, 1, 2]
    solids = [between((-x - 0.2, -y - 0.2, -0.2), (x + 0.2, y + 0.2, 0.0))]
    solids += [between((s * (x + 0.1) - 0.1, -y, 0), (s * (x + 0.1) + 0.1, y, z)) for s in (-1, 1)]
    solids += [between((-x, s * (y + 0.1) - 0.1, 0), (x, s * (y + 0.1) + 0.1, z)) for s in (-1, 1)]
    if random.random() < 0.6:
        solids.append(between((-x, -y, z), (x, y, z + 0.2)))
    wide, rows = random.uniform(0.25, 0.7), random.uniform(4.0, 8.0)
    for across in random.choice([-y, y, 0.0, y / 2], size=2, replace=False):
        for along in np.arange(-x + rows / 2, x, rows):
            column = pillar(wide, z, (along, across, 0.0))
            solids.append(column)
            floor.taken.append((np.array([along, across]), wide / 2))
    for _ in range(int(random.integers(2, 8))):
        thick, high = random.uniform(0.1, 0.5), random.uniform(0.4, 0.9) * z
        if random.random() < 0.5:
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


def _crate(random: np.random.Generator) -> StandingObject:
    return box(random, 0.8, 2.2)
