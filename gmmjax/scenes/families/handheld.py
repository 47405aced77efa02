"""Surveys by a depth camera that is carried about: panoramas, panoramas with lost frames, single frames."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.pose_errors import PoseErrors
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording, recorded_frames
from gmmjax.scenes.rigid_motions import looking_at, small_motion


def drawn_camera(random: np.random.Generator, *, columns: int, max_range: float) -> DepthCamera:
    """A depth camera of some make, with about so many columns."""
    wide = random.uniform(50, 90)
    columns = int(columns * random.uniform(0.8, 1.25))
    aspect = random.uniform(0.6, 0.85)
    high = 2 * np.degrees(np.arctan(np.tan(np.radians(wide) / 2) * aspect))
    return DepthCamera(
        columns=columns,
        rows=int(columns * aspect),
        field_of_view=(wide, float(high)),
        least_range=random.uniform(0.1, 0.4),
        max_range=max_range * random.uniform(0.8, 1.3),
        noise=random.uniform(0.001, 0.01),
        flying=random.uniform(0.0, 0.1),
        lost=random.uniform(0.0, 0.06),
    )


def drawn_errors(random: np.random.Generator) -> PoseErrors:
    """The small errors of a camera's poses."""
    return PoseErrors(jitter=random.uniform(0.0, 0.006), jitter_degrees=random.uniform(0.0, 0.2))


def panorama_poses(
    random: np.random.Generator, size: Float[np.ndarray, "3"], solids: Sequence[Solid], frames: int
) -> Float[np.ndarray, "v 4 4"]:
    """Poses all over a room about the origin, that together look in every direction.

    Args:
        random: of the poses.
        size: of the room, metres.
        solids: within which no camera is.
        frames: number of poses.
    """
    start, turns = random.uniform(0, 2 * np.pi), int(random.integers(1, 4))
    poses = []
    for frame in range(frames):
        heading = start + 2 * np.pi * turns * frame / frames + random.normal(0, 0.15)
        ahead = np.array([np.cos(heading), np.sin(heading)])
        # From behind the middle, so that the far wall is in range and what is near in view.
        position = free_position(
            random, solids, -0.3 * size[:2] * ahead, 0.12 * size[:2], (0.9, min(1.9, size[2] - 0.3))
        )
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
    """About the same poses in another survey: each within so many metres and degrees."""
    motions = [small_motion(random, random.uniform(0, shift), random.uniform(0, degrees)) for _ in poses]
    turned = np.stack([pose @ motion for pose, motion in zip(poses, motions, strict=True)])
    return np.asarray(turned)


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
    *,
    two_cameras: float = 0.3,
) -> Pair[Recording]:
    """The surveys of one camera, or now and then of two with different noise and resolution.

    Args:
        random: of everything.
        solids: of the scene at either time.
        poses: of the frames.
        camera: of the before survey.
        two_cameras: share of the scenes in which the after survey's camera is another.
    """
    other = camera
    if random.random() < two_cameras:
        scale = random.uniform(0.6, 1.2)
        columns, rows = int(camera.columns * scale), int(camera.rows * scale)
        other = dataclasses.replace(camera, columns=columns, rows=rows, noise=random.uniform(0.001, 0.01))
    errors = Pair(drawn_errors(random), drawn_errors(random))
    return each(
        lambda own, there, used, wrong: recorded_frames(used, own, there, random, wrong),
        solids,
        poses,
        Pair(camera, other),
        errors,
    )
