"""Industrial halls from tripods: racks, machines and pipes stay; pallets, boxes and pipes come, go and move."""

import numpy as np

from gmmjax.pair import Pair
from tests.benchmarks.held_out.interiors import Ground, shell
from tests.benchmarks.held_out.meshes import box, cylinder, footprint, joined, placed, shifted
from tests.benchmarks.held_out.sensors import looking, tripod
from tests.benchmarks.held_out.surveys import Rig, Stage, Staged, motion_about, rig_of

# Height of a pallet, metres.
PALLET = 0.144


def hall(random: np.random.Generator, changed: bool, points: int = 400_000) -> Staged:
    """A hall of 30 to 40 m from one to three stations, after from close to those before, or from anywhere."""
    u, stage = random.uniform, Stage(changed)
    length, width, height = u(30, 40), u(12, 20), u(5, 8)
    floor, count = Ground((0, 0, 0), length, width), int(random.integers(1, 4))
    before = _stands(floor, count, random)
    beside = before + np.column_stack([u(-0.5, 0.5, (count, 2)), u(-0.1, 0.1, count)])
    after = beside if random.random() < 0.5 else _stands(floor, count, random)
    stage.stays(*shell(length, width, height, ceiling=True))
    _structure(stage, (length, width, height), random)
    for _ in range(2):
        # Box by box, because most rays pass by most of them.
        stage.stays(*_put_down(_rack(random), floor, random).reshape(-1, 12, 3, 3))
    for _ in range(int(random.integers(3, 7))):
        stage.stays(_put_down(_machine(random), floor, random))
    _goods(stage, floor, random)

    def rig(stands: np.ndarray) -> Rig:
        poses = [looking(at, at + np.append(u(-1, 1, 2), 0)) for at in stands]
        sensor = tripod(points / count, (-180, 180), (-60, 90), 60.0, (0.003, 5e-5))
        return rig_of(sensor, poses, random, off=(0.001, 0.002))

    return Staged(stage, Pair(before, after).map(rig), motion_about(random, 0.003, 0.005), slack=0.02)


def _stands(floor: Ground, count: int, random: np.random.Generator) -> np.ndarray:
    """Along the hall, each in its share of the length; nothing else is put there."""
    shares = (np.arange(count) + random.uniform(0.2, 0.8, count)) / count
    x, y = floor.half[0] * (2 * shares - 1), floor.half[1] * random.uniform(-0.5, 0.5, count)
    for at in zip(x, y, strict=True):
        floor.occupy(at, 1.3)
    return np.column_stack([x, y, random.uniform(1.5, 1.9, count)])


def _structure(stage: Stage, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """Pillars along the long walls, a beam of the roof above each pair of them, pipes and cabinets at the walls."""
    (length, width, height), u = size, random.uniform
    depth, side = u(0.3, 0.6), u(0.25, 0.4)
    for x in np.linspace(-length / 2, length / 2, int(length / u(5, 7)) + 1)[1:-1]:
        at = [(x, sign * (width / 2 - side / 2 - 0.05), 0) for sign in (-1, 1)]
        stage.stays(box(0.2, width, depth, (x, 0, height - depth)), *(box(side, side, height, own) for own in at))
    for number in range(int(random.integers(3, 6))):
        stage.stays(_wall_pipe(size, u(6, length - 2), height - 1.6 - 0.3 * number, random))
    for _ in range(3):
        at = (u(4 - length / 2, length / 2 - 4), random.choice([-1, 1]) * (width / 2 - 0.06), 1.0)
        stage.stays(box(u(0.4, 0.8), 0.12, u(0.6, 1.2), at))
    for number in range(int(random.integers(1, 3))):
        own = _wall_pipe(size, u(1.5, 5), 0.6 + 0.35 * number, random)
        getattr(stage, random.choice(["comes", "goes"]))(own)


def _wall_pipe(
    size: tuple[float, float, float], length: float, height: float, random: np.random.Generator
) -> np.ndarray:
    radius, reach = random.uniform(0.025, 0.1), (size[0] - length) / 2 - 0.3
    y = random.choice([-1, 1]) * (size[1] / 2 - 0.5 - radius)
    return shifted(_pipe(radius, length), (random.uniform(-reach, reach), y, height))


def _pipe(radius: float, length: float) -> np.ndarray:
    """Along x, lying on z = 0."""
    lying = cylinder(radius, length, 14)[..., [2, 0, 1]]
    return shifted(lying, (-length / 2, 0, radius))


def _rack(random: np.random.Generator) -> np.ndarray:
    """A row of bays on uprights, with goods that stay."""
    bays, levels, step = int(random.integers(1, 4)), int(random.integers(2, 4)), random.uniform(1.2, 1.5)
    length, depth = 2.7 * bays, 1.1
    x = np.linspace(-length / 2, length / 2, bays + 1)
    parts = [box(0.1, 0.08, levels * step + 0.3, (a, b, 0)) for a in x for b in (-depth / 2, depth / 2)]
    for level in step * np.arange(1, levels + 1):
        parts += [box(length, 0.05, 0.12, (0, y, level - 0.12)) for y in (-depth / 2, depth / 2)]
        parts.append(box(length, depth, 0.02, (0, 0, level)))
        for a in np.arange(-length / 2 + 0.7, length / 2 - 0.5, 1.35):
            if random.random() < 0.6:
                parts.append(box(*random.uniform((0.5, 0.5, 0.3), (1.1, 0.9, 0.9)), (a, 0, level + 0.02)))
    return joined(*parts)


def _machine(random: np.random.Generator) -> np.ndarray:
    length, depth, height = random.uniform((1.2, 0.8, 0.8), (3.0, 1.6, 1.8))
    hood = box(0.6 * length, 0.7 * depth, 0.4, (-0.1 * length, 0, height))
    stack = shifted(cylinder(random.uniform(0.1, 0.3), 0.6), (0.35 * length, 0, height))
    return joined(box(length, depth, height), hood, stack, shifted(_pipe(0.05, 0.8), (0, -depth / 2 - 0.1, height / 2)))


def _goods(stage: Stage, floor: Ground, random: np.random.Generator) -> None:
    """Pallets, boxes and pipes: some stay, and of each kind at least one comes, goes or moves."""
    for make in (_pallets, _crate, _pipes):
        for _ in range(int(random.integers(3, 7))):
            stage.stays(_put_down(make(random), floor, random))
        for fate in random.permutation(["comes", "goes", "moves"])[: int(random.integers(1, 4))]:
            own = make(random)
            places = [_put_down(own, floor, random) for _ in range(2 if fate == "moves" else 1)]
            getattr(stage, str(fate))(*places)


def _put_down(mesh: np.ndarray, floor: Ground, random: np.random.Generator) -> np.ndarray:
    return placed(mesh, floor.take(footprint(mesh) + 0.1, random), random.uniform(0, 360))


def _pallets(random: np.random.Generator) -> np.ndarray:
    """A pallet, a pile of them, or one that is loaded."""
    count = int(random.choice([1, 1, 2, 4]))
    parts = [shifted(_pallet(), (0, 0, level * PALLET)) for level in range(count)]
    if count == 1 and random.random() < 0.4:
        for x in (-0.3, 0.3):
            parts.append(box(*random.uniform((0.4, 0.4, 0.2), (0.55, 0.75, 0.8)), (x, 0, PALLET)))
    return joined(*parts)


def _pallet() -> np.ndarray:
    """Boards, blocks and boards, 1.2 m by 0.8 m."""
    blocks = [box(0.14, 0.1, 0.078, (x, y, 0.022)) for x in (-0.53, 0, 0.53) for y in (-0.35, 0, 0.35)]
    lower = [box(1.2, 0.1, 0.022, (0, y, 0)) for y in (-0.35, 0, 0.35)]
    across = [box(0.14, 0.8, 0.022, (x, 0, 0.1)) for x in (-0.53, 0, 0.53)]
    upper = [box(1.2, 0.12, 0.022, (0, y, 0.122)) for y in (-0.34, -0.17, 0, 0.17, 0.34)]
    return joined(*lower, *blocks, *across, *upper)


def _crate(random: np.random.Generator) -> np.ndarray:
    """A box of 0.2 to 1 m."""
    size = np.exp(random.uniform(np.log(0.2), np.log(1.0))) * random.uniform(0.75, 1.0, 3)
    return box(*np.clip(size, 0.2, 1.0))


def _pipes(random: np.random.Generator) -> np.ndarray:
    """One that lies on the floor, or three in a pile."""
    radius, length = random.uniform(0.025, 0.1), random.uniform(1.0, 4.0)
    if random.random() >= 0.3:
        return _pipe(radius, length)
    places = [(0, -1.02 * radius, 0), (0, 1.02 * radius, 0), (0, 0, 1.73 * radius)]
    return joined(*(shifted(_pipe(radius, length), at) for at in places))
