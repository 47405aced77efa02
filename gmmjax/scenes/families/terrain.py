"""Slopes with rocks and vegetation on which boulders fall and ground is displaced; what earthworks share with them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes.families.scanners import flown_over, level_poses, scanned
from gmmjax.scenes.families.staging import Arrangement, Support
from gmmjax.scenes.families.things import chance, log_uniform, moved, pillar
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam, LaserScanner, TripodScanner
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, StandingObject
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.shapes import Ellipsoid, Ground, Vegetation
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


def terrain(random: np.random.Generator) -> SurveyedScene:
    """A slope of 20 to 200 m, surveyed by a scanner from one or two stations, or from an aircraft.

    Boulders come, go and roll; ground of 5 to 40 cm (more on long slopes) is deposited or eroded, of which both the
    old and the new surface are changes; nothing changes in a third of the scenes. Vegetation shows other leaves in each
    survey.
    """
    edge = 20.0 * 10.0 ** (random.random() ** 1.5)
    ground = _slope(random, edge)
    arrangement = Arrangement()
    arrangement.stays([ground])
    noise = random.uniform(0.003, 0.03)
    changes = 0 if chance(random, 1 / 3) else int(random.choice([1, 2, 3], p=[0.5, 0.3, 0.2]))
    free = Support(np.eye(4), (0.8 * edge, 0.8 * edge), gap=0.02 * edge)
    for _ in range(changes):
        _change(random, arrangement, ground, free)
    cover(random, arrangement, ground)
    flown = chance(random, 0.4)
    growth = 0.0 if flown else random.uniform(0.0, 0.0002)
    mixed, lost = random.uniform(0.0, 0.3), random.uniform(0.0, 0.2)
    beam = Beam(noise=noise, growth=growth, max_range=3 * edge, mixed=mixed, edge=0.3, lost=lost)
    if flown:
        recordings = flown_over(random, arrangement.solids, edge, beam, random.uniform(18_000, 40_000))
    else:
        recordings = _from_stations(random, arrangement.solids, ground, beam)
    return ground_scene(random, arrangement, recordings, beam)


def _slope(random: np.random.Generator, edge: float) -> Ground:
    """A slope of 5 to 40 degrees, rough at three scales."""
    nodes = 121
    heights = random.uniform([0.0, 0.0, 0.0], [0.06, 0.012, 0.002]) * edge
    relief = rough(random, nodes, (0.25, 0.06, 0.015), heights)
    relief += np.linspace(-0.5, 0.5, nodes) * edge * np.tan(np.radians(random.uniform(5, 40)))
    relief -= (relief.min() + relief.max()) / 2
    return Ground(np.zeros(3), np.array([edge, edge, np.ptp(relief) + 1.0]), heights=relief)


def _change(random: np.random.Generator, arrangement: Arrangement, ground: Ground, free: Support) -> None:
    """Ground more or less, or a boulder more, less or elsewhere; apart from the other changes."""
    edge = float(ground.extent[0])
    kind = str(random.choice(["comes", "goes", "rolls", "deposit", "erosion"]))
    if kind in ("deposit", "erosion"):
        patch = _patch(random, ground, free)
        if patch is not None:
            arrangement.comes_or_goes((patch,), comes=kind == "deposit")
        return
    boulder = rock(random, min(random.uniform(0.03, 0.1) * edge, random.uniform(2.0, 6.0)))
    place = standing_on(random, ground, free, boulder)
    if place is None:
        return
    if kind == "rolls":
        arrangement.moves(moved(boulder, place), _rolled(random, ground, place))
    else:
        arrangement.comes_or_goes(moved(boulder, place), comes=kind == "comes")


def _rolled(random: np.random.Generator, ground: Ground, place: np.ndarray) -> Float[np.ndarray, "4 4"]:
    """A motion down the slope by 1 to 30 % of its length, with any rotation."""
    edge = float(ground.extent[0])
    down = place[:2, 3] + [random.uniform(-0.05, 0.05) * edge, -random.uniform(0.01, 0.3) * edge]
    target = lifted(ground, np.clip(down, -0.45 * edge, 0.45 * edge))
    rotation = Rotation.from_rotvec(random.uniform(0, 1.5) * random.standard_normal(3)).as_matrix()
    return np.asarray(rigid_transform(rotation, target) @ np.linalg.inv(place))


def _patch(random: np.random.Generator, ground: Ground, free: Support) -> Ground | None:
    """Deposit on the ground about a free place: thickest in the middle, below the ground outside."""
    edge = float(ground.extent[0])
    radius = random.uniform([0.03, 0.03], [0.12, 0.12]) * edge
    pose = free.pose(random, (pillar(2 * radius.max(), 1.0),))
    if pose is None:
        return None
    middle = pose[:2, 3]
    thickness = random.uniform(0.05, 0.4) * thick(edge)
    nodes = 41
    steps = np.linspace(-1.2, 1.2, nodes)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    outline = 1 + rough(random, nodes, (0.12,), np.array([0.15]))
    bump = thickness * np.clip(2 * (outline - x**2 - y**2), -1.0, 1.0)
    below = ground.height_at(middle + radius * grid(steps, steps)).reshape(nodes, nodes)
    # Thin edges are left out: nobody could call them changed.
    surface = below + np.where(bump < 0.3 * thickness, -thickness, bump)
    return patch_of(surface, middle, 2.4 * radius)


def _from_stations(
    random: np.random.Generator, solids: Pair[list[Solid]], ground: Ground, beam: Beam
) -> Pair[Recording]:
    """One or two stations at the foot of the slope or, turning all round, on it."""
    edge, stations = float(ground.extent[0]), int(random.integers(1, 3))
    rays = random.uniform(18_000, 38_000) / stations
    again = 0.0 if chance(random, 0.4) else random.uniform(0.0, 0.05) * edge
    if chance(random, 0.35):
        scanner: LaserScanner = panning_scanner(beam, rays)
        places = random.uniform(-0.3, 0.3, (stations, 2)) * edge
        stands = Pair(places, places + again * random.standard_normal((stations, 2)))
        poses = stands.map(lambda own: on_tripods(random, ground, own))
    else:
        scanner = oblique_scanner(random, beam, rays)
        foot = -edge * random.uniform(0.6, 1.0)
        places = np.column_stack([random.uniform(-0.4, 0.4, stations) * edge, np.full(stations, foot)])
        stands = Pair(places, places + again * random.standard_normal((stations, 2)))
        height = ground.heights.min() + random.uniform(0.0, 0.3) * edge
        poses = stands.map(lambda own: np.stack([looking_at(np.array([*place, height]), np.zeros(3)) for place in own]))
    return scanned(random, scanner, solids, poses, int(stations * rays))


def rough(random: np.random.Generator, nodes: int, cells: Sequence[float], heights: np.ndarray) -> np.ndarray:
    """Smooth random heights: white noise, filtered over these shares of the nodes, of these standard deviations."""
    total = np.zeros((nodes, nodes))
    for cell, height in zip(cells, heights, strict=True):
        part = gaussian_filter(random.standard_normal((nodes, nodes)), cell * nodes, mode="wrap")
        total += part * (height / part.std())
    return total


def grid(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " m"]) -> Float[np.ndarray, "nm 2"]:
    """The nodes of a grid, row by row."""
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def patch_of(
    surface: Float[np.ndarray, "n m"], middle: Float[np.ndarray, "2"], lengths: Float[np.ndarray, "2"]
) -> Ground:
    """Ground with this surface, heights in the world, about a place."""
    level = (surface.min() + surface.max()) / 2
    extent = np.array([*lengths, np.ptp(surface) + 0.01])
    return Ground(np.array([*middle, level]), extent, heights=surface - level)


def thick(edge: float) -> float:
    """By what changes of ground of this extent, metres, are thicker than of 60 m."""
    return max(1.0, edge / 60)


def lifted(ground: Ground, place: np.ndarray) -> np.ndarray:
    """The point of the ground above x and y."""
    return np.array([*place, ground.height_at(place[None])[0]])


def standing_on(
    random: np.random.Generator, ground: Ground, free: Support, thing: StandingObject
) -> Float[np.ndarray, "4 4"] | None:
    """A free pose of a thing on the ground; None where none was found."""
    level = free.pose(random, thing)
    return None if level is None else rigid_transform(level[:3, :3], lifted(ground, level[:2, 3]))


def rock(random: np.random.Generator, size: float) -> StandingObject:
    """One to three ellipsoids or blocks, half in the ground at the origin."""
    parts = []
    for _ in range(int(random.integers(1, 4))):
        kind = Ellipsoid if chance(random, 0.6) else Solid
        extent = size * random.uniform(0.5, 1.2, 3)
        centre = size * random.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.3])
        parts.append(kind(centre, extent, axes=Rotation.from_quat(random.standard_normal(4)).as_matrix()))
    return tuple(parts)


def cover(random: np.random.Generator, arrangement: Arrangement, ground: Ground) -> None:
    """Rocks and bushes that stay, few or many."""
    edge = float(ground.extent[0])
    for _ in range(int(random.integers(0, 25))):
        stone = rock(random, edge * log_uniform(random, 0.005, 0.05))
        arrangement.stays(moved(stone, _anywhere(random, ground)))
    if chance(random, 0.3):
        return
    free_path, tall = random.uniform(0.05, 0.6), random.uniform(0.2, 3.0)
    for _ in range(int(random.integers(3, 40))):
        extent = tall * random.uniform([0.5, 0.5, 0.4], [1.5, 1.5, 1.2])
        bush = Vegetation(np.array([0.0, 0.0, 0.35 * extent[2]]), extent, free_path=free_path)
        arrangement.stays(moved((bush,), _anywhere(random, ground)))


def _anywhere(random: np.random.Generator, ground: Ground) -> Float[np.ndarray, "4 4"]:
    """The motion from the origin to a random place of the ground."""
    half = 0.48 * float(ground.extent[0])
    return rigid_transform(translation=lifted(ground, random.uniform(-half, half, 2)))


def panning_scanner(beam: Beam, rays: float) -> TripodScanner:
    """A scanner on a tripod that turns all round; about so many of its rays meet ground."""
    return TripodScanner(beam, int(2.5 * rays), lowest=-60.0, highest=40.0)


def oblique_scanner(random: np.random.Generator, beam: Beam, rays: float) -> AirborneScanner:
    """A scanner that looks at the ground from aside; about so many of its rays meet it."""
    return AirborneScanner(beam, random.uniform(50, 80), random.uniform(35, 60), int(2.5 * rays))


def on_tripods(random: np.random.Generator, ground: Ground, places: np.ndarray) -> Float[np.ndarray, "v 4 4"]:
    """Poses of scanners that stand level on the ground at these places [v, 2]."""
    return level_poses(random, places, list(ground.height_at(places) + random.uniform(1.5, 2.5)), np.zeros(3))


def ground_scene(
    random: np.random.Generator, arrangement: Arrangement, recordings: Pair[Recording], beam: Beam
) -> SurveyedScene:
    """The scene of two surveys; what one recorded in ground that came or went changed with it."""
    edge = float(arrangement.solids.before[0].extent[0])
    frame = Frame.drawn(random, shift=random.uniform(0.0, 0.1), degrees=0.05)
    covers = arrangement.solids.map(
        lambda own: [solid for solid in own if isinstance(solid, Ground) and solid.label != UNLABELLED]
    )
    hidden_by = 0.03 + 3 * (beam.noise + beam.growth * edge)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by, covers=covers)
