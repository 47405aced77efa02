"""Corridors that a walking robot's spinning lidar surveys, whose pose drifts on the way."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families import things
from gmmjax.scenes.families.staging import Support, Turnover, staged
from gmmjax.scenes.families.things import between, chance
from gmmjax.scenes.laser_scanner import Beam, SpinningLidar
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import PoseErrors, drawn_density
from gmmjax.scenes.rigid_motions import turned, upright
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

_THINGS = things.one_of(
    *(things.box, things.stack, things.bag, things.bin_, things.cart, things.cart, things.chair, things.clutter),
    *(things.drum, things.extinguisher, things.pallet, things.plant, things.shelves, things.suitcase),
)


def corridors(random: np.random.Generator) -> SurveyedScene:
    """Corridors of 15 to 40 m in which boxes, carts and the like come, go and move, by a lidar that drifts."""
    size = random.uniform([15.0, 1.8, 2.3], [40.0, 3.8, 3.2])
    # Along the walls things stand; the robot walks between.
    deep = random.uniform(0.35, 0.45) * size[1]
    strips = [
        Support(turned(0.0, (0.0, side * (size[1] - deep) / 2, 0.0)), (float(size[0]) - 1.0, float(deep)), overhang=0.3)
        for side in (-1.0, 1.0)
    ]
    solids = staged(random, _walls(random, size), strips, _THINGS, int(random.integers(3, 12)), Turnover(moved=1))
    lidars = _lidars(random)
    height = random.uniform(0.4, 1.6)
    paths = Pair(_path(random, size, height), _path(random, size, height))
    errors = Pair(_errors(random), _errors(random))
    recordings = each(
        lambda lidar, own, path, wrong: lidar.recording(own, path, random, wrong), lidars, solids, paths, errors
    )
    frame = Frame.drawn(random, shift=0.1, degrees=0.5)
    reduced = drawn_density(random, recordings, most=(28_000, 40_000), least=10_000, fused=0.9)
    noise = max(lidar.beam.noise for lidar in lidars)
    return surveyed_scene(solids, reduced, frame, hidden_by=max(0.06, 4 * noise))


def _lidars(random: np.random.Generator) -> Pair[SpinningLidar]:
    """The lidars of both surveys: one model, each with its own noise."""
    rings = int(random.choice([16, 32, 64], p=[0.5, 0.3, 0.2]))
    vertical, reach = random.uniform(30, 100), random.uniform(8, 30)
    lidars = []
    for _ in range(2):
        beam = Beam(random.uniform(0.004, 0.03), 0.0, 0.4, reach, random.uniform(0, 0.15), 0.2, random.uniform(0, 0.05))
        lidars.append(SpinningLidar(beam, rings, vertical, columns=int(6000 / rings * random.uniform(0.8, 1.4))))
    return Pair(*lidars)


def _errors(random: np.random.Generator) -> PoseErrors:
    drifts = chance(random, 0.8)
    jitter = random.uniform([0.0, 0.0], [0.01, 0.1])
    drift = drifts * random.uniform([0.0, 0.0], [0.12, 0.3])
    return PoseErrors(*map(float, (*jitter, *drift)))


def _path(random: np.random.Generator, size: np.ndarray, height: float) -> Float[np.ndarray, "v 4 4"]:
    """A walk along the survey's own part of the corridor, at least two thirds of it, now and then back."""
    share = random.uniform(0.65, 1.0)
    first = random.uniform(-0.48, 0.48 - 0.96 * share)
    stations = np.arange(first, first + 0.96 * share, random.uniform(0.8, 1.6) / size[0]) * size[0]
    if chance(random, 0.3):
        stations = stations[::-1]
    poses = []
    for x in stations:
        position = np.array([x, random.normal(0, 0.05 * size[1]), random.normal(height, 0.02)])
        poses.append(upright(position, random.normal(0, 0.1)))
    return np.stack(poses)


def _walls(random: np.random.Generator, size: np.ndarray) -> list[Solid]:
    """Floor, ceiling, ends, and two walls of pieces: doors set back or standing proud, niches, columns, pipes above."""
    x, y, z = size / 2 * [1, 1, 2]
    solids = [between((-x, -y - 1, -0.1), (x, y + 1, 0.0)), between((-x, -y - 1, z), (x, y + 1, z + 0.1))]
    solids += [between((side * (x + 0.05) - 0.05, -y - 1, 0), (side * (x + 0.05) + 0.05, y + 1, z)) for side in (-1, 1)]
    for side in (-1.0, 1.0):
        place = -x
        while place < x:
            wide = min(random.choice([random.uniform(1.0, 4.0), random.uniform(0.8, 1.2)]), x - place)
            back = random.choice([0.0, random.uniform(0.03, 0.3), random.uniform(-0.25, 0.0), random.uniform(0.3, 0.8)])
            faces = sorted((side * (y + back), side * (y + 1.0)))
            solids.append(between((place, faces[0], 0.0), (place + wide, faces[1], z)))
            place += wide
    for _ in range(int(random.integers(0, 4))):
        thick = random.uniform(0.08, 0.3)
        high, across = z - random.uniform(0.1, 0.5), random.uniform(-0.8, 0.8) * y
        solids.append(between((-x, across - thick / 2, high - thick / 2), (x, across + thick / 2, high + thick / 2)))
    return solids
