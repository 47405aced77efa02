"""Open ground with few things that are surveyed from all around: a bare plane, and what stands on it."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families import things
from gmmjax.scenes.families.scanners import TripodSurveys
from gmmjax.scenes.families.staging import Support, Turnover, staged
from gmmjax.scenes.families.things import between, chance
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.rigid_motions import upright
from gmmjax.scenes.surveyed_scene import SurveyedScene

_CRATE = things.boxes(0.3, 1.8)
_THINGS = things.one_of(
    *(things.box, _CRATE, _CRATE, things.drum, things.machine, things.pallet, things.stack, things.cart),
    *(things.clutter, things.ball),
)
_SURVEYS = TripodSurveys(
    (40_000, 120_000), (3_000, 30_000), 2_000, hidden_by=0.04, highest=(5.0, 40.0), misregistration=(0.05, 0.3)
)


def yards(random: np.random.Generator) -> SurveyedScene:
    """Ground of 4 to 24 m with a wall or without, on which few things come, go and move; scanners stand all around."""
    half = random.uniform(2.0, 12.0, 2)
    ground = Support(np.eye(4), (float(1.8 * half[0]), float(1.8 * half[1])), gap=0.1)
    staying = int(random.choice([0, 1, 2, 4], p=[0.4, 0.25, 0.2, 0.15]))
    turnover = Turnover(appeared=2, disappeared=2, moved=1)
    solids = staged(random, _ground(random, half), [ground], _THINGS, staying, turnover)
    scanners = _SURVEYS.scanners(random)
    poses = Pair(_all_around(random, half), _all_around(random, half))
    return _SURVEYS.scene(random, solids, poses, scanners)


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
