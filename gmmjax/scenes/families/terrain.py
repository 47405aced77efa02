"""Slopes with rocks and vegetation, on which boulders fall, ground is deposited and washed away."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair, each
from gmmjax.scenes.families.arrangements import Arrangement, chance
from gmmjax.scenes.families.flights import flown_over
from gmmjax.scenes.families.rough_ground import cover, is_displaced, lifted, on_tripods, rock, rough
from gmmjax.scenes.families.staging import Support
from gmmjax.scenes.families.things import moved, pillar
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam, TripodScanner
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.shapes import Ground
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


def terrain(random: np.random.Generator) -> SurveyedScene:
    """A slope of 20 to 200 m, surveyed by a scanner from one or two stations, or from an aircraft.

    Boulders come, go and roll; ground of 5 to 40 cm (more on long slopes) is deposited or eroded, of which both the
    old and the new surface are changes; nothing changes in a third of the scenes. Vegetation shows other leaves in each
    survey.

    Args:
        random: of everything.
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
    cover(random, arrangement, ground, edge)
    flown = chance(random, 0.4)
    beam = Beam(
        noise=noise,
        growth=0.0 if flown else random.uniform(0.0, 0.0002),
        max_range=3 * edge,
        mixed=random.uniform(0.0, 0.3),
        edge=0.3,
        lost=random.uniform(0.0, 0.2),
    )
    if flown:
        recordings = flown_over(random, arrangement, edge, beam, random.uniform(18_000, 40_000))
    else:
        recordings = _stations(random, arrangement, ground, edge, beam)
    frame = Frame.drawn(random, shift=random.uniform(0.0, 0.1), degrees=0.05)
    hidden_by = 0.03 + 3 * (noise + beam.growth * edge)
    covers = arrangement.solids.map(lambda own: [solid for solid in own if is_displaced(solid)])
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by, covers=covers)


def _slope(random: np.random.Generator, edge: float) -> Ground:
    """A slope of 5 to 40 degrees, rough at three scales."""
    nodes = 121
    cells = np.array([0.25, 0.06, 0.015]) * nodes
    heights = random.uniform([0.0, 0.0, 0.0], [0.06, 0.012, 0.002]) * edge
    relief = rough(random, nodes, cells, heights)
    up = np.linspace(-0.5, 0.5, nodes) * edge * np.tan(np.radians(random.uniform(5, 40)))
    relief = relief + up[None, :]
    relief -= (relief.min() + relief.max()) / 2
    extent = np.array([edge, edge, np.ptp(relief) + 1.0])
    return Ground(np.zeros(3), extent, heights=relief)


def _change(random: np.random.Generator, arrangement: Arrangement, ground: Ground, free: Support) -> None:
    """Ground more or less, or a boulder more, less or elsewhere; apart from the other changes."""
    edge = float(ground.extent[0])
    kind = str(random.choice(["comes", "goes", "rolls", "deposit", "erosion"]))
    if kind in ("deposit", "erosion"):
        patch = _patch(random, ground, free)
        if patch is not None:
            (arrangement.comes if kind == "deposit" else arrangement.goes)((patch,))
    else:
        boulder = rock(random, min(random.uniform(0.03, 0.1) * edge, random.uniform(2.0, 6.0)))
        level = free.pose(random, boulder)
        if level is None:
            return
        place = rigid_transform(level[:3, :3], lifted(ground, level[:2, 3]))
        standing = moved(boulder, place)
        if kind == "comes":
            arrangement.comes(standing)
        elif kind == "goes":
            arrangement.goes(standing)
        else:
            arrangement.moves(standing, _rolled(random, ground, place, edge))


def _rolled(random: np.random.Generator, ground: Ground, place: np.ndarray, edge: float) -> Float[np.ndarray, "4 4"]:
    """A motion down the slope by 1 to 30 % of its length, with any rotation."""
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
    thickness = random.uniform(0.05, 0.4) * max(1.0, edge / 60)
    nodes = 41
    steps = np.linspace(-1.2, 1.2, nodes)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    outline = 1 + rough(random, nodes, np.array([0.12 * nodes]), np.array([0.15]))
    bump = thickness * np.clip(2 * (outline - x**2 - y**2), -1.0, 1.0)
    # Thin edges are left out: nobody could call them changed.
    buried = bump < 0.3 * thickness
    places = middle + np.stack([radius[0] * x, radius[1] * y], axis=-1).reshape(-1, 2)
    below = ground.height_at(places).reshape(nodes, nodes)
    surface = below + np.where(buried, -thickness, bump)
    centre = np.array([*middle, (surface.min() + surface.max()) / 2])
    extent = np.array([*(2.4 * radius), np.ptp(surface) + 0.01])
    return Ground(centre, extent, heights=surface - centre[2])


def _stations(
    random: np.random.Generator, arrangement: Arrangement, ground: Ground, edge: float, beam: Beam
) -> Pair[Recording]:
    """One or two stations at the foot of the slope or, turning all round, on it."""
    stations = int(random.integers(1, 3))
    rays = random.uniform(18_000, 38_000) / stations
    again = 0.0 if chance(random, 0.4) else random.uniform(0.0, 0.05) * edge
    if chance(random, 0.35):
        scanner: TripodScanner | AirborneScanner = TripodScanner(beam, int(2.5 * rays), lowest=-60.0, highest=40.0)
        places = random.uniform(-0.3, 0.3, (stations, 2)) * edge
        stands = Pair(places, places + again * random.standard_normal((stations, 2)))
        poses = stands.map(lambda own: on_tripods(random, ground, own))
    else:
        scanner = AirborneScanner(beam, random.uniform(50, 80), random.uniform(35, 60), int(2.5 * rays))
        foot = -edge * random.uniform(0.6, 1.0)
        places = np.column_stack([random.uniform(-0.4, 0.4, stations) * edge, np.full(stations, foot)])
        stands = Pair(places, places + again * random.standard_normal((stations, 2)))
        height = ground.heights.min() + random.uniform(0.0, 0.3) * edge
        poses = stands.map(lambda own: np.stack([looking_at(np.array([*place, height]), np.zeros(3)) for place in own]))
    return each(
        lambda solids, own: scanner.recording(solids, own, random).thinned(int(stations * rays), random),
        arrangement.solids,
        poses,
    )
