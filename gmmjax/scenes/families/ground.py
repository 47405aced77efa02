"""Rough ground: its relief, the rocks and bushes on it, scanners that survey it, and the scene that they make."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes.families.scanners import level_poses
from gmmjax.scenes.families.staging import Arrangement, Support
from gmmjax.scenes.families.things import chance, log_uniform, moved
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam, TripodScanner
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, StandingObject
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.shapes import Ellipsoid, Ground, Vegetation
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


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
