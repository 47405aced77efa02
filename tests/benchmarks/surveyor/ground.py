"""What slopes of either kind are made of: rough terrain, places that are in view, patches that are displaced."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, zoom

from tests.benchmarks.surveyor.solids import UNCHANGED
from tests.benchmarks.surveyor.surveys import Lowered, Station
from tests.benchmarks.surveyor.terrain import Terrain


class Patch(NamedTuple):
    """Where the surface is displaced.

    Attributes:
        number: of the change.
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


def roughness(shape: tuple[int, int], scale: float, random: np.random.Generator) -> np.ndarray:
    """A smooth random field of unit deviation whose bumps are about so many cells wide."""
    factor = max(scale / 6, 1.0)
    coarse = tuple(int(np.ceil(side / factor)) + 2 for side in shape)
    field = gaussian_filter(random.standard_normal(coarse), scale / factor / 2, mode="reflect")
    field = zoom(field, [(own + 1) / there for own, there in zip(shape, coarse, strict=True)], order=1)
    return np.asarray(field[: shape[0], : shape[1]] / field.std())


def on_terrain(terrain: Terrain, place: np.ndarray) -> np.ndarray:
    return np.append(place, terrain.at(place[None])[0])


def bare_place(terrain: Terrain, places: Places, radius: float, random: np.random.Generator) -> np.ndarray:
    """A place that leaves what changes free, at two metres at least."""
    extent = terrain.cell * (np.array(terrain.heights.shape) - 1)
    for _ in range(500):
        place = terrain.lower + random.uniform(0.02, 0.98, 2) * extent
        if places.free(place, radius + 2.0):
            break
    return np.asarray(place)


def plateau(reach: np.ndarray) -> np.ndarray:
    """Full depth inside, none at the edge, where `reach` is 1, and a rim of a quarter of the radius."""
    profile = np.clip((1.0 - reach) / 0.25, 0, 1)
    return np.asarray(profile * profile * (3 - 2 * profile))


def changed_terrain(
    terrain: Terrain,
    patches: Sequence[Patch],
    random: np.random.Generator,
    profile_of: Callable[[np.ndarray], np.ndarray] = plateau,
) -> tuple[Lowered, Terrain]:
    """The terrain with its patches displaced, and what became of it.

    Args:
        terrain: before.
        patches: that do not overlap.
        random: of their outlines and of the roughness of what comes to light.
        profile_of: share of the depth, by the distance from the middle in half widths.
    """
    heights = terrain.heights.copy()
    numbers = np.full(heights.shape, UNCHANGED)
    nodes = np.stack(np.meshgrid(*(np.arange(side) for side in heights.shape), indexing="ij"), axis=-1)
    xy = terrain.lower + terrain.cell * nodes
    for number, place, half, depth in patches:
        wave = 0.12 * roughness(heights.shape, 0.5 * float(half.mean()) / terrain.cell, random)
        reach = np.linalg.norm((xy - place) / half, axis=2) + wave
        profile = profile_of(reach)
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


def station_towards(terrain: Terrain, at: np.ndarray) -> Station:
    """A station whose field of view just holds the slope."""
    shape = np.array(terrain.heights.shape)
    x, y = (terrain.lower[axis] + terrain.cell * np.array([0, shape[axis] - 1]) for axis in (0, 1))
    corners = np.array([(a, b) for a in x for b in y]) - at[:2]
    azimuths = np.arctan2(corners[:, 1], corners[:, 0])
    top = np.degrees(np.arctan2(terrain.heights.max() + 4 - at[2], y[0] - at[1] + 0.3 * (y[1] - y[0])))
    return Station(at, (azimuths.min() + 1e-3, azimuths.max() - 1e-3), (np.radians(-15), np.radians(min(top, 80))))
