"""Open ground with few things that are surveyed from all around: a bare plane, and what stands on it."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families.density import drawn_density
from gmmjax.scenes.families.interior import between
from gmmjax.scenes.families.staging import Support, Turnover, staged
from gmmjax.scenes.families.things import ball, box, cart, clutter, drum, machine, one_of, pallet, stack
from gmmjax.scenes.families.tripods import drawn_scanners, scanned
from gmmjax.scenes.objects import StandingObject
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.rigid_motions import upright
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


def yards(random: np.random.Generator) -> SurveyedScene:
    """Ground of 4 to 24 m with a wall or without, on which few things come, go and move; scanners stand all around.

    Args:
        random: of everything.
    """
    half = random.uniform(2.0, 12.0, 2)
    ground = Support(np.eye(4), (float(1.8 * half[0]), float(1.8 * half[1])), gap=0.1)
    things = one_of(box, _crate, _crate, drum, machine, pallet, stack, cart, clutter, ball)
    staying = int(random.choice([0, 1, 2, 4], p=[0.4, 0.25, 0.2, 0.15]))
    turnover = Turnover(appeared=2, disappeared=2, moved=1)
    solids = staged(random, _ground(random, half), [ground], things, staying, turnover)
    scanners = drawn_scanners(random, rays=(40_000, 120_000), highest=(5.0, 40.0))
    recordings = scanned(random, solids, Pair(*(_all_around(random, half) for _ in range(2))), scanners)
    recordings = drawn_density(random, recordings, most=(3_000, 30_000), least=2_000)
    return surveyed_scene(solids, recordings, Frame.drawn(random, shift=0.05, degrees=0.3), hidden_by=0.04)


def _ground(random: np.random.Generator, half: np.ndarray) -> list[Solid]:
    """The ground, and now and then a wall or a fence behind it."""
    x, y = half
    solids = [between((-x, -y, -0.3), (x, y, 0.0))]
    for side in (-1, 1):
        if random.random() < 0.2:
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


def _crate(random: np.random.Generator) -> StandingObject:
    return box(random, 0.3, 1.8)
