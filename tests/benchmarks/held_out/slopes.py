"""Rock slopes with vegetation, scanned from their foot: boulders fall, debris is left, rock is eroded."""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, zoom
from scipy.spatial.transform import Rotation

from gmmjax.pair import Pair
from tests.benchmarks.held_out.casting import RIM, Foliage, Terrain, first_hits
from tests.benchmarks.held_out.meshes import cylinder, ellipsoid, joined, shifted
from tests.benchmarks.held_out.sensors import looking, tripod
from tests.benchmarks.held_out.surveys import Rig, Stage, Staged, motion_about, rig_of

# The least depth at which a change of the ground is judged, metres, and as a share of its own.
MIN_DEPTH, MIN_SHARE = 0.03, 0.3


class Patch(NamedTuple):
    """Where the surface is displaced.

    Attributes:
        number: id of the change.
        place: its middle [2].
        half: its half widths along x and y.
        depth: along the normal, metres; positive: something is deposited.
    """

    number: int
    place: np.ndarray
    half: np.ndarray
    depth: float


class Places:
    """Where something is to change: apart from each other, on rock that the scanners can see."""

    def __init__(self, terrain: Terrain, stands: np.ndarray) -> None:
        self.terrain, self._stands = terrain, stands
        self.extent = terrain.cell * (np.array(terrain.heights.shape) - 1)
        self._taken: list[tuple[np.ndarray, float]] = []

    def take(self, radius: float, random: np.random.Generator) -> np.ndarray:
        for attempt in range(2000):
            place = self.terrain.lower + random.uniform(0.08, 0.92, 2) * self.extent
            if self.free(place, radius * 0.95 ** (attempt // 100)) and self._in_view(place, radius / 2):
                break
        self._taken.append((place, radius))
        return np.asarray(place)

    def free(self, place: np.ndarray, radius: float) -> bool:
        return all(np.linalg.norm(place - at) > radius + own for at, own in self._taken)

    def bare(self, radius: float, random: np.random.Generator) -> np.ndarray:
        """A place that leaves what changes free, at two metres at least."""
        for _ in range(500):
            place = self.terrain.lower + random.uniform(0.02, 0.98, 2) * self.extent
            if self.free(place, radius + 2.0):
                break
        return np.asarray(place)

    def _in_view(self, place: np.ndarray, radius: float) -> bool:
        """Whether a station sees nine tenths of what is about the place."""
        steps = radius * np.linspace(-1, 1, 5)
        around = place + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        places = np.column_stack([around, self.terrain.at(around)])
        for stand in self._stands:
            ranges = np.linalg.norm(places - stand, axis=1)
            hits = first_hits([self.terrain], stand, (places - stand) / ranges[:, None], lowered=0.1)
            if (hits.ranges > ranges - 0.1).mean() > 0.9:
                return True
        return False


def slope(random: np.random.Generator, changed: bool, points: int = 400_000) -> Staged:
    """A slope of 50 to 200 m whose foot is along x and that rises along y, from one or two stations."""
    width, stage = random.uniform(50, 200), Stage(changed)
    terrain = _terrain(width, random)
    before, after = _stands(width, random)
    places = Places(terrain, before)
    _boulders(places, stage, random)
    patches = _patches(places, stage, random)
    _vegetation(places, stage, random)
    numbers, displaced = changed_terrain(terrain, patches, random)
    stage.worlds.before.append(numbers if changed else terrain)
    stage.worlds.after.append(displaced if changed else terrain)

    def rig(stands: np.ndarray) -> Rig:
        corners = np.array([(x, 0.0) for x in (-width / 2, width / 2)]) - stands[:, None, :2]
        side = float(np.degrees(np.abs(np.arctan2(corners[..., 0], corners[..., 1])).max()))
        reach = 0.3 * places.extent[1] - stands[:, 1]
        top = float(np.degrees(np.arctan2(terrain.heights.max() + 4 - stands[:, 2], reach)).max())
        # A third to a half of the rays return.
        sensor = tripod(2.5 * points / len(stands), (-side, side), (-15, min(top, 80)), 600.0, (0.004, 0.004 / 120))
        poses = [looking(at, at + np.array([0, 1, 0])) for at in stands]
        return rig_of(sensor, poses, random, off=(0.002, 0.001))

    return Staged(stage, Pair(before, after).map(rig), motion_about(random, 0.005, 0.002), slack=0.06)


def _stands(width: float, random: np.random.Generator) -> Pair[np.ndarray]:
    """One or two places before the foot, after near them."""
    count, away = int(random.integers(1, 3)), float(np.clip(random.uniform(0.4, 0.9) * width, 30, 150))
    x = (2 * np.arange(count) - 1) * (0.25 * width if count == 2 else 0.0) + random.normal(0, 0.05 * width, count)
    places = np.column_stack([x, np.full(count, -away), np.full(count, 1.7)])
    return Pair(*(places + random.normal(0, 1, (count, 3)) * (1.5, 1.5, 0.3) for _ in range(2)))


def _terrain(width: float, random: np.random.Generator) -> Terrain:
    """Rough at scales from a tenth of its width to a quarter of a metre; its foot is flatter."""
    cell, depth = max(0.1, width / 1000), random.uniform(0.5, 0.8) * width
    shape = (int(width / cell) + 1, int(depth / cell) + 1)
    y = cell * np.arange(shape[1])
    foot, steep = 0.12 * depth, np.tan(np.radians(random.uniform(38, 58)))
    heights = np.tile(0.1 * np.minimum(y, foot) + steep * np.logaddexp(0, (y - foot) / 2) * 2, (shape[0], 1))
    for scale, amplitude in ((width / 8, width / 60), (width / 25, width / 220), (2.5, 0.22), (0.9, 0.07), (0.3, 0.02)):
        heights += amplitude * roughness(shape, scale / cell, random)
    return Terrain(heights, np.array([-width / 2, 0.0]), cell)


def roughness(shape: tuple[int, ...], scale: float, random: np.random.Generator) -> np.ndarray:
    """A smooth random field of unit deviation whose bumps are about so many cells wide."""
    factor = max(scale / 6, 1.0)
    coarse = tuple(int(np.ceil(side / factor)) + 2 for side in shape)
    field = gaussian_filter(random.standard_normal(coarse), scale / factor / 2, mode="reflect")
    field = zoom(field, [(own + 1) / there for own, there in zip(shape, coarse, strict=True)], order=1)
    return np.asarray(field[: shape[0], : shape[1]] / field.std())


def changed_terrain(terrain: Terrain, patches: list[Patch], random: np.random.Generator) -> tuple[Terrain, Terrain]:
    """The terrain with the numbers of its changes, and the same with its patches displaced; they do not overlap."""
    heights, numbers = terrain.heights.copy(), np.full(terrain.heights.shape, -1)
    nodes = np.stack(np.meshgrid(*(np.arange(side) for side in heights.shape), indexing="ij"), axis=-1)
    for number, place, half, depth in patches:
        wave = 0.12 * roughness(heights.shape, 0.5 * float(half.mean()) / terrain.cell, random)
        reach = np.linalg.norm((terrain.lower + terrain.cell * nodes - place) / half, axis=2) + wave
        share = np.clip((1.0 - reach) / 0.25, 0, 1)
        share *= share * (3 - 2 * share)
        # Fresh rock and debris are rough in their own way.
        coarse = 0.12 * abs(depth) * roughness(heights.shape, 0.5 / terrain.cell, random)
        ends = [terrain.at(np.stack([place - step, place + step])) for step in np.diag(half)]
        rise = [np.diff(own)[0] / (2 * side) for own, side in zip(ends, half, strict=True)]
        heights += share * (depth + coarse) * np.sqrt(1 + rise[0] ** 2 + rise[1] ** 2)
        numbers[share > 0] = RIM
        numbers[abs(depth) * share > max(MIN_DEPTH, MIN_SHARE * abs(depth))] = number
    depths = {patch.number: abs(patch.depth) for patch in patches}
    before = dataclasses.replace(terrain, numbers=numbers, depths=depths)
    return before, dataclasses.replace(before, heights=heights)


def _boulders(places: Places, stage: Stage, random: np.random.Generator) -> None:
    """Many that stay; one or two that fall, one of which may be found below."""
    for _ in range(int(random.integers(8, 16))):
        stage.stays(_boulder(places, random.uniform(0.5, 3.0), 0.0, random))
    for _ in range(int(random.integers(1, 3))):
        stage.goes(_boulder(places, random.uniform(0.5, 3.0), 1.0, random))
    if random.random() < 0.4:
        stage.comes(_boulder(places, random.uniform(0.7, 2.0), 1.0, random))


def _boulder(places: Places, size: float, apart: float, random: np.random.Generator) -> np.ndarray:
    """Three lumps in the rock, of this width together."""
    place = places.take(size + apart, random)
    at = np.append(place, places.terrain.at(place)) + 0.15 * size * places.terrain.normals(place[None])[0]
    lumps = []
    for _ in range(3):
        extent = size * random.uniform(0.55, 0.85, 3)
        turn = Rotation.random(random_state=random.integers(2**31)).as_matrix()
        lump = shifted(ellipsoid(*extent, 10, 18), (0, 0, -extent[2] / 2)) @ turn
        lumps.append(shifted(lump, at + 0.15 * size * random.uniform(-1, 1, 3)))
    return joined(*lumps)


def _vegetation(places: Places, stage: Stage, random: np.random.Generator) -> None:
    """Bushes and some trees, whose leaves are others each time, and which have grown a little."""
    for number in range(int(random.integers(25, 60))):
        tree = number % 6 == 0
        half = random.uniform((0.3, 0.3, 0.25), (1.2, 1.2, 0.9)) * (1.8 if tree else 1.0)
        place = places.bare(float(half.max()), random)
        base = np.append(place, places.terrain.at(place))
        crown = base + np.array([0, 0, (2.2 if tree else 0.4) * half[2]])
        for side in stage.worlds:
            side.append(Foliage(crown, half * random.uniform(1.0, 1.06), random.uniform(0.25, 0.5)))
        if tree:
            trunk = cylinder(random.uniform(0.06, 0.15), 2.2 * half[2], 8)
            stage.stays(shifted(trunk, base - np.array([0, 0, 0.2])))


def _patches(places: Places, stage: Stage, random: np.random.Generator) -> list[Patch]:
    """A deposit and some places where rock is eroded."""
    extent, patches = float(places.extent.min()), []
    for depth in (0.3, *-random.uniform(0.05, 0.2, int(random.integers(1, 4)))):
        half = random.uniform(1.5, 3.5, 2) * np.sqrt(np.clip(extent / 60, 0.8, 1.5))
        place = places.take(1.4 * float(half.max()), random)
        patches.append(Patch(stage.next_number(), place, half, float(depth)))
    return patches
