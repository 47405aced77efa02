"""Surveys by depth cameras: which makes there are, where they look from, and what they record."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.depth_camera import DepthCamera, TriangulatingCamera, recorded_frames
from gmmjax.scenes.families.things import chance, log_uniform
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import PoseErrors, Recording
from gmmjax.scenes.rigid_motions import looking_at, small_motion


def time_of_flight_camera(random: np.random.Generator, columns: int, max_range: float) -> DepthCamera:
    """A depth camera of some make, with about this number of columns and this range, metres."""
    wide = random.uniform(50, 90)
    columns = int(columns * random.uniform(0.8, 1.25))
    return _of_shape(
        columns,
        wide,
        random.uniform(0.6, 0.85),
        min_range=random.uniform(0.1, 0.4),
        max_range=max_range * random.uniform(0.8, 1.3),
        noise=random.uniform(0.001, 0.01),
        flying=random.uniform(0.0, 0.1),
        lost=random.uniform(0.0, 0.06),
    )


def triangulating_camera(
    random: np.random.Generator, pixels: float, max_range: float, edge: float
) -> TriangulatingCamera:
    """A depth camera of some make, with about this number of pixels; range and depth edges in metres."""
    wide, aspect = random.uniform(50.0, 75.0), random.uniform(0.6, 0.85)
    flying, lost = random.uniform(0.0, 0.15), random.uniform(0.0, 0.1)
    columns = int(np.sqrt(pixels / aspect))
    camera = _of_shape(columns, wide, aspect, max_range=max_range, flying=flying, lost=lost, edge=edge)
    noise = log_uniform(random, 0.0007, 0.004)
    blur = random.uniform(0.5, 1.5) if chance(random, 0.4) else 0.0
    return TriangulatingCamera(camera, noise, blur, distortion=random.uniform(0.0, 0.003))


def _of_shape(columns: int, wide: float, aspect: float, **others: Any) -> DepthCamera:
    """A camera by its horizontal field of view, degrees, and its rows a column."""
    high = 2 * np.degrees(np.arctan(np.tan(np.radians(wide) / 2) * aspect))
    return DepthCamera(columns, int(columns * aspect), (wide, float(high)), **others)


def poses_about(
    random: np.random.Generator,
    aim: Float[np.ndarray, "3"],
    azimuth: float,
    distance: float,
    elevation: float,
    apart: Float[np.ndarray, " v"],
) -> Float[np.ndarray, "v 4 4"]:
    """Poses on an arc about what they look at, at these angles from the first azimuth; metres and radians."""
    poses = []
    for angle in apart:
        level = np.cos(elevation) * np.array([np.cos(azimuth + angle), np.sin(azimuth + angle)])
        off = 0.03 * distance * random.standard_normal(3)
        poses.append(looking_at(aim + distance * np.array([*level, np.sin(elevation)]), aim + off))
    return np.stack(poses)


def panorama_poses(
    random: np.random.Generator, size: Float[np.ndarray, "3"], solids: Sequence[Solid], frames: int
) -> Float[np.ndarray, "v 4 4"]:
    """Poses all over a room about the origin, outside of its solids, that together look in every direction."""
    start, turns = random.uniform(0, 2 * np.pi), int(random.integers(1, 4))
    poses = []
    for frame in range(frames):
        heading = start + 2 * np.pi * turns * frame / frames + random.normal(0, 0.15)
        ahead = np.array([np.cos(heading), np.sin(heading)])
        heights = (0.9, min(1.9, size[2] - 0.3))
        # From behind the middle, so that the far wall is in range and what is near in view.
        position = free_position(random, solids, -0.3 * size[:2] * ahead, 0.12 * size[:2], heights)
        target = np.array([*(0.4 * size[:2] * ahead), random.uniform(0.0, 1.1)])
        poses.append(looking_at(position, target))
    return np.stack(poses)


def free_position(
    random: np.random.Generator,
    solids: Sequence[Solid],
    middle: Float[np.ndarray, "2"],
    spread: Float[np.ndarray, "2"],
    heights: tuple[float, float],
) -> Float[np.ndarray, "3"]:
    """A place about a middle that is at least 20 cm from every solid, where one is found."""
    position = np.zeros(3)
    for _ in range(20):
        position = np.array([*random.normal(middle, spread), random.uniform(*heights)])
        if not any(solid.contains(position[None], 0.2)[0] for solid in solids):
            break
    return position


def again(
    random: np.random.Generator, poses: Float[np.ndarray, "v 4 4"], shift: float, degrees: float
) -> Float[np.ndarray, "v 4 4"]:
    """About the same poses in another survey: each within this translation, metres, and this rotation."""
    motions = [small_motion(random, random.uniform(0, shift), random.uniform(0, degrees)) for _ in poses]
    return np.stack([pose @ motion for pose, motion in zip(poses, motions, strict=True)])


def kept_frames(
    random: np.random.Generator, poses: Pair[Float[np.ndarray, "v 4 4"]], share: float
) -> Pair[Float[np.ndarray, "w 4 4"]]:
    """Either survey's poses without a run of them, the share of its length; the two runs have none in common."""
    count = len(poses.before)
    lost = min(round(share * count), count // 2)
    first = int(random.integers(count))
    second = first + int(random.integers(lost, count - lost + 1))
    runs = Pair(first, second).map(lambda start: (start + np.arange(lost)) % count)
    return each(lambda own, run: np.delete(own, run, axis=0), poses, runs)


def recorded(
    random: np.random.Generator,
    solids: Pair[list[Solid]],
    poses: Pair[Float[np.ndarray, "v 4 4"]],
    camera: DepthCamera,
) -> Pair[Recording]:
    """The surveys of one camera, or in three of ten scenes of two with different noise and resolution."""
    other = camera
    if chance(random, 0.3):
        scale = random.uniform(0.6, 1.2)
        columns, rows = int(camera.columns * scale), int(camera.rows * scale)
        other = dataclasses.replace(camera, columns=columns, rows=rows, noise=random.uniform(0.001, 0.01))
    errors = Pair(*(PoseErrors(random.uniform(0.0, 0.006), random.uniform(0.0, 0.2)) for _ in range(2)))
    return each(
        lambda own, there, used, wrong: recorded_frames(used, own, there, random, wrong),
        solids,
        poses,
        Pair(camera, other),
        errors,
    )
