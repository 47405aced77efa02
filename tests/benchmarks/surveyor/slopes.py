"""Rock slopes with vegetation, scanned from their foot: boulders fall, debris is left, rock is eroded."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter, zoom
from scipy.spatial.transform import Rotation

from gmmjax.pair import Pair
from tests.benchmarks.surveyor.scanning import Beam, World
from tests.benchmarks.surveyor.solids import UNCHANGED, Thing, ellipsoid, pole
from tests.benchmarks.surveyor.stages import Stage
from tests.benchmarks.surveyor.surveys import Lowered, Site, Station
from tests.benchmarks.surveyor.terrain import Terrain


def slope_site(random: np.random.Generator, changed: bool) -> Site:
    """A slope whose foot is along x and that rises along y."""
    width = random.uniform(50, 200)
    before = _terrain(width, random)
    stage, stations = Stage(changed), _stations(before, width, random)
    places = _Places(before, width, stations.before)
    _boulders(before, places, stage, random)
    patches = _patches(before, places, stage, random)
    _vegetation(before, places, stage, random)
    lowered, after = _changed_terrain(before, patches, random) if changed else (None, before)
    worlds = Pair(World(stage.things.before, before), World(stage.things.after, after))
    beam = Beam(noise=0.004, doubling=120.0, max_range=600.0, lost=0.02)
    return Site(worlds, stations, beam, lowered, slack=0.06, least_distance=0.03)


class _Places:
    """Where something is to change: apart from each other, on rock that the scanners can see."""

    def __init__(self, terrain: Terrain, width: float, stations: Sequence[Station]) -> None:
        self._terrain, self._stations = terrain, stations
        extent = terrain.cell * (np.array(terrain.heights.shape) - 1)
        self._low, self._high = terrain.lower + 0.08 * width, terrain.lower + extent - 0.08 * width
        self._taken: list[tuple[np.ndarray, float]] = []

    def take(self, radius: float, random: np.random.Generator) -> np.ndarray:
        for attempt in range(2000):
            place = random.uniform(self._low, self._high)
            if self.free(place, radius * 0.95 ** (attempt // 100)) and self._in_view(place, radius / 2):
                break
        self._taken.append((place, radius))
        return np.asarray(place)

    def free(self, place: np.ndarray, radius: float) -> bool:
        return all(np.linalg.norm(place - at) > radius + own for at, own in self._taken)

    def _in_view(self, place: np.ndarray, radius: float) -> bool:
        """Whether a station sees nine tenths of what is about the place."""
        steps = radius * np.linspace(-1, 1, 5)
        around = place + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        places = np.column_stack([around, self._terrain.at(around)])
        return any(self._terrain.sees(own.position, places, 0.1).mean() > 0.9 for own in self._stations)


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


def roughness(shape: tuple[int, int], scale: float, random: np.random.Generator) -> np.ndarray:
    """A smooth random field of unit deviation whose bumps are about so many cells wide."""
    factor = max(scale / 6, 1.0)
    coarse = tuple(int(np.ceil(side / factor)) + 2 for side in shape)
    field = gaussian_filter(random.standard_normal(coarse), scale / factor / 2, mode="reflect")
    field = zoom(field, [(own + 1) / there for own, there in zip(shape, coarse, strict=True)], order=1)
    return np.asarray(field[: shape[0], : shape[1]] / field.std())


def _on(terrain: Terrain, place: np.ndarray) -> np.ndarray:
    return np.append(place, terrain.at(place[None])[0])


def _boulders(terrain: Terrain, places: _Places, stage: Stage, random: np.random.Generator) -> None:
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
    at = _on(terrain, place) + 0.15 * size * terrain.normals(place[None])[0]
    lumps = []
    for _ in range(3):
        half = size / 2 * random.uniform(0.55, 0.85, 3)
        axes = Rotation.random(random_state=random.integers(2**31)).as_matrix()
        lumps.append(ellipsoid(half, at + 0.15 * size * random.uniform(-1, 1, 3), axes))
    return Thing(tuple(lumps))


def _vegetation(terrain: Terrain, places: _Places, stage: Stage, random: np.random.Generator) -> None:
    """Bushes and some trees, whose leaves are others each time, and which have grown a little."""
    for number in range(int(random.integers(25, 60))):
        tree = number % 6 == 0
        half = random.uniform((0.3, 0.3, 0.25), (1.2, 1.2, 0.9)) * (1.8 if tree else 1.0)
        place = _bare(terrain, places, float(half.max()), random)
        base = _on(terrain, place)
        crown = base + np.array([0, 0, 2.2 * half[2] if tree else 0.4 * half[2]])
        for side in stage.things:
            grown = half * random.uniform(1.0, 1.06)
            side.append(Thing((ellipsoid(grown, crown),), free_path=random.uniform(0.25, 0.5)))
        if tree:
            stage.stays(Thing((pole(random.uniform(0.06, 0.15), 2.2 * half[2], base - np.array([0, 0, 0.2])),)))


def _bare(terrain: Terrain, places: _Places, radius: float, random: np.random.Generator) -> np.ndarray:
    """A place that leaves what changes free, at two metres at least."""
    extent = terrain.cell * (np.array(terrain.heights.shape) - 1)
    for _ in range(500):
        place = terrain.lower + random.uniform(0.02, 0.98, 2) * extent
        if places.free(place, radius + 2.0):
            break
    return np.asarray(place)


def _patches(
    terrain: Terrain, places: _Places, stage: Stage, random: np.random.Generator
) -> list[tuple[int, np.ndarray, np.ndarray, float]]:
    """Where the surface is to change: number, place, half widths, and depth along the normal (positive: deposit)."""
    extent = float(terrain.cell * (np.array(terrain.heights.shape) - 1).min())
    depths = [0.3, *-random.uniform(0.05, 0.2, int(random.integers(1, 4)))]
    patches = []
    for depth in depths:
        half = random.uniform(1.5, 3.5, 2) * np.sqrt(np.clip(extent / 60, 0.8, 1.5))
        place = places.take(1.4 * float(half.max()), random)
        patches.append((stage.next_number(), place, half, float(depth)))
    return patches


def _changed_terrain(
    terrain: Terrain, patches: list[tuple[int, np.ndarray, np.ndarray, float]], random: np.random.Generator
) -> tuple[Lowered, Terrain]:
    heights = terrain.heights.copy()
    numbers = np.full(heights.shape, UNCHANGED)
    nodes = np.stack(np.meshgrid(*(np.arange(side) for side in heights.shape), indexing="ij"), axis=-1)
    xy = terrain.lower + terrain.cell * nodes
    for number, place, half, depth in patches:
        wave = 0.12 * roughness(heights.shape, 0.5 * float(half.mean()) / terrain.cell, random)
        reach = np.linalg.norm((xy - place) / half, axis=2) + wave
        profile = np.clip((1.0 - reach) / 0.25, 0, 1)
        profile = profile * profile * (3 - 2 * profile)
        # Fresh rock and debris are rough in their own way.
        coarse = 0.12 * abs(depth) * roughness(heights.shape, 0.5 / terrain.cell, random)
        upright = float(_mean_upright(terrain, place, half))
        heights += profile * (depth + coarse) / upright
        numbers[profile > 0] = number
    return Lowered(numbers, {number: abs(depth) for number, _, _, depth in patches}), Terrain(
        heights, terrain.lower, terrain.cell
    )


def _mean_upright(terrain: Terrain, place: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The cosine between the vertical and the normal of the plane through a patch."""
    ends = [terrain.at(np.stack([place - step, place + step])) for step in np.diag(half)]
    rise = [np.diff(own)[0] / (2 * width) for own, width in zip(ends, half, strict=True)]
    return np.asarray(1 / np.sqrt(1 + rise[0] ** 2 + rise[1] ** 2))


def _stations(terrain: Terrain, width: float, random: np.random.Generator) -> Pair[list[Station]]:
    """One or two before the foot, after near them."""
    count, away = int(random.integers(1, 3)), float(np.clip(random.uniform(0.4, 0.9) * width, 30, 150))
    spread = 0.25 * width if count == 2 else 0.0
    sides: Pair[list[Station]] = Pair([], [])
    for number in range(count):
        x = (2 * number - 1) * spread + random.normal(0, 0.05 * width)
        for side in sides:
            at = np.array([x, -away, 1.7]) + random.normal(0, 1, 3) * (1.5, 1.5, 0.3)
            side.append(_towards(terrain, at))
    return sides


def _towards(terrain: Terrain, at: np.ndarray) -> Station:
    """A station whose field of view just holds the slope."""
    shape = np.array(terrain.heights.shape)
    x, y = (terrain.lower[axis] + terrain.cell * np.array([0, shape[axis] - 1]) for axis in (0, 1))
    corners = np.array([(a, b) for a in x for b in y]) - at[:2]
    azimuths = np.arctan2(corners[:, 1], corners[:, 0])
    top = np.degrees(np.arctan2(terrain.heights.max() + 4 - at[2], y[0] - at[1] + 0.3 * (y[1] - y[0])))
    return Station(at, (azimuths.min() + 1e-3, azimuths.max() - 1e-3), (np.radians(-15), np.radians(min(top, 80))))
