"""Surveys by one to a few frames of a depth camera that triangulates."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.families.arrangements import chance
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording, joined
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.triangulating_camera import TriangulatingCamera


def triangulating_camera(
    random: np.random.Generator, pixels: float, max_range: float, edge: float
) -> TriangulatingCamera:
    """A random depth camera.

    Args:
        random: of field of view, noise, distortion, flying and lost pixels.
        pixels: about so many in a frame.
        max_range: nothing further is returned, metres.
        edge: a jump in range between neighbouring pixels from which there is a depth edge, metres.
    """
    across, shape = random.uniform(50.0, 75.0), random.uniform(0.6, 0.85)
    columns = int(np.sqrt(pixels / shape))
    down = 2 * np.degrees(np.arctan(shape * np.tan(np.radians(across) / 2)))
    camera = DepthCamera(
        columns=columns,
        rows=int(columns * shape),
        field_of_view=(across, float(down)),
        max_range=max_range,
        flying=random.uniform(0.0, 0.15),
        lost=random.uniform(0.0, 0.1),
        edge=edge,
    )
    noise = np.exp(random.uniform(np.log(0.0007), np.log(0.004)))
    blur = random.uniform(0.5, 1.5) if chance(random, 0.4) else 0.0
    return TriangulatingCamera(camera, noise, blur, distortion=random.uniform(0.0, 0.003))


def poses_about(
    random: np.random.Generator,
    aim: Float[np.ndarray, "3"],
    azimuth: float,
    distance: float,
    elevation: float,
    apart: Float[np.ndarray, " v"],
) -> Float[np.ndarray, "v 4 4"]:
    """Poses on an arc about what they look at.

    Args:
        random: of small differences.
        aim: what they look at, metres.
        azimuth: direction from there to the first camera, radians.
        distance: of the cameras, metres.
        elevation: of the cameras above it, radians.
        apart: angles of the cameras from the first azimuth, radians.
    """
    poses = []
    for angle in apart:
        level = np.cos(elevation) * np.array([np.cos(azimuth + angle), np.sin(azimuth + angle)])
        off = 0.03 * distance * random.standard_normal(3)
        poses.append(looking_at(aim + distance * np.array([*level, np.sin(elevation)]), aim + off))
    return np.stack(poses)


def surveyed_by(
    random: np.random.Generator,
    camera: TriangulatingCamera,
    solids: Sequence[Solid],
    poses: Float[np.ndarray, "v 4 4"],
) -> Recording:
    """A frame from each pose; the distortion is the same in all."""
    distortion = camera.distortion_of(random)
    frames = [camera.frame(solids, pose, distortion, random) for pose in poses]
    return joined(frames, poses, poses, camera.camera.field_of_view, camera.camera.max_range)


def checkerboard(camera: DepthCamera) -> Bool[np.ndarray, " n"]:
    """Every second pixel of a frame."""
    rows, columns = np.indices((camera.rows, camera.columns))
    return np.asarray(((rows + columns) % 2 == 0).ravel())
