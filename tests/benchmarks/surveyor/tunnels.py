"""Road tunnels: a lining that spalls, is repaired or gives way, and what hangs, stands and lies in them."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from gmmjax.pair import Pair
from tests.benchmarks.surveyor.ground import Patch, changed_terrain, roughness
from tests.benchmarks.surveyor.lining import Lining
from tests.benchmarks.surveyor.scanning import Beam, World
from tests.benchmarks.surveyor.solids import Thing, box, pipe, pole
from tests.benchmarks.surveyor.stages import Floor, Stage
from tests.benchmarks.surveyor.surveys import Lowered, Site, Station
from tests.benchmarks.surveyor.terrain import Terrain

# Width of the road, and how far it lies below the axis, both by the radius.
ROAD, BELOW = 1.5, 0.35


def tunnel_site(random: np.random.Generator, changed: bool) -> Site:
    """A straight tunnel along x, scanned from one to three stations on the road, after from others."""
    length, radius = random.uniform(30, 70), random.uniform(4, 6)
    before = _lining(length, radius, random)
    stage, count = Stage(changed), int(random.integers(1, 4))
    stations = Pair(*(_stations(length, radius, count, random) for _ in range(2)))
    _fixtures(length, radius, stage, random)
    _loads(length, radius, [*stations.before, *stations.after], stage, random)
    lowered, after = _given_way(before, length, stage, random) if changed else (None, before)
    beam = Beam(noise=0.002, doubling=20.0, slanted=0.2, mixed=0.15, lost=0.02, grazing=0.08, max_range=80.0)
    worlds = Pair(World(stage.things.before, before), World(stage.things.after, after))
    return Site(worlds, stations, beam, lowered, slack=0.05, least_distance=0.015)


def _lining(length: float, radius: float, random: np.random.Generator) -> Lining:
    """Sprayed concrete or cast blocks with joints."""
    cell = 0.05
    first, last = Lining.arc(radius)
    shape = (int(length / cell) + 1, int((last - first) / cell) + 2)
    heights = np.zeros(shape)
    sprayed = random.random() < 0.5
    for scale, amplitude in ((3.0, 0.02), (0.6, 0.012), (0.25, 0.004)) if sprayed else ((5.0, 0.006), (1.0, 0.001)):
        heights += amplitude * roughness(shape, scale / cell, random)
    if not sprayed:
        joint = random.uniform(4, 9)
        along = cell * np.arange(shape[0]) % joint
        heights -= 0.015 * (along < 0.06)[:, None]
    return Lining(radius, Terrain(heights, np.array([0.0, first]), cell))


def _fixtures(length: float, radius: float, stage: Stage, random: np.random.Generator) -> None:
    """The road with its kerbs, lamps at the crown, a cable tray, pipes, cabinets on the walls."""
    level, width = -BELOW * radius, ROAD * radius
    stage.stays(Thing((box(length, 2 * radius, 0.3, (length / 2, 0, level - 0.3)),)))
    stage.stays(*(Thing((box(length, 0.3, 0.15, (length / 2, side * width / 2, level)),)) for side in (-1, 1)))
    lamps = np.arange(random.uniform(2, 4), length - 2, random.uniform(5, 9))
    gone = set(random.choice(len(lamps), size=int(random.integers(0, 3)), replace=False).tolist())
    for number, x in enumerate(lamps):
        lamp = Thing((box(1.2, 0.25, 0.12, (x, 0, radius - 0.45)), box(0.05, 0.05, 0.4, (x, 0, radius - 0.35))))
        (stage.goes if number in gone else stage.stays)(lamp)
    tray = 0.75 * radius
    stage.stays(Thing((box(length, 0.3, 0.08, (length / 2, -0.55 * radius, tray)),)))
    stage.stays(Thing((pipe(random.uniform(0.06, 0.12), length, (length / 2, 0.9 * radius, level + 0.9)),)))
    for _ in range(int(random.integers(2, 6))):
        side, height = random.choice([-1, 1]), random.uniform(0.5, 1.1)
        at = (random.uniform(2, length - 2), side * 0.9 * radius, level + random.uniform(0.6, 1.2))
        cabinet = Thing((box(random.uniform(0.4, 0.9), 0.4, height, at),))
        getattr(stage, random.choice(["stays", "stays", "comes", "goes"]))(cabinet)


def _loads(
    length: float, radius: float, stations: Sequence[Station], stage: Stage, random: np.random.Generator
) -> None:
    """Pallets, boxes, drums and cones on the road, not below a tripod."""
    width = ROAD * radius - 0.8
    floor, corner = Floor(length, width, random), np.array([0.0, -width / 2, -BELOW * radius])
    for station in stations:
        floor.reserve(station.position - corner, 1.0)
    makers = (
        lambda: (box(1.2, 0.8, random.uniform(0.15, 0.9)),),
        lambda: (box(*random.uniform(0.3, 0.8, 2), random.uniform(0.25, 0.7)),),
        lambda: (pole(random.uniform(0.15, 0.3), random.uniform(0.4, 0.9)),),
        lambda: (box(0.4, 0.4, 0.03), pole(0.12, 0.35), pole(0.07, 0.7)),
    )
    for fate in ["stays"] * 4 + random.choice(["comes", "goes", "moves"], int(random.integers(2, 5))).tolist():
        thing = Thing(makers[int(random.integers(len(makers)))]())
        placed = [
            thing.placed(floor.take(0.9), random.uniform(0, 2 * np.pi)).moved(np.eye(3), corner)
            for _ in range(2 if fate == "moves" else 1)
        ]
        getattr(stage, fate)(*placed)


def _given_way(before: Lining, length: float, stage: Stage, random: np.random.Generator) -> tuple[Lowered, Lining]:
    """Concrete has fallen off, some was sprayed on, and in some tunnels the wall comes in over some metres."""
    depths = [*-random.uniform(0.05, 0.15, int(random.integers(1, 3)))]
    depths += [*random.uniform(0.04, 0.1, int(random.integers(0, 2)))]
    places = iter(_apart(length, before.radius, random))
    small = [Patch(stage.next_number(), next(places), random.uniform(0.3, 1.0, 2), float(depth)) for depth in depths]
    large = [
        Patch(stage.next_number(), next(places), random.uniform(2.0, 4.0, 2), float(random.uniform(0.03, 0.08)))
        for _ in range(int(random.integers(0, 2)))
    ]
    fallen, field = changed_terrain(before.inward, small, random)
    bent, field = changed_terrain(field, large, random, _bell)
    numbers = np.where(fallen.numbers >= 0, fallen.numbers, bent.numbers)
    return Lowered(numbers, fallen.depth | bent.depth), dataclasses.replace(before, inward=field)


def _apart(length: float, radius: float, random: np.random.Generator) -> list[np.ndarray]:
    """Four places on the wall above the road, each in its own quarter of the tunnel."""
    quarters = random.permutation(4)
    x = (quarters + random.uniform(0.3, 0.7, 4)) * length / 4
    return [np.array([along, radius * random.uniform(0.1, np.pi - 0.1)]) for along in x]


def _bell(reach: np.ndarray) -> np.ndarray:
    """Deepest in the middle, with no rim."""
    return np.asarray(np.cos(np.pi / 2 * np.clip(reach, 0, 1)) ** 2)


def _stations(length: float, radius: float, count: int, random: np.random.Generator) -> list[Station]:
    x = (np.arange(count) + 0.5 + random.uniform(-0.2, 0.2, count)) * length / count
    heights = -BELOW * radius + random.uniform(1.5, 1.8, count)
    return [Station(np.array([at, random.uniform(-1, 1), z])) for at, z in zip(x, heights, strict=True)]
