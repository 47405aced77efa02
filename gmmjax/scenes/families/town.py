"""Blocks of houses with trees, cars and containers, seen from an aircraft or from a car in the street."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families.scanners import flown_over
from gmmjax.scenes.families.staging import Arrangement, Support
from gmmjax.scenes.families.things import chance, cuboid, footprint, moved, pillar
from gmmjax.scenes.laser_scanner import Beam, SpinningLidar
from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.recording import PoseErrors, Recording
from gmmjax.scenes.rigid_motions import turned, upright
from gmmjax.scenes.shapes import Ground, Vegetation
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


def town(random: np.random.Generator) -> SurveyedScene:
    """A block of 60 to 200 m, surveyed twice from an aircraft, or by a spinning lidar on a car.

    Cars and containers come, go and are driven on, houses are built, extended and pulled down, trees felled; nothing
    changes in a third of the scenes. Trees show other leaves in each survey.
    """
    flown = chance(random, 0.5)
    # More of the small ones: of a car in a large one there are but a few points.
    edge = 60.0 * (200 / 60 if flown else 2.0) ** (random.random() ** 2)
    arrangement = Arrangement()
    arrangement.stays([_ground(random, edge)])
    # Half the width of the street along x, kerb to kerb with its parked cars.
    street = random.uniform(4.5, 7.0)
    plot = Support(np.eye(4), (edge, edge), gap=0.5)
    changing = not chance(random, 1 / 3)
    houses = _houses(random, arrangement, plot, street, 0.08 if changing else 0.0)
    if changing and houses and chance(random, 0.25):
        arrangement.change(after=_extension(random, houses[int(random.integers(len(houses)))]))
    _parked(random, arrangement, edge, street, changing)
    _yards(random, arrangement, plot, street, changing)
    if changing and not arrangement.changes:
        arrangement.change(after=moved(_car(random), turned(0.0, (random.uniform(-0.3, 0.3) * edge, 0.8, 0.0))))
    noise, reach = random.uniform(0.01, 0.04), random.uniform(40.0, 80.0)
    mixed, lost = random.uniform(0.0, 0.2), random.uniform(0.0, 0.1)
    beam = Beam(noise=noise, growth=0.0, max_range=reach, mixed=mixed, edge=0.5, lost=lost)
    if flown:
        recordings = flown_over(random, arrangement.solids, edge, beam, random.uniform(25_000, 40_000))
    else:
        recordings = _driven(random, arrangement.solids, edge, beam)
    frame = Frame.drawn(random, shift=random.uniform(0.0, 0.3), degrees=0.1 if flown else 0.3)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=0.05 + 3 * beam.noise)


def _ground(random: np.random.Generator, edge: float) -> Solid:
    """Level within some centimetres, with a slope or none."""
    nodes = 25
    slope = random.uniform(-0.03, 0.03, 2) if chance(random, 0.5) else np.zeros(2)
    steps = np.linspace(-0.5, 0.5, nodes) * 2 * edge
    heights = slope[0] * steps[:, None] + slope[1] * steps[None, :] + 0.02 * random.standard_normal((nodes, nodes))
    return Ground(np.zeros(3), np.array([2 * edge, 2 * edge, 2 * np.abs(heights).max() + 0.1]), heights=heights)


def _houses(
    random: np.random.Generator, arrangement: Arrangement, plot: Support, street: float, turnover: float
) -> list[tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]]:
    """Rows of houses on both sides of the street, a share of which comes or goes; pose and body of those that stay."""
    edge, houses = plot.size[0], []
    row = street + random.uniform(2.0, 7.0) + 6.0
    while row < edge / 2 - 4.0:
        for side in (-1.0, 1.0):
            along = -edge / 2 + random.uniform(4.0, 12.0)
            while along < edge / 2 - 5.0:
                extent = random.uniform([7.0, 7.0, 3.0], [20.0, 12.0, 10.0])
                along += extent[0] / 2
                if chance(random, 0.8):
                    pose = turned(random.uniform(-0.08, 0.08), (along, side * row, 0.0))
                    house = moved(_house(random, extent), pose)
                    plot.taken.append((pose[:2, 3], float(np.hypot(*extent[:2])) / 2))
                    if chance(random, turnover):
                        arrangement.comes_or_goes(house, comes=chance(random, 0.5))
                    else:
                        arrangement.stays(house)
                        houses.append((pose, extent))
                along += extent[0] / 2 + random.uniform(2.0, 14.0)
        row += random.uniform(22.0, 40.0)
    return houses


def _house(random: np.random.Generator, extent: Float[np.ndarray, "3"]) -> StandingObject:
    """Walls under a flat roof or under a ridge along x, with a chimney or without."""
    wide, deep, tall = extent
    # The foundation reaches below the ground, which is not level.
    parts = [cuboid((0.0, 0.0, tall / 2 - 1.0), (wide, deep, tall + 2.0))]
    if chance(random, 0.3):
        return tuple(parts)
    pitch, eaves = np.radians(random.uniform(20, 48)), random.uniform(0.2, 0.6)
    slant = (deep / 2 + eaves) / np.cos(pitch)
    for side in (-1.0, 1.0):
        middle = np.array([0.0, side * (deep / 2 + eaves) / 2, tall + (deep / 2 - eaves) / 2 * np.tan(pitch)])
        parts.append(Solid(middle, np.array([wide + 2 * eaves, slant, 0.15]), axes=_about_x(-side * pitch)))
    gable = np.linspace(0.15, 0.85, 3)
    rise = deep / 2 * np.tan(pitch)
    for share in gable:
        parts.append(cuboid((0.0, 0.0, tall + share * rise), (wide, deep * (1 - share), rise / 3)))
    if chance(random, 0.5):
        parts.append(cuboid((random.uniform(-0.3, 0.3) * wide, 0.1 * deep, tall + rise), (0.7, 0.7, 1.6)))
    return tuple(parts)


def _about_x(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _extension(random: np.random.Generator, house: tuple[np.ndarray, np.ndarray]) -> StandingObject:
    """Extension of a house at one of its long sides."""
    pose, extent = house
    size = random.uniform([3.0, 2.5, 2.4], [6.0, 5.0, 3.5])
    side = float(random.choice([-1.0, 1.0]))
    along = random.uniform(-0.5, 0.5) * max(extent[0] - size[0], 0.0)
    middle = (along, side * (extent[1] + size[1]) / 2, size[2] / 2 - 0.5)
    return moved((cuboid(middle, size + np.array([0.0, 0.0, 1.0])),), pose)


def _car(random: np.random.Generator) -> StandingObject:
    """A body with a cabin, or a van, on two pairs of wheels, along x."""
    wheels = pillar(0.64, 1.7, (0.0, 0.0, -0.85))
    under = [wheels.moved(_on_side((x, 0.0, 0.32))) for x in (-1.35, 1.35)]
    if chance(random, 0.25):
        extent = random.uniform([4.8, 1.9, 1.7], [6.5, 2.1, 2.5])
        return cuboid((0.0, 0.0, 0.25 + extent[2] / 2), extent), *under
    extent = random.uniform([3.6, 1.6, 0.6], [4.9, 1.9, 0.75])
    cabin = extent * random.uniform([0.45, 0.85, 0.8], [0.6, 0.92, 1.0])
    roof = 0.25 + extent[2] + cabin[2] / 2
    back = random.uniform(-0.15, 0.05) * extent[0]
    return cuboid((0.0, 0.0, 0.25 + extent[2] / 2), extent), cuboid((back, 0.0, roof), cabin), *under


def _on_side(place: tuple[float, float, float]) -> Float[np.ndarray, "4 4"]:
    """The motion that lays an upright cylinder along y, at a place."""
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = _about_x(np.pi / 2), place
    return motion


def _container(random: np.random.Generator) -> StandingObject:
    """Container of 20 feet, or a skip."""
    extent = np.array([6.06, 2.44, 2.6]) if chance(random, 0.6) else random.uniform([3.0, 1.6, 1.1], [4.5, 2.0, 1.8])
    return (cuboid((0.0, 0.0, extent[2] / 2), extent),)


def _tree(random: np.random.Generator) -> StandingObject:
    """A trunk below one to three crowns."""
    tall = random.uniform(3.0, 16.0)
    wide, free_path = tall * random.uniform(0.3, 0.6), random.uniform(0.3, 2.5)
    parts: list[Solid] = [pillar(random.uniform(0.15, 0.6), 0.6 * tall, (0.0, 0.0, -0.3))]
    for _ in range(int(random.integers(1, 4))):
        extent = np.array([wide, wide, 0.65 * tall]) * random.uniform(0.6, 1.0, 3)
        aside = 0.15 * wide * random.standard_normal(2)
        parts.append(Vegetation(np.array([*aside, tall - extent[2] / 2]), extent, free_path=free_path))
    return tuple(parts)


def _parked(random: np.random.Generator, arrangement: Arrangement, edge: float, street: float, changing: bool) -> None:
    """Cars along both kerbs, some of which come and go; on the carriageway there is none but in motion."""
    share = random.uniform(0.2, 0.8)
    turnover = random.uniform(0.05, 0.35) if changing else 0.0
    for side in (-1.0, 1.0):
        along = -edge / 2 + random.uniform(2.0, 8.0)
        while along < edge / 2 - 4.0:
            if chance(random, share):
                place = (along, side * (street - 1.2 + random.uniform(-0.15, 0.15)), 0.0)
                car = moved(_car(random), turned(random.uniform(-0.06, 0.06), place))
                _leaves_or_stays(random, arrangement, car, turnover)
            along += random.uniform(6.2, 9.0)


def _leaves_or_stays(
    random: np.random.Generator, arrangement: Arrangement, thing: StandingObject, turnover: float
) -> None:
    """It changes with this probability; it goes, comes, or is exchanged for another car near its place."""
    if not chance(random, turnover):
        arrangement.stays(thing)
        return
    kind = str(random.choice(["comes", "goes", "shifted"], p=[0.45, 0.45, 0.1]))
    if kind == "shifted":
        arrangement.moves(thing, turned(0.0, (random.uniform(-1.2, 1.2), 0.0, 0.0)))
    else:
        arrangement.comes_or_goes(thing, comes=kind == "comes")


def _yards(random: np.random.Generator, arrangement: Arrangement, plot: Support, street: float, changing: bool) -> None:
    """Trees, containers and cars about the houses, off the street."""
    turnover = random.uniform(0.02, 0.2) if changing else 0.0
    things = [_tree] * int(random.integers(3, 35)) + [_container] * int(random.integers(0, 4))
    things += [_car] * int(random.integers(0, 6))
    if changing and chance(random, 0.5):
        things.insert(0, _container)
    for make in things:
        thing = make(random)
        pose = plot.pose(random, thing)
        if pose is None or abs(pose[1, 3]) < street + footprint(thing):
            continue
        standing = moved(thing, pose)
        if make is _tree:
            # A tree is felled, none comes.
            (arrangement.change if chance(random, 0.3 * turnover) else arrangement.stays)(standing)
        else:
            _leaves_or_stays(random, arrangement, standing, 3 * turnover)


def _driven(random: np.random.Generator, scenes: Pair[list[Solid]], edge: float, beam: Beam) -> Pair[Recording]:
    """A revolution of the lidar every some metres of the street; the second drive is not quite the first."""
    scanner = SpinningLidar(
        beam,
        rings=int(random.choice([16, 32])),
        vertical=random.uniform(26.0, 42.0),
        columns=int(random.integers(240, 480)),
    )
    step = random.uniform(0.06, 0.12) * edge
    drift = PoseErrors(0.01, 0.02, random.uniform(0.0, 0.15), random.uniform(0.0, 0.2))
    height, most = random.uniform(1.7, 2.4), int(random.uniform(15_000, 40_000))

    def drive(solids: list[Solid]) -> Recording:
        along = np.arange(-0.4 * edge, 0.4 * edge, step) + random.uniform(0, step)
        lane = random.uniform(-1.0, 1.0) + 0.1 * random.standard_normal(len(along))
        places = np.column_stack([along, lane, np.full(len(along), height)])
        poses = np.stack([upright(place, 0.0) for place in places])
        return scanner.recording(solids, poses, random, drift).thinned(most, random)

    return each(drive, scenes)
