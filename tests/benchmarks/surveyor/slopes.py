"""Rock slopes with vegetation, scanned from their foot: boulders fall, debris is left, rock is eroded."""

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
from tests.benchmarks.surveyor.solids import Thing, ellipsoid, pole
from tests.benchmarks.surveyor.stages import Stage
from tests.benchmarks.surveyor.surveys import Site, Station
from tests.benchmarks.surveyor.terrain import Terrain


def slope_site(random: np.random.Generator, changed: bool) -> Site:
    """A slope whose foot is along x and that rises along y."""
    width = random.uniform(50, 200)
    before = _terrain(width, random)
    stage, stations = Stage(changed), _stations(before, width, random)
    places = Places(before, width, stations.before)
    _boulders(before, places, stage, random)
    patches = _patches(before, places, stage, random)
    _vegetation(before, places, stage, random)
    lowered, after = changed_terrain(before, patches, random) if changed else (None, before)
    worlds = Pair(World(stage.things.before, before), World(stage.things.after, after))
    beam = Beam(noise=0.004, doubling=120.0, max_range=600.0, lost=0.02)
    return Site(worlds, stations, beam, lowered, slack=0.06, least_distance=0.03)


def _terrain(width: float, random: np.random.Generator) -> Terrain:
    """Rough at scales from a tenth of its width to a quarter of a metre; its foot is flatter."""
    cell = max(0.1, width / 1000)
    depth = random.uniform(0.5, 0.8) * width
    shape = (int(width / cell) + 1, int(depth / cell) + 1)
    y = cell * np.arange(shape[1])
    foot, steep = 0.12 * depth, np.tan(np.radians(random.uniform(38, 58)))
    rise = 0.1 * np.minimum(y, foot) + steep * np.logaddexp(0, (y - foot) / 2) * 2
    heights = np.broadcast_to(rise, shape).copy()
    for scale, amplitude in ((width / 8, width / 60), (width / 25, width / 220), (2.5, 0.22), (0.9, 0.07), (0.3, 0.02)):
        heights += amplitude * roughness(shape, scale / cell, random)
    return Terrain(heights, np.array([-width / 2, 0.0]), cell)


def _boulders(terrain: Terrain, places: Places, stage: Stage, random: np.random.Generator) -> None:
    """Many that stay; one or two that fall, one of which may be found below."""
    for _ in range(int(random.integers(8, 16))):
        size = random.uniform(0.5, 3.0)
        stage.stays(_boulder(terrain, places.take(size, random), size, random))
    for _ in range(int(random.integers(1, 3))):
        size = random.uniform(0.5, 3.0)
        stage.goes(_boulder(terrain, places.take(size + 1, random), size, random))
    if random.random() < 0.4:
        size = random.uniform(0.7, 2.0)
        stage.comes(_boulder(terrain, places.take(size + 1, random), size, random))


def _boulder(terrain: Terrain, place: np.ndarray, size: float, random: np.random.Generator) -> Thing:
    """Three lumps in the rock, of this width together."""
    at = on_terrain(terrain, place) + 0.15 * size * terrain.normals(place[None])[0]
    lumps = []
    for _ in range(3):
        half = size / 2 * random.uniform(0.55, 0.85, 3)
        axes = Rotation.random(random_state=random.integers(2**31)).as_matrix()
        lumps.append(ellipsoid(half, at + 0.15 * size * random.uniform(-1, 1, 3), axes))
    return Thing(tuple(lumps))


def _vegetation(terrain: Terrain, places: Places, stage: Stage, random: np.random.Generator) -> None:
    """Bushes and some trees, whose leaves are others each time, and which have grown a little."""
    for number in range(int(random.integers(25, 60))):
        tree = number % 6 == 0
        half = random.uniform((0.3, 0.3, 0.25), (1.2, 1.2, 0.9)) * (1.8 if tree else 1.0)
        place = bare_place(terrain, places, float(half.max()), random)
        base = on_terrain(terrain, place)
        crown = base + np.array([0, 0, 2.2 * half[2] if tree else 0.4 * half[2]])
        for side in stage.things:
            grown = half * random.uniform(1.0, 1.06)
            side.append(Thing((ellipsoid(grown, crown),), free_path=random.uniform(0.25, 0.5)))
        if tree:
            stage.stays(Thing((pole(random.uniform(0.06, 0.15), 2.2 * half[2], base - np.array([0, 0, 0.2])),)))


def _patches(terrain: Terrain, places: Places, stage: Stage, random: np.random.Generator) -> list[Patch]:
    """A deposit and some places where rock is eroded."""
    extent = float(terrain.cell * (np.array(terrain.heights.shape) - 1).min())
    depths = [0.3, *-random.uniform(0.05, 0.2, int(random.integers(1, 4)))]
    patches = []
    for depth in depths:
        half = random.uniform(1.5, 3.5, 2) * np.sqrt(np.clip(extent / 60, 0.8, 1.5))
        place = places.take(1.4 * float(half.max()), random)
        patches.append(Patch(stage.next_number(), place, half, float(depth)))
    return patches


def _stations(terrain: Terrain, width: float, random: np.random.Generator) -> Pair[list[Station]]:
    """One or two before the foot, after near them."""
    count, away = int(random.integers(1, 3)), float(np.clip(random.uniform(0.4, 0.9) * width, 30, 150))
    spread = 0.25 * width if count == 2 else 0.0
    sides: Pair[list[Station]] = Pair([], [])
    for number in range(count):
        x = (2 * number - 1) * spread + random.normal(0, 0.05 * width)
        for side in sides:
            at = np.array([x, -away, 1.7]) + random.normal(0, 1, 3) * (1.5, 1.5, 0.3)
            side.append(station_towards(terrain, at))
    return sides
