"""Ground, and things on it, of which a volume that is known by construction comes or goes between two surveys."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from gmmjax.changes.config import RegistrationMode
from gmmjax.geometry import transformed
from gmmjax.pair import Pair, each
from gmmjax.scenes.families.scanners import Flight
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam, TripodScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.shapes import Ellipsoid, Ground
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

NODES = 241
# From everything random, the solids, the edge of the ground, the noise, about how many points, and the ground.
Survey = Callable[[np.random.Generator, Pair[list[Solid]], float, float, float, Ground], Pair[Recording]]


@dataclasses.dataclass(frozen=True, eq=False)
class VolumeScene:
    """Two surveys and the volume between them.

    Attributes:
        kind: of change, a key of `KINDS`.
        survey: both clouds with their views.
        volume: that was gained (positive) or lost, in the cube of the unit of the clouds.
        place: the middle of what changed, in the before cloud's coordinates.
        reach: how far it reaches from there.
        registration: the mode that suits the scene.
    """

    kind: str
    survey: SurveyedScene
    volume: float
    place: Float[np.ndarray, "3"]
    reach: float
    registration: RegistrationMode


@dataclasses.dataclass(frozen=True)
class Truth:
    """What changed, in the true frame, metres.

    Attributes:
        kind: of change, a key of `KINDS`.
        volume: that was gained (positive) or lost.
        place: its middle.
        reach: how far it reaches from there.
    """

    kind: str
    volume: float
    place: Float[np.ndarray, "3"]
    reach: float


def rough(random: np.random.Generator, cells: float, height: float) -> np.ndarray:
    """Smooth random heights of a standard deviation, correlated over so many cells."""
    part = gaussian_filter(random.standard_normal((NODES, NODES)), cells, mode="wrap")
    return part * (height / part.std())


def slope(random: np.random.Generator, edge: float, steepest: float, relief: float) -> np.ndarray:
    """Heights of a slope with a relief of three scales."""
    total = np.linspace(-0.5, 0.5, NODES)[None, :] * edge * np.tan(np.radians(random.uniform(0, steepest)))
    for cells, height in ((0.25, 0.03), (0.05, 0.006), (0.012, 0.0015)):
        total = total + rough(random, cells * NODES, relief * random.random() * height * edge)
    return total - (total.min() + total.max()) / 2


def local(edge: float, middle: np.ndarray, radii: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of the nodes about a middle, in radii along turned axes."""
    line = np.linspace(-0.5, 0.5, NODES) * edge
    x, y = np.meshgrid(line - middle[0], line - middle[1], indexing="ij")
    cos, sin = np.cos(angle), np.sin(angle)
    return (cos * x + sin * y) / radii[0], (cos * y - sin * x) / radii[1]


def lens(random: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Thickest in the middle, thinning out to nothing."""
    return np.clip(1 - u**2 - v**2, 0, None)


def tongue(random: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A lobe that thins out slowly to one side, with a bumpy surface."""
    profile = np.clip(1 - u**2 - v**2, 0, None) * (1 + 0.6 * u)
    return profile * np.clip(1 + rough(random, 4.0, 0.15), 0.2, None)


def cone(random: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A stockpile with a rounded top."""
    return np.clip(1.05 - np.sqrt(u**2 + v**2 + 0.05**2), 0, None)


def plate(random: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Of one thickness, with a steep rim of uneven outline."""
    reach = 1 + rough(random, 12.0, 0.12) - np.sqrt(u**2 + v**2)
    return np.clip(reach / 0.08, 0, 1)


@dataclasses.dataclass(frozen=True)
class Shape:
    """How much ground comes or goes.

    Attributes:
        profile: thickness by place, at most about 1.
        thickness: from and to, in metres at an edge of 30 m.
        sign: 1 comes, -1 goes.
        radius: from and to, in edges of the ground.
    """

    profile: Callable[[np.random.Generator, np.ndarray, np.ndarray], np.ndarray]
    thickness: tuple[float, float]
    sign: int
    radius: tuple[float, float] = (0.06, 0.15)


def ridge(random: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Long and narrow, rounded at its crest, with ends that thin out."""
    return np.clip(1 - (u / 1.3) ** 2, 0, None) * np.exp(-(((v - 0.2 * np.sin(2 * u)) / 0.35) ** 2) / 2)


GROUND_KINDS: Mapping[str, Shape] = {
    "deposit": Shape(lens, (0.15, 0.5), 1),
    "lobe": Shape(tongue, (0.2, 0.6), 1),
    "stockpile": Shape(cone, (0.8, 2.5), 1),
    "erosion": Shape(lens, (0.1, 0.3), -1, (0.08, 0.18)),
    "scar": Shape(plate, (0.15, 0.6), -1),
    "excavation": Shape(plate, (0.5, 1.2), -1),
}
# Of these nothing was developed on: the figures of docs/results.md.
HELD_OUT_GROUND: Mapping[str, Shape] = {
    "embankment": Shape(ridge, (0.4, 1.2), 1, (0.08, 0.18)),
    "gully": Shape(ridge, (0.2, 0.6), -1, (0.08, 0.18)),
    "fill": Shape(plate, (0.15, 0.5), 1),
    "hollow": Shape(cone, (0.4, 1.2), -1),
    "spoil": Shape(tongue, (0.3, 0.9), 1, (0.07, 0.16)),
    "wash": Shape(tongue, (0.1, 0.25), -1, (0.1, 0.2)),
}


def ground_scene(random: np.random.Generator, kind: str, shape: Shape) -> VolumeScene:
    """Ground that comes or goes on a slope."""
    edge = float(np.exp(random.uniform(np.log(15), np.log(80))))
    heights = slope(random, edge, steepest=35, relief=1.0)
    middle = random.uniform(-0.25, 0.25, 2) * edge
    radii = random.uniform(*shape.radius, 2) * edge
    u, v = local(edge, middle, radii, random.uniform(0, np.pi))
    thickness = random.uniform(*shape.thickness) * (edge / 30) ** 0.5
    # Material at its angle of repose.
    thickness = min(thickness, 0.7 * radii.min())
    bump = shape.sign * thickness * shape.profile(random, u, v)
    volume = integral(bump, edge)
    grounds = Pair(ground_of(heights, edge), ground_of(heights + bump, edge))
    place = np.array([*middle, grounds.before.height_at(middle[None])[0]])
    change = Truth(kind, volume, place, 1.2 * float(radii.max()))
    return surveyed(random, change, grounds.map(lambda own: [own]), edge, grounds.before)


def boulder_scene(random: np.random.Generator, kind: str) -> VolumeScene:
    """A boulder, half in the ground, that came or went."""
    edge = float(random.uniform(12, 40))
    ground = ground_of(slope(random, edge, steepest=25, relief=0.7), edge)
    middle = random.uniform(-0.25, 0.25, 2) * edge
    size = random.uniform(0.04, 0.09) * edge
    place = np.array([*middle, ground.height_at(middle[None])[0]])
    axes = np.asarray(Rotation.from_quat(random.standard_normal(4)).as_matrix())
    boulder = Ellipsoid(place + np.array([0, 0, 0.2 * size]), size * random.uniform(0.7, 1.3, 3), axes=axes)
    volume = above_ground(boulder, ground)
    return with_object(random, Truth(kind, volume, place, size), ground, boulder, edge)


def block_scene(random: np.random.Generator, kind: str) -> VolumeScene:
    """A block of rock, partly in the ground, that came or went."""
    edge = float(random.uniform(12, 40))
    ground = ground_of(slope(random, edge, steepest=25, relief=0.7), edge)
    middle = random.uniform(-0.25, 0.25, 2) * edge
    size = random.uniform(0.04, 0.09) * edge
    place = np.array([*middle, ground.height_at(middle[None])[0]])
    axes = np.asarray(Rotation.from_quat(random.standard_normal(4)).as_matrix())
    block = Solid(place + np.array([0, 0, 0.2 * size]), size * random.uniform(0.6, 1.1, 3), axes=axes)
    return with_object(random, Truth(kind, counted_above(block, ground), place, size), ground, block, edge)


def drum_scene(random: np.random.Generator, kind: str) -> VolumeScene:
    """An upright drum on a level floor."""
    edge = float(random.uniform(8, 25))
    floor = ground_of(np.zeros((NODES, NODES)), edge)
    diameter, height = random.uniform(0.03, 0.09, 2) * edge
    middle = random.uniform(-0.25, 0.25, 2) * edge
    drum = Solid(np.array([*middle, height / 2]), np.array([diameter, diameter, height]), round=True)
    volume = float(np.pi / 4 * diameter**2 * height)
    return with_object(random, Truth(kind, volume, np.array([*middle, 0.0]), diameter + height), floor, drum, edge)


def box_scene(random: np.random.Generator, kind: str) -> VolumeScene:
    """A box on a level floor."""
    edge = float(random.uniform(8, 25))
    floor = ground_of(np.zeros((NODES, NODES)), edge)
    size = random.uniform(0.03, 0.09, 3) * edge
    middle = random.uniform(-0.25, 0.25, 2) * edge
    axes = np.asarray(Rotation.from_euler("z", random.uniform(0, np.pi)).as_matrix())
    box = Solid(np.array([*middle, size[2] / 2]), size, axes=axes)
    truth = Truth(kind, float(size.prod()), np.array([*middle, 0.0]), float(np.linalg.norm(size)))
    return with_object(random, truth, floor, box, edge)


def tall_scene(random: np.random.Generator, kind: str, round: bool) -> VolumeScene:
    """What stands on a level floor and is higher than the tripods: nobody sees its top."""
    edge = float(random.uniform(8, 20))
    floor = ground_of(np.zeros((NODES, NODES)), edge)
    size = np.array([*random.uniform(0.5, 1.8, 2), random.uniform(1.9, 3.0)])
    if round:
        size[1] = size[0]
    middle = random.uniform(-0.25, 0.25, 2) * edge
    axes = np.asarray(Rotation.from_euler("z", random.uniform(0, np.pi)).as_matrix())
    thing = Solid(np.array([*middle, size[2] / 2]), size, axes=axes, round=round)
    volume = float(size.prod() * (np.pi / 4 if round else 1))
    truth = Truth(kind, volume, np.array([*middle, 0.0]), float(np.linalg.norm(size)))
    return with_object(random, truth, floor, thing, edge, from_tripods)


def with_object(
    random: np.random.Generator,
    truth: Truth,
    ground: Ground,
    thing: Solid,
    edge: float,
    survey: Survey | None = None,
) -> VolumeScene:
    """A thing that comes or goes."""
    solids = Pair([ground], [ground, thing])
    if random.random() < 0.5:
        return surveyed(random, truth, solids, edge, ground, survey)
    return surveyed(random, dataclasses.replace(truth, volume=-truth.volume), solids.swapped, edge, ground, survey)


KINDS: Mapping[str, Callable[[np.random.Generator], VolumeScene]] = {
    **{
        kind: (lambda random, kind=kind, shape=shape: ground_scene(random, kind, shape))
        for kind, shape in GROUND_KINDS.items()
    },
    "boulder": lambda random: boulder_scene(random, "boulder"),
    "box": lambda random: box_scene(random, "box"),
}
HELD_OUT: Mapping[str, Callable[[np.random.Generator], VolumeScene]] = {
    **{
        kind: (lambda random, kind=kind, shape=shape: ground_scene(random, kind, shape))
        for kind, shape in HELD_OUT_GROUND.items()
    },
    "block": lambda random: block_scene(random, "block"),
    "drum": lambda random: drum_scene(random, "drum"),
}

# Higher than the sensors: the first for development.
TALL: Mapping[str, Callable[[np.random.Generator], VolumeScene]] = {
    "cabinet": lambda random: tall_scene(random, "cabinet", round=False),
    "tank": lambda random: tall_scene(random, "tank", round=True),
}


def ground_of(heights: np.ndarray, edge: float) -> Ground:
    """The ground with these heights."""
    extent = np.array([edge, edge, 2 * np.abs(heights).max() + 1.0])
    return Ground(np.zeros(3), extent, heights=heights)


def integral(heights: np.ndarray, edge: float) -> float:
    """The volume under heights on the nodes of the ground, which is bilinear between them."""
    cells = (heights[1:, 1:] + heights[1:, :-1] + heights[:-1, 1:] + heights[:-1, :-1]) / 4
    return float(cells.sum() * (edge / (NODES - 1)) ** 2)


def above_ground(boulder: Ellipsoid, ground: Ground, lines: int = 300) -> float:
    """The volume of an ellipsoid above the ground, along a grid of vertical lines."""
    reach = float(np.linalg.norm(boulder.extent)) / 2
    line = (np.arange(lines) + 0.5) / lines * 2 * reach - reach
    x, y = (own.ravel() for own in np.meshgrid(line, line))
    floor = ground.height_at(np.stack([x, y], axis=1) + boulder.centre[:2]) - boulder.centre[2]
    # |S (x, y, z)| = 1 with S to the unit sphere: a quadratic equation in z.
    scale = boulder.rotation.T / (boulder.extent[:, None] / 2)
    flat, up = np.stack([x, y], axis=1) @ scale[:, :2].T, scale[:, 2]
    a, b, c = up @ up, flat @ up, (flat**2).sum(axis=1) - 1
    root = np.sqrt(np.maximum(b**2 - a * c, 0)) / a
    top, bottom = -b / a + root, -b / a - root
    height = np.where(root > 0, np.maximum(top - np.maximum(bottom, floor), 0), 0)
    return float(height.sum() * (2 * reach / lines) ** 2)


def counted_above(block: Solid, ground: Ground, lines: int = 120) -> float:
    """The volume of any solid above the ground, by cells of a grid about it."""
    reach = float(np.linalg.norm(block.extent)) / 2
    line = (np.arange(lines) + 0.5) / lines * 2 * reach - reach
    cells = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3) + block.centre
    inside = cells[block.contains(cells)]
    above = inside[:, 2] > ground.height_at(inside[:, :2])
    return float(above.sum() * (2 * reach / lines) ** 3)


def surveyed(
    random: np.random.Generator,
    truth: Truth,
    solids: Pair[list[Solid]],
    edge: float,
    ground: Ground,
    survey: Survey | None = None,
) -> VolumeScene:
    """Both surveys of the solids: from the air or from one to three stations, registered by targets or by ICP."""
    noise = float(np.exp(random.uniform(np.log(0.002), np.log(0.02))))
    count = random.uniform(15_000, 40_000)
    if survey is None:
        survey = from_the_air if random.random() < 0.35 else from_stations
    recordings = survey(random, solids, edge, noise, count, ground)
    by_targets = random.random() < 0.4
    # The error of targets stays in the scans; what ICP is to find is larger.
    shift, degrees = (random.uniform(0, 0.01), 0.01) if by_targets else (random.uniform(0, 0.1), 0.05)
    frame = Frame.drawn(random, shift=shift, degrees=degrees)
    survey = surveyed_scene(solids, recordings, frame, hidden_by=0.03 + 3 * noise)
    unit = frame.unit
    place = unit * transformed(truth.place[None], frame.placement)[0]
    mode: RegistrationMode = "never" if by_targets else "auto"
    return VolumeScene(truth.kind, survey, unit**3 * truth.volume, place, unit * truth.reach, mode)


def from_the_air(
    random: np.random.Generator, solids: Pair[list[Solid]], edge: float, noise: float, count: float, ground: Ground
) -> Pair[Recording]:
    """Flown over twice, in other directions."""
    beam = Beam(noise=noise, growth=0.0, max_range=2000.0, edge=0.3, mixed=0.1)

    def recording(own: list[Solid], heading: float) -> Recording:
        flight = Flight(edge, random.uniform(1.0, 2.0) * edge, int(random.integers(2, 4)), 0.3, heading)
        return flight.scanner(beam, 1.3 * count).recording(own, flight.poses(), random).thinned(int(count), random)

    return each(recording, solids, Pair(random.uniform(0, np.pi), random.uniform(0, np.pi)))


def from_tripods(
    random: np.random.Generator, solids: Pair[list[Solid]], edge: float, noise: float, count: float, ground: Ground
) -> Pair[Recording]:
    """From two to four stations of a scanner at the height of a person's eyes, which turns."""
    stations = int(random.integers(2, 5))
    beam = Beam(noise=noise, growth=random.uniform(0, 0.0001), max_range=4 * edge, edge=0.3, mixed=0.1)
    scanner = TripodScanner(beam, int(3 * count / stations), 360.0, -70.0, 30.0)
    places = 0.45 * edge * circle(random, stations)
    return solids.map(
        lambda own: recorded(
            random, own, scanner, places, edge, lambda _: random.uniform(1.5, 1.8, stations), True, count
        )
    )


def from_stations(
    random: np.random.Generator, solids: Pair[list[Solid]], edge: float, noise: float, count: float, ground: Ground
) -> Pair[Recording]:
    """From one to three stations: at the foot of the slope, or turning on it."""
    stations = int(random.integers(1, 4))
    beam = Beam(noise=noise, growth=random.uniform(0, 0.0001), max_range=4 * edge, edge=0.3, mixed=0.1)
    turning = random.random() < 0.5
    if turning:
        places = 0.45 * edge * circle(random, stations)
        scanner: TripodScanner | AirborneScanner = TripodScanner(beam, int(3 * count / stations), 360.0, -70.0, 30.0)
    else:
        across = (np.arange(stations) - (stations - 1) / 2) * 0.5 * edge
        places = np.stack([across, np.full(stations, -random.uniform(0.6, 0.9) * edge)], axis=1)
        scanner = AirborneScanner(beam, random.uniform(55, 80), random.uniform(35, 60), int(2 * count / stations))

    def heights(stands: np.ndarray) -> np.ndarray:
        below = ground.height_at(np.clip(stands, -edge / 2, edge / 2))
        return np.asarray(below + random.uniform(1.6, 0.15 * edge + 1.6))

    return solids.map(lambda own: recorded(random, own, scanner, places, edge, heights, turning, count))


def recorded(
    random: np.random.Generator,
    solids: list[Solid],
    scanner: TripodScanner | AirborneScanner,
    places: np.ndarray,
    edge: float,
    heights: Callable[[np.ndarray], np.ndarray],
    turning: bool,
    count: float,
) -> Recording:
    """What a scanner records from about these places, at these heights; it turns, or looks at the middle."""
    stands = places + random.normal(0, 0.02 * edge, places.shape)
    eyes = np.column_stack([stands, heights(stands)])
    poses = [looking_at(eye, np.array([0.0, 0.0, eye[2] if turning else 0.0])) for eye in eyes]
    return scanner.recording(solids, np.stack(poses), random).thinned(int(count), random)


def circle(random: np.random.Generator, count: int) -> np.ndarray:
    """Places around a circle."""
    angles = 2 * np.pi * (np.arange(count) + random.random()) / count
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def scene_of(kind: str, seed: int) -> VolumeScene:
    """A scene by its seed."""
    kinds = {**KINDS, **HELD_OUT, **TALL}
    return kinds[kind](np.random.default_rng([seed, list(kinds).index(kind)]))
