"""Scenes for the registration beside the simulated laboratory: a table before a wall, and a hall with crates."""

from typing import NamedTuple

import numpy as np

from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.ray_casting import Solid, cast
from gmmjax.scenes.rigid_motions import looking_at


class Scene(NamedTuple):
    """Two surveys in one frame [n, 3], metres."""

    before: np.ndarray
    after: np.ndarray


def table(seed: int) -> Scene:
    """A depth camera looks at a table with five boxes and cans; one is taken away, another one is put there."""
    random = np.random.default_rng(seed)
    room = [
        _solid((0, 0, -0.02), (1.2, 0.8, 0.04)),
        _solid((0, 0.9, 0.2), (3, 0.1, 2)),
        _solid((0, 0, -0.75), (4, 4, 0.05)),
    ]
    places = random.permutation([(x, y) for x in (-0.4, -0.13, 0.13, 0.4) for y in (-0.2, 0.05, 0.25)])
    things = []
    for x, y in places[:7]:
        extent, is_round = random.uniform(0.05, 0.16, 3), bool(random.random() < 0.4)
        extent[1] = extent[0] if is_round else extent[1]
        things.append(Solid(np.array([x, y, extent[2] / 2]), extent, random.uniform(0, 3), is_round))
    camera = DepthCamera(columns=320, rows=240, noise=0.003, max_range=3.0)

    def frame(solids: list[Solid]) -> np.ndarray:
        stand = np.array([0.05, -0.9, 0.7]) + random.normal(0, 0.002, 3)
        pose = looking_at(stand, np.array([0, 0.05, 0]))
        return (camera.frame(solids, pose, random)[0] - pose[:3, 3]) @ pose[:3, :3]

    return Scene(frame([*room, *things[:6]]), frame([*room, *things[:5], things[6]]))


def hall(seed: int, points: int = 50_000) -> Scene:
    """A terrestrial scanner at two stations of a hall of 18 to 32 m with pillars; one of its crates is exchanged."""
    random = np.random.default_rng(seed)
    length, width, height = random.uniform(18, 32), random.uniform(10, 16), 6.0
    walls = [_solid((0, 0, z), (length, width, 0.2)) for z in (-0.1, height + 0.1)]
    walls += [_solid((side * length / 2, 0, height / 2), (0.2, width, height)) for side in (-1, 1)]
    walls += [_solid((0, side * width / 2, height / 2), (length, 0.2, height)) for side in (-1, 1)]
    for x in np.arange(-length / 2 + 4, length / 2 - 2, 5):
        walls += [_solid((x, side * width * 0.3, height / 2), (0.4, 0.4, height)) for side in (-1, 1)]
    crates = []
    for _ in range(14):
        extent = random.uniform(0.6, 2.0, 3)
        place = random.uniform(-1, 1, 2) * [length / 2 - 2, width / 2 - 2]
        crates.append(Solid(np.array([*place, extent[2] / 2]), extent, random.uniform(0, 3)))

    def survey(solids: list[Solid]) -> np.ndarray:
        stations = [
            np.array([side * length / 4, -0.7 * side, 1.7]) + random.normal(0, (0.3, 0.3, 0.03)) for side in (-1, 1)
        ]
        return np.concatenate([_scan(random, solids, station, points // 2) for station in stations])

    return Scene(survey([*walls, *crates[:12]]), survey([*walls, *crates[:11], *crates[12:]]))


def _scan(random: np.random.Generator, solids: list[Solid], station: np.ndarray, rays: int) -> np.ndarray:
    azimuth, elevation = random.uniform(0, 2 * np.pi, rays), np.arcsin(random.uniform(-0.9, 1, rays))
    level = np.cos(elevation)
    directions = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    ranges = cast(solids, station, directions)[0]
    hit = np.isfinite(ranges)
    return station + directions[hit] * (ranges[hit] + random.normal(0, 0.003, hit.sum()))[:, None]


def _solid(centre: tuple[float, ...], extent: tuple[float, ...]) -> Solid:
    return Solid(np.array(centre, float), np.array(extent, float))
