"""Ground that is dug, filled and heaped up, that is washed out and slumps: flat, or in terraces."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families.scanners import flown_over, scanned
from gmmjax.scenes.families.staging import Arrangement, Support
from gmmjax.scenes.families.terrain import (
    cover,
    grid,
    ground_scene,
    oblique_scanner,
    on_tripods,
    panning_scanner,
    patch_of,
    rock,
    rough,
    standing_on,
    thick,
)
from gmmjax.scenes.families.things import box, chance, moved, pillar
from gmmjax.scenes.laser_scanner import Beam, LaserScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at, turned
from gmmjax.scenes.shapes import Ground
from gmmjax.scenes.surveyed_scene import SurveyedScene

# How thick the ground is that is more at one of the two times [n], metres, at places along and across it [n, 2].
Thickness: TypeAlias = Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, " n"]]


@dataclasses.dataclass(frozen=True, eq=False)
class _Earth:
    """Ground that is there at one of the two times only.

    Attributes:
        middle: of it, metres [2].
        half: half its longest extent, metres.
        heading: of its length from the x axis, radians.
        thickness: at places in its own coordinates; 0 at its border.
        heaped: whether it lies on the ground; else the ground is lower at the other time.
    """

    middle: Float[np.ndarray, "2"]
    half: float
    heading: float
    thickness: Thickness
    heaped: bool

    def at(self, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """The thickness at places of the ground."""
        own = (places - self.middle) @ turned(self.heading)[:2, :2]
        return np.where(np.abs(own).max(axis=1) <= self.half, self.thickness(own), 0.0)


# Between which depths or heights each kind is drawn, metres.
_DEPTHS = {"trench": (0.3, 1.5), "pit": (0.3, 3.0), "gully": (0.1, 1.0), "heap": (0.3, 3.0), "layer": (0.05, 0.5)}


@dataclasses.dataclass(frozen=True, eq=False)
class _Shape:
    """Shape that is dug or heaped up; the numbers are those of the branches of `at`."""

    kind: str
    size: Float[np.ndarray, "2"]
    corners: float
    swing: float
    waves: float
    lobes: int
    phase: float
    dents: float

    def at(self, own: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """The share of the greatest thickness at places along and across it: 0 at its border."""
        x, y = (own / self.size).T
        if self.kind == "trench":  # A flat floor between steep walls.
            share = (self.size - np.abs(own)).min(axis=1) / (0.3 * self.size[1])
        elif self.kind == "pit":  # Between an ellipse and, the greater the exponent, a rectangle.
            share = (1 - (np.abs(own / self.size) ** self.corners).sum(axis=1)) / 0.4
        elif self.kind == "gully":  # A strip that winds and runs out at its ends.
            wide = self.size[1]
            aside = (own[:, 1] - self.swing * wide * np.sin(np.pi * self.waves * x)) / wide
            share = np.clip(1 - aside**2, 0.0, 1.0) * np.clip((1 - np.abs(x)) / 0.3, 0.0, 1.0)
        elif self.kind == "heap":  # A cone.
            share = 1 - np.hypot(x, y)
        else:  # One thickness within an irregular outline.
            outline = 1 - self.dents * (1 + np.sin(self.lobes * np.arctan2(y, x) + self.phase)) / 2
            share = 2 * (outline - np.hypot(x, y)) / outline
        return np.asarray(np.clip(share, 0.0, 1.0))


def earthworks(random: np.random.Generator) -> SurveyedScene:
    """Ground of 15 to 120 m with up to four steps, surveyed from elsewhere each time, or from an aircraft.

    Trenches and pits are dug or filled, gullies are washed out, heaps and layers come and go, the faces of steps slump,
    boulders and crates come and go; nothing changes in a third of the scenes.
    """
    edge = 15.0 * 8.0 ** random.random()
    uncut = _terraces(random, edge)
    free = Support(np.eye(4), (0.84 * edge, 0.84 * edge), gap=0.01 * edge)
    stands = Pair(_stands(random, free), _stands(random, free))
    if chance(random, 0.25):
        stands = Pair(stands.before, stands.before)
    changes = 0 if chance(random, 1 / 3) else int(random.integers(1, 7))
    drawn = [_earth(random, uncut, free) for _ in range(changes) if chance(random, 0.75)]
    earths = [earth for earth in drawn if earth is not None]
    ground = _lowered(uncut, [earth for earth in earths if not earth.heaped])
    arrangement = Arrangement()
    arrangement.stays([ground])
    for earth in earths:
        goes = chance(random, 0.5 if earth.heaped else 0.65)
        arrangement.comes_or_goes((_patch(ground, uncut, earth),), comes=not goes)
    for _ in range(changes - len(drawn)):
        _thing(random, arrangement, ground, free)
    cover(random, arrangement, ground)
    noise, growth = random.uniform(0.003, 0.03), random.uniform(0.0, 0.0002)
    mixed, lost = random.uniform(0.0, 0.3), random.uniform(0.0, 0.2)
    beam = Beam(noise=noise, growth=growth, max_range=3 * edge, mixed=mixed, edge=0.3, lost=lost)
    recordings = _surveyed(random, arrangement.solids, ground, stands, beam)
    return ground_scene(random, arrangement, recordings, beam)


def _terraces(random: np.random.Generator, edge: float) -> Ground:
    """Level, or rising in steps along y whose edges meander; rough at three scales."""
    nodes = 161
    heights = random.uniform([0.0, 0.0, 0.0], [0.02, 0.006, 0.0015]) * edge
    relief = rough(random, nodes, (0.25, 0.06, 0.012), heights)
    along = np.linspace(-0.5, 0.5, nodes) * edge
    steps = int(random.integers(0, 5))
    for number in range(steps):
        meander = rough(random, nodes, (0.1,), random.uniform(0.0, [0.03]) * edge)[:, :1]
        across = along[None, :] - meander - edge * ((number + random.uniform(0.3, 0.7)) / steps - 0.5)
        high = random.uniform(0.02, 0.09) * edge
        wide = high / np.tan(np.radians(random.uniform(30, 75)))
        relief = relief + high * np.clip(across / wide, -0.5, 0.5)
    return _ground(relief - (relief.min() + relief.max()) / 2, edge)


def _ground(heights: Float[np.ndarray, "n n"], edge: float) -> Ground:
    """Ground about the origin with these heights."""
    return Ground(np.zeros(3), np.array([edge, edge, 2 * np.abs(heights).max() + 1.0]), heights=heights)


def _stands(random: np.random.Generator, free: Support) -> Float[np.ndarray, "v 2"]:
    """Free places of one to three stations."""
    poses = [free.pose(random, (pillar(2.0, 2.0),)) for _ in range(int(random.integers(1, 4)))]
    return np.array([pose[:2, 3] for pose in poses if pose is not None])


def _earth(random: np.random.Generator, uncut: Ground, free: Support) -> _Earth | None:
    """Dug, washed out, slumped, spread or heaped up at a free place."""
    kind = str(random.choice(["trench", "pit", "gully", "face", "heap", "layer"]))
    if kind == "face":
        return _face(random, uncut, free)
    edge = float(uncut.extent[0])
    long = random.uniform(0.05, 0.18) * edge
    wide = random.uniform(0.015, 0.04) * edge if kind in ("trench", "gully") else long * random.uniform(0.4, 1.0)
    half = long + wide
    pose = free.pose(random, (pillar(2 * half, 1.0),))
    if pose is None:
        return None
    shape = _Shape(
        kind,
        np.array([long, wide]),
        corners=random.uniform(2.0, 6.0),
        swing=random.uniform(0.0, 1.0),
        waves=random.uniform(0.5, 2.0),
        lobes=int(random.integers(2, 6)),
        phase=random.uniform(0, 2 * np.pi),
        dents=random.uniform(0.0, 0.3),
    )
    deep = random.uniform(*_DEPTHS[kind]) * thick(edge)
    heading = random.uniform(0, 2 * np.pi)
    return _Earth(pose[:2, 3], half, heading, lambda own: deep * shape.at(own), kind in ("heap", "layer"))


def _face(random: np.random.Generator, uncut: Ground, free: Support) -> _Earth | None:
    """A steep face moved back, at the steepest place of a line across the steps; None where it is not steep or free."""
    edge = float(uncut.extent[0])
    half, back = random.uniform(0.03, 0.1) * edge, random.uniform(0.1, 1.0) * thick(edge)
    across = np.linspace(-0.35, 0.35, 200) * edge
    places = np.column_stack([np.full(200, random.uniform(-0.35, 0.35) * edge), across])
    drops = _drop(uncut, back, places)
    middle = places[np.argmax(drops)]
    if drops.max() < 0.4 * back or not free.free(middle, half):
        return None
    free.taken.append((middle, half))

    def thickness(own: np.ndarray) -> np.ndarray:
        drop = _drop(uncut, back, middle + own)
        steep = np.clip((drop / back - 0.2) / 0.2, 0.0, 1.0)
        return np.asarray(drop * steep * np.clip((1 - np.hypot(*own.T) / half) / 0.3, 0.0, 1.0))

    return _Earth(middle, half, 0.0, thickness, heaped=False)


def _drop(ground: Ground, back: float, places: np.ndarray) -> np.ndarray:
    """By how much places are above those that lie back from them against y."""
    return np.asarray(ground.height_at(places) - ground.height_at(places - [0.0, back]))


def _lowered(uncut: Ground, dug: Sequence[_Earth]) -> Ground:
    """The ground without what is dug out at one of the times."""
    edge = float(uncut.extent[0])
    along = np.linspace(-0.5, 0.5, len(uncut.heights)) * edge
    places = grid(along, along)
    missing = sum((earth.at(places) for earth in dug), np.zeros(len(places)))
    return _ground(uncut.heights - missing.reshape(uncut.heights.shape), edge)


def _patch(ground: Ground, uncut: Ground, earth: _Earth) -> Ground:
    """Heaped earth on the ground; below the ground where it is thin."""
    nodes = 81
    steps = np.linspace(-earth.half, earth.half, nodes)
    places = earth.middle + grid(steps, steps)
    below = ground.height_at(places)
    above = below + earth.at(places) if earth.heaped else uncut.height_at(places)
    thickness = above - below
    most = thickness.max()
    # Thin edges are left out: nobody could call them changed.
    thin = thickness < min(0.3 * most, 0.1 * thick(float(ground.extent[0])))
    surface = np.where(thin, below - most, above).reshape(nodes, nodes)
    return patch_of(surface, earth.middle, np.full(2, 2 * earth.half))


def _thing(random: np.random.Generator, arrangement: Arrangement, ground: Ground, free: Support) -> None:
    """A boulder or a crate comes or goes."""
    size = min(random.uniform(0.03, 0.1) * float(ground.extent[0]), random.uniform(1.0, 6.0))
    thing = rock(random, size) if chance(random, 0.5) else box(random, 0.7 * size, size)
    place = standing_on(random, ground, free, thing)
    if place is not None:
        arrangement.comes_or_goes(moved(thing, place), comes=chance(random, 0.5))


def _surveyed(
    random: np.random.Generator, solids: Pair[list[Solid]], ground: Ground, stands: Pair[np.ndarray], beam: Beam
) -> Pair[Recording]:
    """From an aircraft, from stations among the works, or from stations outside that look in."""
    edge = float(ground.extent[0])
    flown, rays = chance(random, 0.3), random.uniform(18_000, 40_000)
    if flown:
        return flown_over(random, solids, edge, dataclasses.replace(beam, growth=0.0), rays)
    if chance(random, 0.7):
        scanner: LaserScanner = panning_scanner(beam, rays)
        poses = stands.map(lambda own: on_tripods(random, ground, own))
    else:
        scanner = oblique_scanner(random, beam, rays)
        poses = stands.map(lambda own: np.stack([_outside(random, edge) for _ in own]))
    return scanned(random, scanner, solids, poses, int(rays))


def _outside(random: np.random.Generator, edge: float) -> Float[np.ndarray, "4 4"]:
    """Pose of a scanner beyond the border that looks at the middle from above the ground."""
    angle, away = random.uniform(0, 2 * np.pi), random.uniform(0.6, 1.0) * edge
    position = np.array([away * np.cos(angle), away * np.sin(angle), random.uniform(0.1, 0.4) * edge])
    return looking_at(position, np.zeros(3))
