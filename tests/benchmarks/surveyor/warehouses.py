"""Warehouses that a mobile scanner is carried through: another building, other shapes and another sensor than halls."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.pair import Pair
from tests.benchmarks.surveyor.scanning import Beam, World
from tests.benchmarks.surveyor.solids import Body, Thing, box, ellipsoid, pipe, pole
from tests.benchmarks.surveyor.stages import Floor, Stage
from tests.benchmarks.surveyor.surveys import Site
from tests.benchmarks.surveyor.walks import Walk


def warehouse_site(random: np.random.Generator, changed: bool) -> Site:
    """Goods on both sides of two aisles, which the scanner is carried along."""
    size = random.uniform((30, 15, 5.5), (40, 20, 8))
    aisles = size[1] * np.array([0.3, 0.7]) + random.uniform(-0.5, 0.5, 2)
    floor, stage = Floor(size[0], size[1], random), Stage(changed)
    for x in np.arange(0.0, size[0], 0.8):
        for y in aisles:
            floor.reserve(np.array([x, y]), 0.9)
    stage.stays(_building(size), *_supports(size, random))
    for _ in range(int(random.integers(3, 6))):
        stage.stays(_placed(*_bay(random), floor, random))
    makers = (_skid, _package, _bars, _drums, _sacks)
    for make in makers:
        for _ in range(int(random.integers(2, 5))):
            stage.stays(_placed(*make(random), floor, random))
    for make in random.permutation(np.array([*makers, *makers], dtype=object))[: int(random.integers(5, 9))]:
        thing, radius = make(random)
        fate = random.choice(["comes", "goes", "moves"])
        if fate == "moves":
            stage.moves(*(_placed(thing, radius, floor, random) for _ in range(2)))
        else:
            getattr(stage, fate)(_placed(thing, radius, floor, random))
    beam = Beam(noise=0.0035, doubling=40.0, slanted=0.25, mixed=0.3, lost=0.03, max_range=45.0)
    walks = Pair(*([_walk(size, y, random) for y in aisles] for _ in range(2)))
    return Site(stage.things.map(World), walks, beam, views=False)


def _walk(size: np.ndarray, y: float, random: np.random.Generator) -> Walk:
    ends = np.array([[0.8, y, 1.4], [size[0] - 0.8, y, 1.4]]) + random.normal(0, (0.2, 0.2, 0.08), (2, 3))
    return Walk(*(ends if random.random() < 0.5 else ends[::-1]))


def _building(size: np.ndarray) -> Thing:
    """Floor, walls, and a gable roof of two slabs."""
    length, width, height = size
    walls = [box(0.4, width + 0.8, height + 2, (x, width / 2, 0)) for x in (-0.2, length + 0.2)]
    walls += [box(length + 0.8, 0.4, height, (length / 2, y, 0)) for y in (-0.2, width + 0.2)]
    pitch = np.arctan2(1.2, width / 2)
    roof = []
    for side in (-1, 1):
        slab = box(length + 0.8, width / 2 / np.cos(pitch) + 0.6, 0.2)
        turn = Rotation.from_euler("x", -side * pitch).as_matrix()
        roof.append(slab.moved(turn, np.array([length / 2, width / 2 + side * width / 4, height + 0.6])))
    return Thing((box(length + 0.8, width + 0.8, 0.4, (length / 2, width / 2, -0.4)), *walls, *roof))


def _supports(size: np.ndarray, random: np.random.Generator) -> list[Thing]:
    """A row of round columns in the middle, girders on them, ducts below the eaves."""
    length, width, height = size
    things = []
    for x in np.arange(random.uniform(4, 6), length - 2, random.uniform(6, 8)):
        things.append(Thing((pole(random.uniform(0.15, 0.25), height + 0.8, (x, width / 2, 0)),)))
    things.append(Thing((box(length, 0.15, 0.5, (length / 2, width / 2, height + 0.3)),)))
    for y in (0.6, width - 0.6):
        things.append(Thing((pipe(random.uniform(0.15, 0.3), length, (length / 2, y, height - 1.0)),)))
    return things


def _placed(thing: Thing, radius: float, floor: Floor, random: np.random.Generator) -> Thing:
    return thing.placed(floor.take(radius), random.uniform(0, 2 * np.pi))


def _bay(random: np.random.Generator) -> tuple[Thing, float]:
    """Shelves on L-shaped uprights, with drums and packages."""
    bodies: list[Body] = []
    length, depth, levels = random.uniform(2, 4), 0.8, int(random.integers(2, 5))
    for x in (-length / 2, length / 2):
        for y in (-depth / 2, depth / 2):
            bodies += [box(0.06, 0.01, 0.7 * levels, (x, y, 0)), box(0.01, 0.06, 0.7 * levels, (x, y, 0))]
    for level in range(levels):
        bodies.append(box(length, depth, 0.03, (0, 0, 0.7 * level + 0.1)))
        for x in np.arange(-length / 2 + 0.3, length / 2 - 0.2, 0.55):
            if random.random() < 0.5:
                bodies.append(pole(random.uniform(0.1, 0.2), random.uniform(0.2, 0.45), (x, 0, 0.7 * level + 0.13)))
    return Thing(tuple(bodies)), length / 2 + 0.5


def _skid(random: np.random.Generator) -> tuple[Thing, float]:
    """A pallet of closed boards on runners, 1 m by 1.2 m."""
    runners = [box(1.2, 0.08, 0.1, (0, y, 0)) for y in (-0.42, 0, 0.42)]
    return Thing((*runners, box(1.2, 1.0, 0.04, (0, 0, 0.1)))), 0.82


def _package(random: np.random.Generator) -> tuple[Thing, float]:
    """One to three boxes on each other, askew."""
    bodies, base = [], 0.0
    width = random.uniform(0.35, 0.9)
    for _ in range(int(random.integers(1, 4))):
        height = random.uniform(0.2, 0.5)
        bodies.append(box(width, 0.8 * width, height, (*random.uniform(-0.04, 0.04, 2), base), random.normal(0, 0.15)))
        base, width = base + height, 0.9 * width
    return Thing(tuple(bodies)), 0.75


def _bars(random: np.random.Generator) -> tuple[Thing, float]:
    """A pipe, or an L-beam, that lies on blocks."""
    length = random.uniform(1.5, 4.5)
    blocks = [box(0.1, 0.5, 0.08, (x, 0, 0)) for x in (-0.3 * length, 0.3 * length)]
    if random.random() < 0.5:
        long = [pipe(random.uniform(0.03, 0.1), length, (0, 0, 0.08))]
    else:
        side = random.uniform(0.12, 0.25)
        long = [box(length, side, 0.015, (0, 0, 0.08)), box(length, 0.015, side, (0, side / 2, 0.08))]
    return Thing((*long, *blocks)), length / 2 + 0.1


def _drums(random: np.random.Generator) -> tuple[Thing, float]:
    count, radius, height = int(random.integers(1, 4)), random.uniform(0.18, 0.3), random.uniform(0.4, 0.9)
    places = [(0.0, 0.0, 0.0), (2.1 * radius, 0.0, 0.0), (radius, 1.85 * radius, 0.0)][:count]
    return Thing(tuple(pole(radius, height, place) for place in places)), 3.1 * radius


def _sacks(random: np.random.Generator) -> tuple[Thing, float]:
    """A heap of them."""
    bodies = []
    for level in range(int(random.integers(1, 4))):
        half = random.uniform((0.3, 0.2, 0.1), (0.4, 0.28, 0.16))
        turn = Rotation.from_euler("z", random.uniform(0, 3)).as_matrix()
        place = np.append(random.uniform(-0.1, 0.1, 2), half[2] * (1 + 1.5 * level))
        bodies.append(ellipsoid(half, place, turn))
    return Thing(tuple(bodies)), 0.6
