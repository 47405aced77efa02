"""Kinds of held-out scenes outdoors: a block of a town from an aeroplane, and a street from a car."""

import itertools

import numpy as np

from gmmjax.pair import Pair
from tests.benchmarks.held_out import meshes
from tests.benchmarks.held_out.interiors import Ground
from tests.benchmarks.held_out.sensors import camera, looking, scanner
from tests.benchmarks.held_out.surveys import Rig, Stage, Staged, motion_about, rig_of, shaken


def airborne(random: np.random.Generator, changed: bool) -> Staged:
    """A block of 60 m, scanned in strips from 70 m above."""
    stage = _block(random, changed, half=30.0)
    sensor = camera(56, 34, 48.0, 140.0, (0.03,), mixed=0.02, edge_lost=0.05, lost=0.05, grazing=0.05)

    def rig(strips: int) -> Rig:
        poses = []
        for y in np.linspace(-22, 22, strips) + random.uniform(-2, 2, strips):
            for x in np.linspace(-27, 27, 12) + random.uniform(-2, 2, 12):
                at = np.array([x, y, 70 + random.normal(0, 1)])
                poses.append(
                    looking(
                        at, at + np.array([random.normal(0, 1.0), random.normal(0, 1.0), -70]), random.uniform(0, 360)
                    )
                )
        return rig_of(sensor, poses, random, off=(0.02, 0.01), thinned=0.28)

    motion = motion_about(random, random.uniform(0.05, 0.15), random.uniform(0, 0.05))
    return Staged(stage, Pair(3, 3).map(rig), motion, slack=0.4)


def street(random: np.random.Generator, changed: bool) -> Staged:
    """A street that a car with a spinning lidar drives along."""
    stage = _block(random, changed, half=18.0, parked=True)
    sensor = scanner(500, np.linspace(-24, 14, 16), 45.0, (0.018,), slanted=0.1, mixed=0.03, grazing=0.03, lost=0.05)

    def rig(_: object) -> Rig:
        poses = []
        for x in np.linspace(-15, 15, 8) + random.normal(0, 0.5, 8):
            at = np.array([x, random.normal(-0.5, 0.15), 1.9 + _rise(x, 0.0)])
            poses.append(shaken(looking(at, at + np.array([1, 0, 0])), random, 0.0, 0.5))
        return rig_of(sensor, poses, random, off=(0.01, 0.04), thinned=0.06)

    motion = motion_about(random, random.uniform(0.02, 0.06), random.uniform(0, 0.15))
    return Staged(stage, stage.worlds.map(rig), motion, slack=0.12)


def _rise(x: float | np.ndarray, y: float | np.ndarray) -> np.ndarray:
    """The height of the ground."""
    return np.asarray(0.25 * np.sin(x / 11.0) + 0.2 * np.cos(y / 9.0) - 0.2)


def _block(random: np.random.Generator, changed: bool, *, half: float, parked: bool = False) -> Stage:
    """Ground that rises and falls, a street along x, houses and trees on both sides, parked cars and containers."""
    u, stage = random.uniform, Stage()
    steps = np.linspace(-half - 12, half + 12, 9)
    for x0, x1 in itertools.pairwise(steps):
        for y0, y1 in itertools.pairwise(steps):
            x, y = np.meshgrid(np.linspace(x0, x1, 4), np.linspace(y0, y1, 4))
            stage.stays(meshes.lattice(np.stack([x, y, _rise(x, y)], axis=2)))
    sides = [Ground((0, s * (half / 2 + 4.5), 0), 2 * half - 2, half - 5) for s in (-1, 1)]
    for side in sides:
        for _ in range(int(half / 5.5)):
            width, depth, eaves = u(7, 11), u(6, 9), u(3, 6.5)
            ridge = eaves + (u(1.5, 3) if random.random() < 0.7 else 0.05)
            own = meshes.turned(meshes.house(width, depth, eaves + 0.6, ridge + 0.6), 90 * float(random.integers(2)))
            stage.stays(_on_ground(own, side.take(0.45 * (width + depth), random), 0.0, sink=0.6))
        for _ in range(3):
            own = meshes.tree(u(1.3, 2.2), u(4, 7), random)
            stage.stays(_on_ground(own, side.take(1.5, random), u(0, 360)))
    kerbs = [Ground((0, y, 0), 2 * half - 6, 2.0) for y in ((-3.4, 2.6) if parked else (-3.2, 3.2))]
    lots = kerbs if parked else [*kerbs, *sides]
    for _ in range(5):
        stage.stays(_vehicle(random, kerbs))
    for fate in ("comes", "goes", "moves")[: int(random.integers(1, 4))]:
        if not changed:
            stage.stays(_vehicle(random, lots))
        elif fate == "moves":
            shape = int(random.integers(2**31))
            stage.moves(*(_vehicle(random, lots, np.random.default_rng(shape)) for _ in range(2)))
        else:
            getattr(stage, fate)(_vehicle(random, lots))
    return stage


def _vehicle(random: np.random.Generator, lots: list[Ground], shape: np.random.Generator | None = None) -> np.ndarray:
    """A car, a van or a container, along the street."""
    u = (shape or random).uniform
    kind = u(0, 1)
    if kind < 0.5:
        own = meshes.car(u(3.9, 4.7), u(1.7, 1.85), u(1.4, 1.6))
    elif kind < 0.75:
        own = meshes.car(u(5, 6), u(1.9, 2.1), u(2.1, 2.5))
    else:
        own = meshes.box(u(3, 6), u(2, 2.4), u(1.4, 2.5))
    return _on_ground(own, lots[int(random.integers(len(lots)))].take(2.6, random), 180 * float(random.integers(2)))


def _on_ground(own: np.ndarray, at: np.ndarray, degrees: float, sink: float = 0.0) -> np.ndarray:
    return meshes.placed(own, (at[0], at[1], float(_rise(at[0], at[1])) - sink), degrees)
