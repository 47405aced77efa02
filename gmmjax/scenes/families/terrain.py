"""Slopes with rocks and vegetation, on which boulders fall, ground is deposited and washed away."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes.families import ground as rough_ground
from gmmjax.scenes.families.ground import grid, lifted, patch_of, rock, rough, standing_on, thick
from gmmjax.scenes.families.scanners import flown_over, scanned
from gmmjax.scenes.families.staging import Arrangement, Support
from gmmjax.scenes.families.things import chance, moved, pillar
from gmmjax.scenes.laser_scanner import Beam, LaserScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.shapes import Ground
from gmmjax.scenes.surveyed_scene import SurveyedScene


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
    rough_ground.cover(random, arrangement, ground)
    flown = chance(random, 0.4)
    growth = 0.0 if flown else random.uniform(0.0, 0.0002)
    mixed, lost = random.uniform(0.0, 0.3), random.uniform(0.0, 0.2)
    beam = Beam(noise=noise, growth=growth, max_range=3 * edge, mixed=mixed, edge=0.3, lost=lost)
    if flown:
        recordings = flown_over(random, arrangement.solids, edge, beam, random.uniform(18_000, 40_000))
    else:
        recordings = _from_stations(random, arrangement.solids, ground, beam)
    return rough_ground.ground_scene(random, arrangement, recordings, beam)


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
    """What lies on the ground about a free place: thickest in the middle, below the ground outside."""
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
        scanner: LaserScanner = rough_ground.panning_scanner(beam, rays)
        places = random.uniform(-0.3, 0.3, (stations, 2)) * edge
        stands = Pair(places, places + again * random.standard_normal((stations, 2)))
        poses = stands.map(lambda own: rough_ground.on_tripods(random, ground, own))
    else:
        scanner = rough_ground.oblique_scanner(random, beam, rays)
        foot = -edge * random.uniform(0.6, 1.0)
        places = np.column_stack([random.uniform(-0.4, 0.4, stations) * edge, np.full(stations, foot)])
        stands = Pair(places, places + again * random.standard_normal((stations, 2)))
        height = ground.heights.min() + random.uniform(0.0, 0.3) * edge
        poses = stands.map(lambda own: np.stack([looking_at(np.array([*place, height]), np.zeros(3)) for place in own]))
    return scanned(random, scanner, solids, poses, int(stations * rays))
