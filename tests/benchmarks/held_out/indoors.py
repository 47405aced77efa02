"""Kinds of held-out scenes indoors: rooms, a corridor, a hall, and things that are turned, shifted and opened."""

from collections.abc import Sequence

import numpy as np

from gmmjax.pair import Pair, each
from tests.benchmarks.held_out.casting import Body
from tests.benchmarks.held_out.interiors import Ground, furnish, outside, portable, rearrange, shell
from tests.benchmarks.held_out.meshes import (
    bottle,
    bowl,
    box,
    chair,
    cup,
    cylinder,
    ellipsoid,
    footprint,
    joined,
    open_box,
    placed,
    plate,
    shifted,
    table,
    tube,
)
from tests.benchmarks.held_out.sensors import Sensor, camera, looking, scanner
from tests.benchmarks.held_out.surveys import Rig, Stage, Staged, motion_about, rig_of, shaken

FRAMES = 14


def room(
    random: np.random.Generator, changed: bool, *, lost: float = 0.0, misplaced: tuple[float, float] | None = None
) -> Staged:
    """A furnished room of 3 to 4 m, frames of a depth camera fused.

    Args:
        random: of all.
        changed: whether things come, go and move.
        lost: share of the frames of either survey that are missing, other ones in each.
        misplaced: translation (metres) and rotation (degrees) of the after cloud; None: 1 to 2 cm, up to half a degree.
    """
    stage, floor = _furnished(random, changed)
    sensor = _fused_camera(random, hard=lost > 0)
    dropped = _dropped_runs(random, lost)

    def rig(things: list[Body], dropped: frozenset[int]) -> Rig:
        poses = [pose for number, pose in enumerate(_round(random, floor, things)) if number not in dropped]
        return rig_of(sensor, poses, random, off=(0.003, 0.1), thinned=0.02)

    metres, degrees = misplaced or (random.uniform(0.01, 0.02), random.uniform(0.1, 0.6 if lost else 0.5))
    return Staged(stage, each(rig, stage.worlds, dropped), motion_about(random, metres, degrees))


def misregistered_room(random: np.random.Generator, changed: bool) -> Staged:
    """A room whose second survey is far off in position and heading."""
    return room(random, changed, misplaced=(random.uniform(0.15, 0.4), random.uniform(5, 15)))


def single_frame(random: np.random.Generator, changed: bool) -> Staged:
    """One frame of a depth camera from nearly the same place."""
    stage, floor = _furnished(random, changed, front=False)
    noise = (0.001, 0.0, random.uniform(0.001, 0.002))
    sensor = camera(176, 132, 66.0, 6.0, noise, quantum=4e-4, blur=0.7, mixed=0.06, edge_lost=0.3)
    stand = np.array([random.uniform(-0.3, 0.3), -floor.half[1] + 0.1, random.uniform(1.5, 1.9)])
    target = np.array([0, random.uniform(0.3, 0.7), 0.2])

    def rig(_: object) -> Rig:
        pose = looking(stand + 0.01 * random.standard_normal(3), target + 0.01 * random.standard_normal(3))
        return rig_of(sensor, [pose], random)

    motion = motion_about(random, random.uniform(0.005, 0.02), random.uniform(0, 0.5))
    return Staged(stage, stage.worlds.map(rig), motion)


def station(random: np.random.Generator, changed: bool) -> Staged:
    """A module of a space station: racks on all four sides, handrails, bags that float, and a camera that flies."""
    u, stage = random.uniform, Stage(changed)
    length, half, wall = u(4.0, 5.5), u(0.95, 1.1), 0.1
    for side in range(4):
        plane = box(length, 2 * half, wall, (0, 0, half))
        racks = [_rack(random, x, half) for x in np.arange(-length / 2 + 0.5, length / 2 - 0.4, 1.0)]
        rail = np.array([(x, 0.0, 0.0) for x in (-0.25, 0.0, 0.25)]) + np.array(
            [u(-1.5, 1.5), u(-0.6, 0.6), half - 0.07]
        )
        for part in (plane, *racks, tube(rail, 0.015)):
            stage.stays(_rolled(part, 90.0 * side))
    caps = [_rolled(box(wall, 2 * half, 2 * half, (s * length / 2, 0, -half)), 0) for s in (-1, 1)]
    stage.stays(*caps)
    _bags(stage, random, length, half)
    sensor = camera(80, 60, 76.0, 4.0, (0.003, 0.0, u(0.001, 0.002)), quantum=4e-4, blur=0.7, lost=0.03)

    def rig(things: list[Body]) -> Rig:
        poses = []
        for number in range(20):
            # To and fro through the module, looking ahead and aside.
            at = _free_place(things, random, (2 * (number % 10) / 9 - 1) * (length / 2 - 0.5), half - 0.55)
            angle, onward = 2.4 * number + u(0, 0.3), 1.1 if number < 10 else -1.1
            poses.append(looking(at, at + np.array([onward, np.cos(angle), np.sin(angle)]), u(0, 360)))
        return rig_of(sensor, poses, random, off=(0.003, 0.1), thinned=0.019)

    motion = motion_about(random, u(0.01, 0.02), u(0.1, 0.5))
    return Staged(stage, stage.worlds.map(rig), motion)


def corridor(random: np.random.Generator, changed: bool) -> Staged:
    """A corridor that a walking robot goes through with a spinning lidar; its heading drifts to 0.3 degrees."""
    u, stage = random.uniform, Stage(changed)
    length, width, height = u(12, 16), u(2.0, 2.6), u(2.5, 2.9)
    stage.stays(*shell(length, width, height, ceiling=True))
    for x in np.arange(-length / 2 + 1.5, length / 2 - 1, u(2.5, 3.5)):
        side = random.choice([-1, 1])
        stage.stays(box(0.9, 0.06, 2.0, (x, side * width / 2, 0)))
        if random.random() < 0.6:
            stage.stays(box(0.35, 0.3, height, (x + 0.9, -side * (width / 2 - 0.15), 0)))
        if random.random() < 0.5:
            stage.stays(shifted(cylinder(0.08, 0.5), (x + 0.7, side * (width / 2 - 0.12), 0.4)))
    lane = 0.45
    sides = [Ground((0, s * (width / 2 + lane / 2) / 2, 0), length - 2, width / 2 - lane / 2) for s in (-1, 1)]
    for _ in range(4):
        thing = portable(random, 1.3)
        stage.stays(placed(thing, sides[int(random.integers(2))].take(footprint(thing), random), u(0, 360)))
    rearrange(stage, sides, random, size=1.7)
    columns = 360
    azimuth = np.linspace(-180, 180, columns, endpoint=False)
    elevations = np.linspace(-22, 22, 24)
    # The robot's own back is in the way.
    blocked = (np.abs(azimuth)[None] > 150) & (elevations[:, None] < -4)
    sensor = scanner(
        columns, elevations, 30.0, (0.012,), slanted=0.15, mixed=0.03, grazing=0.04, lost=0.05, blocked=blocked
    )
    stations = np.linspace(-length / 2 + 1.5, length / 2 - 1.5, 9)

    def rig(_: object) -> Rig:
        drift = random.choice([-1, 1]) * 0.3 * np.linspace(0, 1, len(stations))
        poses, believed = [], []
        for x, degrees in zip(stations + random.normal(0, 0.15, len(stations)), drift, strict=True):
            at = np.array([x, random.normal(0, 0.06), 0.75 + random.normal(0, 0.02)])
            ahead = np.array([1, random.normal(0, 0.05), random.normal(0, 0.03)])
            pose = looking(at, at + ahead, random.normal(0, 1.5))
            poses.append(pose)
            start = np.array([stations[0], 0, 0.75])
            believed.append(shaken(_turn_about(start, float(degrees)) @ pose, random, 0.005, 0.03))
        return Rig(sensor, np.stack(poses), np.stack(believed), 0.025)

    motion = motion_about(random, u(0.01, 0.03), u(0, 0.2), (stations[0], 0, 0.75))
    return Staged(stage, stage.worlds.map(rig), motion, slack=0.06)


def two_sensors(random: np.random.Generator, changed: bool) -> Staged:
    """A terrestrial scanner before, a depth camera with a tenth of its points after."""
    stage, floor = _furnished(random, changed)
    dense = scanner(320, np.linspace(-62, 50, 108), 20.0, (0.002,), slanted=0.1, mixed=0.05, grazing=0.05)
    sparse = camera(26, 20, 70.0, 5.0, (0.004, 0.0, random.uniform(0.001, 0.002)), blur=0.7, mixed=0.05)
    stands = [_stand(floor, stage.worlds.before, random, s, 1.4) for s in (-1, 1)]
    upright = [
        looking(at, at + np.array([np.cos(angle), np.sin(angle), 0]))
        for at, angle in zip(stands, (0.3, 2.0), strict=True)
    ]
    before = rig_of(dense, upright, random, off=(0.001, 0.02))
    after = rig_of(sparse, _round(random, floor, stage.worlds.after), random, off=(0.003, 0.1))
    motion = motion_about(random, random.uniform(0.005, 0.015), random.uniform(0, 0.4))
    return Staged(stage, Pair(before, after), motion)


def half_overlap(random: np.random.Generator, changed: bool) -> Staged:
    """A long hall; the one survey covers the one two thirds of it, the other the other."""
    u, stage = random.uniform, Stage(changed)
    length, width = u(9, 11), u(3.2, 4.2)
    stage.stays(*shell(length, width, 2.6, ceiling=False))
    middle = Ground((0, 0, 0), length / 4, width - 0.6)
    rearrange(stage, [middle], random, size=1.1)
    for side in (-1, 1):
        furnish(stage, Ground((side * length / 3, 0, 0), length / 3, width), random, pieces=4)
    sensor = camera(88, 66, 74.0, 4.2, (0.003, 0.0, u(0.001, 0.0018)), quantum=4e-4, blur=0.7)

    def rig(side: int) -> Rig:
        poses = []
        for number in range(FRAMES + 2):
            share = number / (FRAMES + 1)
            at = np.array(
                [side * (share * length / 2 * 0.92 - length / 16), random.choice([-1, 1]) * 0.35 * width, u(1.3, 1.7)]
            )
            target = np.array([at[0] + u(-0.9, 0.9), -at[1] * u(0, 1), u(0, 0.4)])
            poses.append(looking(at, target))
        return rig_of(sensor, poses, random, off=(0.003, 0.1), thinned=0.024)

    motion = motion_about(random, u(0.01, 0.02), u(0, 0.4))
    return Staged(stage, Pair(-1, 1).map(rig), motion)


def turned_chair(random: np.random.Generator, changed: bool) -> Staged:
    """A desk with chairs, one of which is turned by 30 degrees where it stands."""
    u, stage = random.uniform, Stage(changed)
    floor = _corner(stage, random)
    stage.stays(placed(table(1.4, 0.7, 0.73), (0.3, 0.75, 0)))
    own = chair(u(0.42, 0.5), u(0.42, 0.47), u(0.4, 0.5))
    at, heading = np.array([u(-0.4, 0.2), -0.1, 0]), u(-40, 40)
    turn = 30.0 * random.choice([-1, 1])
    stage.moves(placed(own, at, heading), placed(own, at, heading + turn))
    stage.stays(placed(chair(), (0.85, -0.25, 0), u(0, 360)))
    return _close_up(stage, floor, random, reach=1.7, columns=120)


def shifted_box(random: np.random.Generator, changed: bool, *, metres: float) -> Staged:
    """Boxes on the floor of a corner of a room, one of which is shifted."""
    u, stage = random.uniform, Stage(changed)
    floor = _corner(stage, random)
    ground = Ground((0, 0.1, 0), 1.8, 1.5)
    own = box(u(0.25, 0.45), u(0.25, 0.4), u(0.2, 0.4))
    at, heading, direction = ground.take(footprint(own) + metres, random), u(0, 360), u(0, 2 * np.pi)
    by = metres * np.array([np.cos(direction), np.sin(direction), 0])
    stage.moves(placed(own, at, heading), placed(own, at + by, heading))
    for _ in range(3):
        other = portable(random, 0.9)
        stage.stays(placed(other, ground.take(footprint(other), random), u(0, 360)))
    return _close_up(stage, floor, random, reach=1.6, columns=140)


def laid_table(random: np.random.Generator, changed: bool) -> Staged:
    """A table of cups, bowls, plates and bottles, one or two of which come or go, seen from near by."""
    u, stage = random.uniform, Stage(changed)
    stage.stays(box(4, 4, 0.05, (0, 0, -0.05)), table(1.2, 0.8, 0.72))
    stage.stays(box(4, 0.1, 2, (0, 1.2, 0)))
    top = Ground((0, 0, 0.72), 1.0, 0.6)
    crockery = (
        lambda: cup(u(0.035, 0.045), u(0.08, 0.11)),
        lambda: bowl(u(0.07, 0.11), u(0.05, 0.08)),
        lambda: plate(u(0.09, 0.13)),
        lambda: bottle(u(0.03, 0.045), u(0.18, 0.28)),
    )
    # A plate is no thicker than the noise; cups, bowls and bottles change.
    fates = ["comes", "goes"][int(random.integers(2)) :] if changed else []
    for number in range(int(random.integers(6, 9))):
        fate = fates[number] if number < len(fates) else "stays"
        kind = [0, 1, 3][int(random.integers(3))] if fate != "stays" else int(random.integers(4))
        thing = crockery[kind]()
        getattr(stage, fate)(placed(thing, top.take(footprint(thing), random), u(0, 360)))
    sensor = camera(190, 142, 56.0, 2.2, (0.0006, 0.0, u(0.0008, 0.0014)), quantum=3e-4, blur=0.7)

    def rig(_: object) -> Rig:
        angles = np.array([-2.2, -1.57, -0.9]) + random.normal(0, 0.05, 3)
        poses = [
            looking((1.05 * np.cos(a), 1.05 * np.sin(a), u(1.35, 1.5)), 0.05 * random.standard_normal(3) + (0, 0, 0.7))
            for a in angles
        ]
        return rig_of(sensor, poses, random, off=(0.001, 0.05), thinned=0.005)

    motion = motion_about(random, u(0.003, 0.008), u(0, 0.3), (0, 0, 0.7))
    return Staged(stage, stage.worlds.map(rig), motion, slack=0.012)


def opened_door(random: np.random.Generator, changed: bool) -> Staged:
    """A door of a room is opened; what is behind it comes into sight."""
    u, stage = random.uniform, Stage(changed)
    width, depth, doorway = u(3, 4), u(2.8, 3.4), u(0.8, 0.95)
    stage.stays(*shell(width, depth, 2.4, ceiling=False, doorway=doorway))
    beyond = box(width, 1.4, 0.1, (0, depth / 2 + 0.8, -0.1))
    stage.stays(beyond, box(width, 0.1, 2.4, (0, depth / 2 + 1.5, 0)))
    leaf = box(doorway - 0.02, 0.04, 1.98, (doorway / 2, 0, 0.01))
    bar = tube(np.array([(0.0, 0, 0), (0, -0.06, 0), (0.1, -0.06, 0)]), 0.012, 6)
    handle = shifted(bar, (doorway - 0.12, -0.02, 1))
    hinge, first = np.array([-doorway / 2, depth / 2 + 0.03, 0]), u(0, 5)
    angles = (first, first + u(25, 80))
    if random.random() < 0.5:
        angles = angles[::-1]
    door = joined(leaf, handle)
    stage.moves(*(placed(door, hinge, -angle) for angle in angles))
    floor = Ground((0, -0.5, 0), width, depth - 1.2)
    furnish(stage, floor, random, pieces=2)
    sensor = camera(96, 72, 70.0, 5.5, (0.002, 0.0, u(0.001, 0.0015)), quantum=4e-4, blur=0.7)

    def rig(things: list[Body]) -> Rig:
        poses = [
            looking(
                (u(-0.35, 0.35) * width, u(-0.35, 0.0) * depth, u(1.3, 1.7)), (u(-0.7, 0.7), depth / 2, u(0.3, 1.5))
            )
            for _ in range(6)
        ]
        around = _round(random, Ground((0, 0, 0), width, depth), things)[::2]
        return rig_of(sensor, [*poses, *around], random, off=(0.003, 0.1), thinned=0.02)

    return Staged(stage, stage.worlds.map(rig), motion_about(random, u(0.005, 0.015), u(0, 0.4)))


def pulled_drawer(random: np.random.Generator, changed: bool) -> Staged:
    """A drawer of a chest is pulled out."""
    u, stage = random.uniform, Stage(changed)
    floor = _corner(stage, random)
    width, depth, height, number = u(0.7, 0.9), 0.45, u(0.7, 0.9), int(random.integers(3, 5))
    chest, back = np.array([u(-0.3, 0.3), 0.0, 0]), 1.2 - depth / 2
    each_height, wall = (height - 0.06) / number, 0.02
    sides = [box(wall, depth, height, (s * (width - wall) / 2, 0, 0)) for s in (-1, 1)]
    boards = [box(width, depth, wall, (0, 0, z)) for z in (0.02, height)]
    stage.stays(shifted(joined(*sides, *boards), chest + np.array([0, back, 0])))
    which = int(random.integers(1, number))
    for level in range(number):
        drawer = joined(
            open_box(width - 2 * wall - 0.01, depth - 0.04, each_height - 0.05),
            box(width, 0.02, each_height - 0.01, (0, -depth / 2, 0)),
        )
        place = chest + np.array([0, back, 0.05 + level * each_height])
        if level == which:
            pulled = shifted(drawer, place - (0, u(0.12, 0.3), 0))
            stage.moves(shifted(drawer, place), pulled)
        else:
            stage.stays(shifted(drawer, place))
    thing = portable(random, 0.7)
    stage.stays(placed(thing, (-0.8, 0.0, 0), u(0, 360)))
    return _close_up(stage, floor, random, reach=1.6, columns=120)


def _furnished(random: np.random.Generator, changed: bool, *, front: bool = True) -> tuple[Stage, Ground]:
    """A room with furniture; without its wall at -y a single frame can look in."""
    stage = Stage(changed)
    width, depth = random.uniform(3.0, 4.0), random.uniform(2.8, 3.6)
    walls = shell(width, depth, random.uniform(2.2, 2.5), ceiling=False)
    stage.stays(*(wall for wall in walls if front or wall[..., 1].max() > -depth / 2 + 0.01))
    floor = Ground((0, 0, 0), width, depth)
    tops = furnish(stage, floor, random, pieces=int(random.integers(4, 7)))
    rearrange(stage, [floor, *tops], random)
    return stage, floor


def _fused_camera(random: np.random.Generator, *, hard: bool) -> Sensor:
    noise = random.uniform(0.0018, 0.0024) if hard else random.uniform(0.0008, 0.0018)
    settings = {"quantum": 4e-4, "blur": 0.7, "slanted": 0.2, "mixed": 0.06, "edge_lost": 0.3, "lost": 0.03}
    return camera(88, 66, 74.0, 4.5, (0.002, 0.0, noise), **settings)


def _dropped_runs(random: np.random.Generator, share: float) -> Pair[frozenset[int]]:
    """Of either survey one run of frames, none of them in both."""
    number, start = round(share * FRAMES), int(random.integers(FRAMES))
    second = start + int(random.integers(number, FRAMES - number + 1)) if number else start
    return Pair(start, second).map(lambda first: frozenset((first + step) % FRAMES for step in range(number)))


def _round(random: np.random.Generator, floor: Ground, things: Sequence[Body]) -> list[np.ndarray]:
    """Frames from a round through the room: most look across it and down, every third one along the walls."""
    poses, start = [], random.uniform(0, 2 * np.pi)
    for number in range(FRAMES):
        angle = start + 2 * np.pi * number / FRAMES
        around = np.array([np.cos(angle), np.sin(angle)]) * floor.half
        for _ in range(20):
            at = np.array([*(around * random.uniform(0.5, 0.75)), random.uniform(1.25, 1.75)])
            if outside(things, at):
                break
        low = number % 3 > 0
        share = random.uniform(-0.6, 0.1) if low else -0.9
        aside = random.normal(0, 0.25, 2)
        poses.append(looking(at, np.array([*(around * share + aside), random.uniform(0, 0.3) if low else 0.8])))
    return poses


def _stand(floor: Ground, things: Sequence[Body], random: np.random.Generator, side: int, height: float) -> np.ndarray:
    for _ in range(50):
        at = np.array(
            [side * random.uniform(0.3, 0.6) * floor.half[0], random.uniform(-0.5, 0.5) * floor.half[1], height]
        )
        if outside(things, at):
            break
    return at


def _free_place(things: Sequence[Body], random: np.random.Generator, x: float, half: float) -> np.ndarray:
    for _ in range(50):
        at = np.array([x + random.normal(0, 0.15), *random.uniform(-half, half, 2)])
        if outside(things, at, 0.25):
            break
    return at


def _rack(random: np.random.Generator, x: float, half: float) -> np.ndarray:
    """One that stands off a wall at z = half, by a few centimetres."""
    width, depth, height = random.uniform(0.6, 0.9), random.uniform(0.8, 1.4), random.uniform(0.03, 0.16)
    return box(width, depth, height, (x, random.uniform(-0.2, 0.2), half - height))


def _rolled(triangles: np.ndarray, degrees: float) -> np.ndarray:
    """About the x axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return triangles @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def _bags(stage: Stage, random: np.random.Generator, length: float, half: float) -> None:
    """Cargo bags and other things, turned any way; some of them come, go and drift elsewhere."""
    ground = Ground((0, 0, 0), length - 1.0, 2 * half - 0.5)

    def floating(bag: np.ndarray) -> np.ndarray:
        reach = float(np.linalg.norm(bag, axis=2).max())
        at = ground.take(reach, random) + np.array([0, 0, random.uniform(-1, 1) * max(half - 0.2 - reach, 0.05)])
        axes = np.linalg.qr(random.standard_normal((3, 3)))[0]
        return shifted(bag @ (axes * np.sign(np.linalg.det(axes))), at)

    def bag() -> np.ndarray:
        u = random.uniform
        if random.random() < 0.6:
            size = (0.42, 0.5, 0.25) if random.random() < 0.5 else (0.25, 0.42, 0.25)
            return box(*size, (0, 0, -size[2] / 2))
        extent = (u(0.25, 0.4), u(0.2, 0.3), u(0.2, 0.3))
        return shifted(ellipsoid(*extent), (0, 0, -extent[2] / 2))

    for _ in range(int(random.integers(1, 3))):
        stage.stays(floating(bag()))
    for fate in ("comes", "goes", "moves")[: int(random.integers(1, 4))]:
        own = bag()
        if fate == "moves":
            stage.moves(floating(own), floating(own))
        else:
            getattr(stage, fate)(floating(own))


def _turn_about(centre: np.ndarray, degrees: float) -> np.ndarray:
    """The rigid motion [4, 4] about the vertical through a place."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    motion = np.eye(4)
    motion[:2, :2] = [[c, -s], [s, c]]
    motion[:3, 3] = centre - motion[:3, :3] @ centre
    return motion


def _corner(stage: Stage, random: np.random.Generator) -> Ground:
    """A floor, a wall at +y and one at +x."""
    stage.stays(box(5, 5, 0.1, (0, 0, -0.1)))
    stage.stays(box(5, 0.1, 2.2, (0, 1.25, 0)))
    stage.stays(box(0.1, 5, 2.2, (random.uniform(1.4, 1.8), 0, 0)))
    return Ground((0, 0, 0), 2.4, 2.4)


def _close_up(stage: Stage, floor: Ground, random: np.random.Generator, *, reach: float, columns: int) -> Staged:
    """Five frames from a half circle around the middle."""
    u = random.uniform
    sensor = camera(columns, columns * 3 // 4, 64.0, 4.0, (0.001, 0.0, u(0.0006, 0.001)), quantum=2.5e-4, blur=0.7)

    def rig(_: object) -> Rig:
        angles = np.radians([-165, -125, -90, -55, -25]) + random.normal(0, 0.06, 5)
        poses = [
            looking(
                (reach * np.cos(a), reach * np.sin(a) + 0.1, u(1.2, 1.5)),
                np.array([0.1, 0.3, 0.25]) + random.normal(0, 0.06, 3),
            )
            for a in angles
        ]
        return rig_of(sensor, poses, random, off=(0.0015, 0.05), thinned=0.012)

    centre = (*floor.centre[:2], 0.3)
    return Staged(stage, stage.worlds.map(rig), motion_about(random, u(0.004, 0.01), u(0, 0.3), centre), slack=0.02)
