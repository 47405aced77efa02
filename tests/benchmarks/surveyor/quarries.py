"""Quarries that are scanned across the pit: benches and faces, blocks, channels and heaps; unlike slopes throughout."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.pair import Pair
from tests.benchmarks.surveyor.ground import (
    Patch,
    Places,
    bare_place,
    changed_terrain,
    on_terrain,
    roughness,
    station_towards,
)
from tests.benchmarks.surveyor.scanning import Beam, World
from tests.benchmarks.surveyor.solids import Thing, box, ellipsoid, pole
from tests.benchmarks.surveyor.stages import Stage
from tests.benchmarks.surveyor.surveys import Site, Station
from tests.benchmarks.surveyor.terrain import Terrain


def quarry_site(random: np.random.Generator, changed: bool) -> Site:
    """Benches that rise along y, scanned from a near and a far station, after from others."""
    width = random.uniform(50, 140)
    before = _benches(width, random)
    stage = Stage(changed)
    stations = Pair(*(_stations(before, width, random) for _ in range(2)))
    places = Places(before, width, stations.before)
    for fate in ["stays"] * int(random.integers(6, 12)) + ["goes", "goes", "comes"][: int(random.integers(1, 4))]:
        size = random.uniform(0.6, 2.6)
        getattr(stage, fate)(_block(before, places.take(size + 0.5, random), size, random))
    patches = [_patch(places, stage, random, heap=number == 0) for number in range(int(random.integers(2, 5)))]
    _plants(before, places, stage, random)
    lowered, after = changed_terrain(before, patches, random, _cone) if changed else (None, before)
    worlds = Pair(World(stage.things.before, before), World(stage.things.after, after))
    beam = Beam(noise=0.005, doubling=200.0, slanted=0.25, mixed=0.25, lost=0.04, max_range=400.0)
    return Site(worlds, stations, beam, lowered, slack=0.06, least_distance=0.03)


def _benches(width: float, random: np.random.Generator) -> Terrain:
    """Steps of 4 to 8 m whose edges meander, with faces of broken blocks."""
    cell = max(0.1, width / 900)
    depth = random.uniform(0.45, 0.65) * width
    shape = (int(width / cell) + 1, int(depth / cell) + 1)
    x, y = (cell * np.arange(side) for side in shape)
    step, level = random.uniform(4, 8), random.uniform(7, 12)
    heights = np.zeros(shape)
    for number in range(int(depth / level)):
        edge = (number + 0.5) * level + 2 * np.sin(x / random.uniform(8, 20) + random.uniform(0, 6))
        across = (y[None] - edge[:, None]) / random.uniform(1.5, 3.0)
        heights += step / (1 + np.exp(-np.clip(3.2 * across, -30, 30)))
    broken = np.round(2 * roughness(shape, 1.6 / cell, random)) / 2
    steep = np.hypot(*np.gradient(heights, cell))
    heights += 0.18 * broken * np.minimum(steep, 1.5)
    for scale, amplitude in ((width / 5, width / 90), (6.0, 0.25), (1.5, 0.06), (0.4, 0.02)):
        heights += amplitude * roughness(shape, scale / cell, random)
    return Terrain(heights, np.array([-width / 2, 0.0]), cell)


def _stations(terrain: Terrain, width: float, random: np.random.Generator) -> list[Station]:
    """One at the foot and one across the pit, higher up."""
    near = np.array([random.uniform(-0.3, 0.3) * width, -max(30.0, 0.3 * width), random.uniform(2, 4)])
    far = np.array([random.uniform(-0.3, 0.3) * width, -random.uniform(0.7, 1.1) * width - 20, random.uniform(8, 15)])
    chosen = [near, far][: int(random.integers(1, 3))] if random.random() < 0.7 else [far]
    return [station_towards(terrain, at) for at in chosen]


def _block(terrain: Terrain, place: np.ndarray, size: float, random: np.random.Generator) -> Thing:
    """A broken block: a box, and a smaller one through it."""
    turns = Rotation.random(2, random_state=random.integers(2**31)).as_matrix()
    at = on_terrain(terrain, place) + 0.2 * size * terrain.normals(place[None])[0]
    sides = size * random.uniform(0.5, 0.8, (2, 3)) * np.array([[1.0], [0.8]])
    return Thing(
        tuple(
            box(*own, (0, 0, -own[2] / 2)).moved(turn, at + 0.1 * size * random.uniform(-1, 1, 3))
            for own, turn in zip(sides, turns, strict=True)
        )
    )


def _patch(places: Places, stage: Stage, random: np.random.Generator, *, heap: bool) -> Patch:
    """A heap of debris, or a channel that water has washed out along the slope."""
    if heap:
        half, depth = np.full(2, random.uniform(1.8, 3.5)), random.uniform(0.3, 0.6)
    else:
        half, depth = random.uniform((1.0, 2.5), (1.8, 4.0)), -random.uniform(0.06, 0.2)
    return Patch(stage.next_number(), places.take(1.3 * float(half.max()), random), half, float(depth))


def _cone(reach: np.ndarray) -> np.ndarray:
    """Deepest in the middle, and round there."""
    share = np.clip(1.0 - reach, 0, 1)
    return np.asarray(1 - (1 - share) ** 3)


def _plants(terrain: Terrain, places: Places, stage: Stage, random: np.random.Generator) -> None:
    """Tufts of several clumps, and conifers."""
    for number in range(int(random.integers(15, 35))):
        at = on_terrain(terrain, bare_place(terrain, places, 1.2, random))
        if number % 4 == 0:
            height = random.uniform(2, 5)
            stage.stays(Thing((pole(0.08, height, at),)))
            clumps = [(np.array([0.22, 0.22, 0.4]) * height, at + np.array([0, 0, 0.62 * height]))]
        else:
            clumps = [
                (random.uniform(0.12, 0.4, 3), at + random.uniform((-0.6, -0.6, 0), (0.6, 0.6, 0.25))) for _ in range(5)
            ]
        for side in stage.things:
            bodies = tuple(ellipsoid(half * random.uniform(0.95, 1.05), place) for half, place in clumps)
            side.append(Thing(bodies, free_path=random.uniform(0.1, 0.4)))
