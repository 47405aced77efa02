"""Industrial halls: racks, machines, pillars and pipes that stay; pallets, boxes and pipes that come, go and move."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.pair import Pair
from tests.benchmarks.surveyor.scanning import Beam, World
from tests.benchmarks.surveyor.solids import Body, Thing, box, pipe, pole
from tests.benchmarks.surveyor.stages import Floor, Stage
from tests.benchmarks.surveyor.surveys import Site, Station

# Height of a pallet, metres.
PALLET = 0.144


@dataclasses.dataclass(frozen=True)
class Hall:
    """Its inner size, metres; a corner of the floor is at the origin."""

    length: float
    width: float
    height: float


def hall_site(random: np.random.Generator, changed: bool, stations: int | None = None) -> Site:
    """A hall that is scanned from so many stations, after from others: close to those before, or anywhere.

    Args:
        random: of everything.
        changed: whether anything changed.
        stations: None: one to three.
    """
    u, drawn = random.uniform, int(random.integers(1, 4))
    stations = drawn if stations is None else stations
    hall = Hall(u(30, 40), u(12, 20), u(5, 8))
    floor, stage = Floor(hall.length, hall.width, random), Stage(changed)
    before = _stations(hall, floor, stations, random)
    if random.random() < 0.5:
        after = [_beside(station, random) for station in before]
    else:
        after = _stations(hall, floor, stations, random)
    stage.stays(Thing(_shell(hall)), *_structure(hall, random))
    racks = _racks(hall, floor, random)
    stage.stays(*racks, *_machines(floor, random))
    _goods(hall, floor, stage, random)
    return Site(stage.things.map(World), Pair(before, after), Beam(max_range=60.0))


def _stations(hall: Hall, floor: Floor, count: int, random: np.random.Generator) -> list[Station]:
    """Along the hall, each in its share of the length."""
    found = []
    for number in range(count):
        low, high = hall.length * np.array([number + 0.2, number + 0.8]) / count
        middle = hall.width * np.array([0.25, 0.75])

        def in_share(place: np.ndarray, low: float = low, high: float = high, middle: np.ndarray = middle) -> bool:
            return bool(low < place[0] < high and middle[0] < place[1] < middle[1])

        place = floor.take(1.3, in_share)
        found.append(Station(place + np.array([0, 0, random.uniform(1.5, 1.9)])))
    return found


def _beside(station: Station, random: np.random.Generator) -> Station:
    shift = np.append(random.uniform(-0.5, 0.5, 2), random.uniform(-0.1, 0.1))
    return dataclasses.replace(station, position=station.position + shift)


def _shell(hall: Hall) -> tuple[Body, ...]:
    """Floor, ceiling and walls, each 0.3 m thick."""
    length, width, height = hall.length, hall.width, hall.height
    middle = (length / 2, width / 2)
    return (
        box(length + 0.6, width + 0.6, 0.3, (*middle, -0.3)),
        box(length + 0.6, width + 0.6, 0.3, (*middle, height)),
        *(box(0.3, width, height, (x, middle[1], 0)) for x in (-0.15, length + 0.15)),
        *(box(length + 0.6, 0.3, height, (middle[0], y, 0)) for y in (-0.15, width + 0.15)),
    )


def _structure(hall: Hall, random: np.random.Generator) -> list[Thing]:
    """Pillars along the long walls, a beam of the roof above each pair of them, and pipes along the walls."""
    things = []
    depth, side = random.uniform(0.3, 0.6), random.uniform(0.25, 0.4)
    for x in np.linspace(0, hall.length, int(hall.length / random.uniform(5, 7)) + 1)[1:-1]:
        beam = box(0.2, hall.width, depth, (x, hall.width / 2, hall.height - depth))
        pillars = [box(side, side, hall.height, (x, y, 0)) for y in (side / 2 + 0.05, hall.width - side / 2 - 0.05)]
        things += [Thing((beam,)), *(Thing((pillar,)) for pillar in pillars)]
    for number in range(int(random.integers(3, 6))):
        things.append(_wall_pipe(hall, random, random.uniform(6, hall.length - 2), number, high=True))
    for _ in range(3):
        x, y = random.uniform(4, hall.length - 4), random.choice([0.06, hall.width - 0.06])
        things.append(Thing((box(random.uniform(0.4, 0.8), 0.12, random.uniform(0.6, 1.2), (x, y, 1.0)),)))
    return things


def _wall_pipe(hall: Hall, random: np.random.Generator, length: float, number: int, *, high: bool) -> Thing:
    """Along a long wall, at a height of its own."""
    radius = random.uniform(0.025, 0.1)
    x = random.uniform(length / 2 + 0.3, hall.length - length / 2 - 0.3)
    clear = 0.5 + radius
    y = clear if number % 2 else hall.width - clear
    z = (hall.height - 1.6 - 0.3 * number) if high else (0.6 + 0.35 * number)
    return Thing((pipe(radius, length),)).placed((x, y, z))


def _racks(hall: Hall, floor: Floor, random: np.random.Generator) -> list[Thing]:
    """Rows of pallet racks with goods that stay."""
    racks = []
    for _ in range(int(random.integers(2, 4))):
        bays, levels = int(random.integers(1, 4)), int(random.integers(2, 4))
        length, depth, step = 2.7 * bays, 1.1, random.uniform(1.2, 1.5)
        bodies = [
            box(0.1, 0.08, levels * step + 0.3, (x, y, 0))
            for x in np.linspace(-length / 2, length / 2, bays + 1)
            for y in (-depth / 2, depth / 2)
        ]
        for level in range(1, levels + 1):
            bodies += [box(length, 0.05, 0.12, (0, y, level * step - 0.12)) for y in (-depth / 2, depth / 2)]
            bodies.append(box(length, depth, 0.02, (0, 0, level * step)))
            for x in np.arange(-length / 2 + 0.7, length / 2 - 0.5, 1.35):
                if random.random() < 0.6:
                    size = random.uniform((0.5, 0.5, 0.3), (1.1, 0.9, 0.9))
                    bodies.append(box(*size, (x, 0, level * step + 0.02)))
        place = floor.take(length / 2 + 0.6)
        racks.append(Thing(tuple(bodies)).placed(place, random.choice([0, np.pi / 2])))
    return racks


def _machines(floor: Floor, random: np.random.Generator) -> list[Thing]:
    machines = []
    for _ in range(int(random.integers(3, 7))):
        length, depth, height = random.uniform((1.2, 0.8, 0.8), (3.0, 1.6, 1.8))
        bodies = [box(length, depth, height), box(0.6 * length, 0.7 * depth, 0.4, (-0.1 * length, 0, height))]
        bodies.append(pole(random.uniform(0.1, 0.3), 0.6, (0.35 * length, 0, height)))
        bodies.append(pipe(0.05, 0.8, (0, -depth / 2 - 0.1, 0.5 * height)))
        place = floor.take(np.hypot(length, depth) / 2 + 0.2)
        machines.append(Thing(tuple(bodies)).placed(place, random.uniform(0, 2 * np.pi)))
    return machines


def _goods(hall: Hall, floor: Floor, stage: Stage, random: np.random.Generator) -> None:
    """Pallets, boxes and pipes: some stay, and of each kind at least one comes, goes or moves."""
    kinds = (_pallets, _crate, _pipes)
    for make in kinds:
        for _ in range(int(random.integers(3, 7))):
            stage.stays(_on_floor(*make(random), floor, random))
        for fate in random.permutation(["comes", "goes", "moves"])[: int(random.integers(1, 4))]:
            thing, radius = make(random)
            own = _on_floor(thing, radius, floor, random)
            if fate == "moves":
                stage.moves(own, _elsewhere(own, thing, radius, floor, random))
            else:
                getattr(stage, str(fate))(own)
    for number in range(int(random.integers(1, 3))):
        getattr(stage, random.choice(["comes", "goes"]))(
            _wall_pipe(hall, random, random.uniform(1.5, 5), number, high=False)
        )


def _on_floor(thing: Thing, radius: float, floor: Floor, random: np.random.Generator) -> Thing:
    return thing.placed(floor.take(radius), random.uniform(0, 2 * np.pi))


def _elsewhere(own: Thing, thing: Thing, radius: float, floor: Floor, random: np.random.Generator) -> Thing:
    """Anywhere, or pushed aside by about its own size."""
    if random.random() < 0.5:
        return _on_floor(thing, radius, floor, random)
    heading, centre = random.uniform(0, 2 * np.pi), own.sphere[0]
    shift = random.uniform(1.0, 1.6) * 2 * radius * np.array([np.cos(heading), np.sin(heading), 0])
    if not floor.free(centre + shift, radius):
        return _on_floor(thing, radius, floor, random)
    floor.reserve(centre + shift, radius)
    turn = Rotation.from_euler("z", random.normal(0, 0.2)).as_matrix()
    return own.moved(turn, centre + shift - turn @ centre)


def _pallets(random: np.random.Generator) -> tuple[Thing, float]:
    """A pallet, a pile of them, or one that is loaded."""
    bodies: list[Body] = []
    count = int(random.choice([1, 1, 2, 4]))
    for level in range(count):
        bodies += _pallet(level * PALLET)
    if count == 1 and random.random() < 0.4:
        for x in (-0.3, 0.3):
            height = random.uniform(0.2, 0.8)
            bodies.append(box(random.uniform(0.4, 0.55), random.uniform(0.4, 0.75), height, (x, 0, PALLET)))
    return Thing(tuple(bodies)), 0.75


def _pallet(base: float) -> list[Body]:
    """Boards, blocks and boards, 1.2 m by 0.8 m."""
    blocks = [box(0.14, 0.1, 0.078, (x, y, base + 0.022)) for x in (-0.53, 0, 0.53) for y in (-0.35, 0, 0.35)]
    lower = [box(1.2, 0.1, 0.022, (0, y, base)) for y in (-0.35, 0, 0.35)]
    across = [box(0.14, 0.8, 0.022, (x, 0, base + 0.1)) for x in (-0.53, 0, 0.53)]
    upper = [box(1.2, 0.12, 0.022, (0, y, base + 0.122)) for y in (-0.34, -0.17, 0, 0.17, 0.34)]
    return [*lower, *blocks, *across, *upper]


def _crate(random: np.random.Generator) -> tuple[Thing, float]:
    """A box of 0.2 to 1 m."""
    size = np.exp(random.uniform(np.log(0.2), np.log(1.0))) * random.uniform(0.75, 1.0, 3)
    return Thing((box(*np.clip(size, 0.2, 1.0)),)), float(np.hypot(*size[:2])) / 2 + 0.1


def _pipes(random: np.random.Generator) -> tuple[Thing, float]:
    """One that lies on the floor, or three in a pile."""
    radius, length = random.uniform(0.025, 0.1), random.uniform(1.0, 4.0)
    bodies = [pipe(radius, length)]
    if random.random() < 0.3:
        bodies = [pipe(radius, length, (0, y, 0)) for y in (-1.02 * radius, 1.02 * radius)]
        bodies.append(pipe(radius, length, (0, 0, 1.73 * radius)))
    return Thing(tuple(bodies)), length / 2 + 0.15
