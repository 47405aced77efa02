"""Ground that is dug, filled and heaped up, that is washed out and slumps: flat, or in terraces."""

import dataclasses
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair, each
from gmmjax.scenes.families.arrangements import Arrangement, chance
from gmmjax.scenes.families.flights import flown_over
from gmmjax.scenes.families.rough_ground import cover, is_displaced, lifted, on_tripods, rock, rough
from gmmjax.scenes.families.staging import Support, turned
from gmmjax.scenes.families.things import box, moved, pillar
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam, TripodScanner
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.shapes import Ground
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

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
        turn = turned(self.heading, (0.0, 0.0, 0.0))[:2, :2]
        own = (places - self.middle) @ turn
        return np.where(np.abs(own).max(axis=1) <= self.half, self.thickness(own), 0.0)


def earthworks(random: np.random.Generator) -> SurveyedScene:
    """Ground of 15 to 120 m with up to four steps, surveyed from elsewhere each time, or from an aircraft.

    Trenches and pits are dug or filled, gullies are washed out, heaps and layers come and go, the faces of steps slump,
    boulders and crates come and go; nothing changes in a third of the scenes.

    Args:
        random: of everything.
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
        (arrangement.goes if goes else arrangement.comes)((_patch(ground, uncut, earth),))
    for _ in range(changes - len(drawn)):
        _thing(random, arrangement, ground, free)
    cover(random, arrangement, ground, edge)
    beam = _beam(random, edge)
    recordings = _surveyed(random, arrangement, ground, stands, beam)
    frame = Frame.drawn(random, shift=random.uniform(0.0, 0.1), degrees=0.05)
    covers = arrangement.solids.map(lambda own: [solid for solid in own if is_displaced(solid)])
    hidden_by = 0.03 + 3 * (beam.noise + beam.growth * edge)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by, covers=covers)


def _beam(random: np.random.Generator, edge: float) -> Beam:
    """Of a terrestrial scanner, good or worn."""
    noise, growth = random.uniform(0.003, 0.03), random.uniform(0.0, 0.0002)
    mixed, lost = random.uniform(0.0, 0.3), random.uniform(0.0, 0.2)
    return Beam(noise=noise, growth=growth, max_range=3 * edge, mixed=mixed, edge=0.3, lost=lost)


def _terraces(random: np.random.Generator, edge: float) -> Ground:
    """Level, or rising in steps along y whose edges meander; rough at three scales."""
    nodes = 161
    cells = np.array([0.25, 0.06, 0.012]) * nodes
    relief = rough(random, nodes, cells, random.uniform([0.0, 0.0, 0.0], [0.02, 0.006, 0.0015]) * edge)
    along = np.linspace(-0.5, 0.5, nodes) * edge
    steps = int(random.integers(0, 5))
    for number in range(steps):
        meander = rough(random, nodes, np.array([0.1 * nodes]), np.array([random.uniform(0.0, 0.03) * edge]))[:, :1]
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
    shares, (least, most) = {
        "trench": (_trench(long, wide), (0.3, 1.5)),
        "pit": (_pit(long, wide, random.uniform(2.0, 6.0)), (0.3, 3.0)),
        "gully": (_gully(random, long, wide), (0.1, 1.0)),
        "heap": (_heap(long, wide), (0.3, 3.0)),
        "layer": (_layer(random, long, wide), (0.05, 0.5)),
    }[kind]
    deep = random.uniform(least, most) * max(1.0, edge / 60)
    heading = random.uniform(0, 2 * np.pi)
    return _Earth(pose[:2, 3], half, heading, lambda own: deep * shares(own), kind in ("heap", "layer"))


def _trench(long: float, wide: float) -> Thickness:
    """Of a flat floor between steep walls."""

    def share(own: np.ndarray) -> np.ndarray:
        inside = np.array([long, wide]) - np.abs(own)
        return np.asarray(np.clip(inside.min(axis=1) / (0.3 * wide), 0.0, 1.0))

    return share


def _pit(long: float, wide: float, corners: float) -> Thickness:
    """Between an ellipse and, the greater the exponent, a rectangle."""
    return lambda own: np.clip((1 - (np.abs(own / [long, wide]) ** corners).sum(axis=1)) / 0.4, 0.0, 1.0)


def _gully(random: np.random.Generator, long: float, wide: float) -> Thickness:
    """A strip that winds and runs out at its ends."""
    swing, waves = random.uniform(0.0, 1.0) * wide, random.uniform(0.5, 2.0)

    def share(own: np.ndarray) -> np.ndarray:
        along = own[:, 0] / long
        aside = (own[:, 1] - swing * np.sin(np.pi * waves * along)) / wide
        return np.asarray(np.clip(1 - aside**2, 0.0, 1.0) * np.clip((1 - np.abs(along)) / 0.3, 0.0, 1.0))

    return share


def _heap(long: float, wide: float) -> Thickness:
    """A cone, as wide as it is long or not."""
    return lambda own: np.clip(1 - np.hypot(*(own / [long, wide]).T), 0.0, 1.0)


def _layer(random: np.random.Generator, long: float, wide: float) -> Thickness:
    """Of one thickness within an irregular outline."""
    lobes, phase = int(random.integers(2, 6)), random.uniform(0, 2 * np.pi)
    depth = random.uniform(0.0, 0.3)

    def share(own: np.ndarray) -> np.ndarray:
        x, y = (own / [long, wide]).T
        outline = 1 - depth * (1 + np.sin(lobes * np.arctan2(y, x) + phase)) / 2
        return np.asarray(np.clip(2 * (outline - np.hypot(x, y)) / outline, 0.0, 1.0))

    return share


def _face(random: np.random.Generator, uncut: Ground, free: Support) -> _Earth | None:
    """A steep face moved back, at the steepest place of a line across the steps; None where it is not steep or free."""
    edge = float(uncut.extent[0])
    half, back = random.uniform(0.03, 0.1) * edge, random.uniform(0.1, 1.0) * max(1.0, edge / 60)

    def fall(places: np.ndarray) -> np.ndarray:
        return np.asarray(uncut.height_at(places) - uncut.height_at(places - [0.0, back]))

    across = np.linspace(-0.35, 0.35, 200) * edge
    places = np.column_stack([np.full(200, random.uniform(-0.35, 0.35) * edge), across])
    middle = places[np.argmax(fall(places))]
    if fall(middle[None])[0] < 0.4 * back or not free.free(middle, half):
        return None
    free.taken.append((middle, half))

    def thickness(own: np.ndarray) -> np.ndarray:
        drop = fall(middle + own)
        steep = np.clip((drop / back - 0.2) / 0.2, 0.0, 1.0)
        return np.asarray(drop * steep * np.clip((1 - np.hypot(*own.T) / half) / 0.3, 0.0, 1.0))

    return _Earth(middle, half, 0.0, thickness, heaped=False)


def _lowered(uncut: Ground, dug: list[_Earth]) -> Ground:
    """The ground without what is dug out at one of the times."""
    edge = float(uncut.extent[0])
    along = np.linspace(-0.5, 0.5, len(uncut.heights)) * edge
    places = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    missing = sum((earth.at(places) for earth in dug), np.zeros(len(places)))
    return _ground(uncut.heights - missing.reshape(uncut.heights.shape), edge)


def _patch(ground: Ground, uncut: Ground, earth: _Earth) -> Ground:
    """What lies on the ground while the earth is there; below the ground where it is thin."""
    nodes = 81
    steps = np.linspace(-earth.half, earth.half, nodes)
    places = earth.middle + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    below = ground.height_at(places)
    above = below + earth.at(places) if earth.heaped else uncut.height_at(places)
    thickness = above - below
    most = thickness.max()
    # Thin edges are left out: nobody could call them changed.
    thin = thickness < min(0.3 * most, 0.1 * max(1.0, float(ground.extent[0]) / 60))
    surface = np.where(thin, below - most, above).reshape(nodes, nodes)
    middle = (surface.min() + surface.max()) / 2
    extent = np.array([2 * earth.half, 2 * earth.half, np.ptp(surface) + 0.01])
    return Ground(np.array([*earth.middle, middle]), extent, heights=surface - middle)


def _thing(random: np.random.Generator, arrangement: Arrangement, ground: Ground, free: Support) -> None:
    """A boulder or a crate comes or goes."""
    size = min(random.uniform(0.03, 0.1) * float(ground.extent[0]), random.uniform(1.0, 6.0))
    thing = rock(random, size) if chance(random, 0.5) else box(random, 0.7 * size, size)
    level = free.pose(random, thing)
    if level is None:
        return
    standing = moved(thing, rigid_transform(level[:3, :3], lifted(ground, level[:2, 3])))
    (arrangement.comes if chance(random, 0.5) else arrangement.goes)(standing)


def _surveyed(
    random: np.random.Generator, arrangement: Arrangement, ground: Ground, stands: Pair[np.ndarray], beam: Beam
) -> Pair[Recording]:
    """From an aircraft, from stations among the works, or from stations outside that look in."""
    edge = float(ground.extent[0])
    flown, rays = chance(random, 0.3), random.uniform(18_000, 40_000)
    if flown:
        return flown_over(random, arrangement, edge, dataclasses.replace(beam, growth=0.0), rays)
    if chance(random, 0.7):
        scanner: TripodScanner | AirborneScanner = TripodScanner(beam, int(2.5 * rays), lowest=-60.0, highest=40.0)
        poses = stands.map(lambda own: on_tripods(random, ground, own))
    else:
        scanner = AirborneScanner(beam, random.uniform(50, 80), random.uniform(35, 60), int(2.5 * rays))
        poses = stands.map(lambda own: np.stack([_outside(random, edge) for _ in own]))
    return each(
        lambda solids, own: scanner.recording(solids, own, random).thinned(int(rays), random),
        arrangement.solids,
        poses,
    )


def _outside(random: np.random.Generator, edge: float) -> Float[np.ndarray, "4 4"]:
    """Of a scanner beyond the border that looks at the middle from above the ground."""
    angle, away = random.uniform(0, 2 * np.pi), random.uniform(0.6, 1.0) * edge
    position = np.array([away * np.cos(angle), away * np.sin(angle), random.uniform(0.1, 0.4) * edge])
    return looking_at(position, np.zeros(3))
