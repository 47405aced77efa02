"""Ground, and things on it, of which a volume that is known by construction comes or goes between two surveys."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

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
from gmmjax.scenes.shapes import Ground
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
        gained: volume, in the cube of the unit of the clouds; 0 where nothing was.
        lost: likewise.
        place: the middle of what changed, in the before cloud's coordinates.
        reach: how far it reaches from there.
        registration: the mode that suits the scene.
    """

    kind: str
    survey: SurveyedScene
    gained: float
    lost: float
    place: Float[np.ndarray, "3"]
    reach: float
    registration: RegistrationMode


@dataclasses.dataclass(frozen=True)
class Truth:
    """What changed, in the true frame, metres.

    Attributes:
        kind: of change, a key of `KINDS`.
        gained: volume.
        lost: likewise.
        place: its middle.
        reach: how far it reaches from there.
    """

    kind: str
    gained: float
    lost: float
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


def ridge(random: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Long and narrow, rounded at its crest, with ends that thin out."""
    return np.clip(1 - (u / 1.3) ** 2, 0, None) * np.exp(-(((v - 0.2 * np.sin(2 * u)) / 0.35) ** 2) / 2)


@dataclasses.dataclass(frozen=True)
class Shape:
    """How much ground comes or goes.

    Attributes:
        profile: thickness by place, at most about 1.
        thickness: from and to, in metres at an edge of 30 m.
    """

    profile: Callable[[np.random.Generator, np.ndarray, np.ndarray], np.ndarray]
    thickness: tuple[float, float]

    def heights(self, random: np.random.Generator, edge: float, middle: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """How thick it is at the nodes of the ground: material at its angle of repose."""
        thickness = min(random.uniform(*self.thickness) * (edge / 30) ** 0.5, 0.7 * float(radii.min()))
        return thickness * self.profile(random, *local(edge, middle, radii, random.uniform(0, np.pi)))


MOUNDS = (Shape(lens, (0.15, 0.5)), Shape(tongue, (0.2, 0.6)), Shape(cone, (0.8, 2.5)), Shape(ridge, (0.4, 1.2)))
PITS = (Shape(plate, (0.5, 1.2)), Shape(cone, (0.4, 1.2)))
ERODED = (Shape(lens, (0.1, 0.3)), Shape(tongue, (0.1, 0.25)), Shape(plate, (0.15, 0.6)), Shape(ridge, (0.2, 0.6)))


def ground_scene(random: np.random.Generator, kind: str, shapes: Sequence[Shape], sign: int) -> VolumeScene:
    """Ground that comes (sign 1) or goes (-1) on a slope of 15 to 80 m."""
    edge = float(np.exp(random.uniform(np.log(15), np.log(80))))
    heights = slope(random, edge, steepest=35, relief=1.0)
    middle, radii = random.uniform(-0.25, 0.25, 2) * edge, random.uniform(0.07, 0.17, 2) * edge
    change = sign * shapes[int(random.integers(len(shapes)))].heights(random, edge, middle, radii)
    return changed_ground(random, kind, heights, change, edge, middle, float(radii.max()))


def cut_and_fill_scene(random: np.random.Generator, kind: str) -> VolumeScene:
    """Ground that is taken away in one place of a slope and deposited beside it."""
    edge = float(np.exp(random.uniform(np.log(15), np.log(80))))
    heights = slope(random, edge, steepest=30, relief=1.0)
    radii = random.uniform(0.08, 0.14, 2) * edge
    middle, angle = random.uniform(-0.2, 0.2, 2) * edge, random.uniform(0, 2 * np.pi)
    apart = random.uniform(0.8, 1.0) * radii.sum() / 2 * np.array([np.cos(angle), np.sin(angle)])
    bumps = [
        sign
        * shapes[int(random.integers(len(shapes)))].heights(random, edge, middle + sign * apart, np.full(2, radius))
        for sign, shapes, radius in ((1, MOUNDS, radii[0]), (-1, (*PITS, *ERODED), radii[1]))
    ]
    # Where both would be, it is one of them.
    change = np.where(np.abs(bumps[0]) >= np.abs(bumps[1]), *bumps)
    return changed_ground(random, kind, heights, change, edge, middle, float(radii.sum()))


def changed_ground(
    random: np.random.Generator,
    kind: str,
    heights: np.ndarray,
    change: np.ndarray,
    edge: float,
    middle: np.ndarray,
    radius: float,
) -> VolumeScene:
    """Surveys of ground with these heights, before and after this change of them."""
    grounds = Pair(ground_of(heights, edge), ground_of(heights + change, edge))
    place = np.array([*middle, grounds.before.height_at(middle[None])[0]])
    gained, lost = integral(np.maximum(change, 0), edge), integral(np.maximum(-change, 0), edge)
    truth = Truth(kind, gained, lost, place, 1.2 * radius)
    survey = from_the_air if random.random() < 0.35 else from_stations
    return surveyed(random, truth, grounds.map(lambda own: [own]), edge, grounds.before, survey)


def box_scene(random: np.random.Generator, kind: str) -> VolumeScene:
    """A box of about .3 m that comes to a level floor of 4 to 6 m, or goes."""
    edge = float(random.uniform(4, 6))
    floor = ground_of(np.zeros((NODES, NODES)), edge)
    size, middle = random.uniform(0.25, 0.35, 3), random.uniform(-0.25, 0.25, 2) * edge
    axes = np.asarray(Rotation.from_euler("z", random.uniform(0, np.pi)).as_matrix())
    box = Solid(np.array([*middle, size[2] / 2]), size, axes=axes)
    came, volume = random.random() < 0.5, float(size.prod())
    solids: Pair[list[Solid]] = Pair([floor], [floor, box])
    truth = Truth(kind, volume * came, volume * (not came), np.array([*middle, 0.0]), float(np.linalg.norm(size)))
    return surveyed(random, truth, solids if came else solids.swapped, edge, floor, from_stations, (0.001, 0.006))


KINDS: Mapping[str, Callable[[np.random.Generator], VolumeScene]] = {
    "box of .3 m": lambda random: box_scene(random, "box of .3 m"),
    "mound": lambda random: ground_scene(random, "mound", MOUNDS, 1),
    "pit": lambda random: ground_scene(random, "pit", PITS, -1),
    "eroded slope": lambda random: ground_scene(random, "eroded slope", ERODED, -1),
    "cut and fill": lambda random: cut_and_fill_scene(random, "cut and fill"),
}


def ground_of(heights: np.ndarray, edge: float) -> Ground:
    """The ground with these heights."""
    extent = np.array([edge, edge, 2 * np.abs(heights).max() + 1.0])
    return Ground(np.zeros(3), extent, heights=heights)


def integral(heights: np.ndarray, edge: float) -> float:
    """The volume under heights on the nodes of the ground, which is bilinear between them."""
    cells = (heights[1:, 1:] + heights[1:, :-1] + heights[:-1, 1:] + heights[:-1, :-1]) / 4
    return float(cells.sum() * (edge / (NODES - 1)) ** 2)


def surveyed(
    random: np.random.Generator,
    truth: Truth,
    solids: Pair[list[Solid]],
    edge: float,
    ground: Ground,
    survey: Survey,
    noises: tuple[float, float] = (0.002, 0.02),
) -> VolumeScene:
    """Both surveys of the solids: from the air or from one to three stations, registered by targets or by ICP."""
    noise = float(np.exp(random.uniform(*np.log(noises))))
    count = random.uniform(15_000, 40_000)
    recordings = survey(random, solids, edge, noise, count, ground)
    by_targets = random.random() < 0.4
    # The error of targets stays in the scans; what ICP is to find is larger.
    shift, degrees = (random.uniform(0, 0.01), 0.01) if by_targets else (random.uniform(0, 0.1), 0.05)
    frame = Frame.drawn(random, shift=shift, degrees=degrees)
    scene = surveyed_scene(solids, recordings, frame, hidden_by=0.03 + 3 * noise)
    unit = frame.unit
    place = unit * transformed(truth.place[None], frame.placement)[0]
    mode: RegistrationMode = "never" if by_targets else "auto"
    return VolumeScene(truth.kind, scene, unit**3 * truth.gained, unit**3 * truth.lost, place, unit * truth.reach, mode)


def from_the_air(
    random: np.random.Generator, solids: Pair[list[Solid]], edge: float, noise: float, count: float, ground: Ground
) -> Pair[Recording]:
    """Flown over twice, in other directions."""
    beam = Beam(noise=noise, growth=0.0, max_range=2000.0, edge=0.3, mixed=0.1)

    def recording(own: list[Solid], heading: float) -> Recording:
        flight = Flight(edge, random.uniform(1.0, 2.0) * edge, int(random.integers(2, 4)), 0.3, heading)
        return flight.scanner(beam, 1.3 * count).recording(own, flight.poses(), random).thinned(int(count), random)

    return each(recording, solids, Pair(random.uniform(0, np.pi), random.uniform(0, np.pi)))


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
    return KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]))
