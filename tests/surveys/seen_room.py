"""A cube in a room, seen by a depth camera from several poses."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.geometry.rigid import rigid_transform
from gmmjax.scenes.ray_casting import Solid, cast
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.surveys import Frame, Intrinsics, Trajectory

CAMERA = Intrinsics.of_field_of_view((62.0, 45.0), 112, 85)
# Floor and walls of a room of 3 m, a step, and a cube.
SOLIDS = [
    Solid(np.array([0.013, 0.0, -0.05]), np.array([3.4, 3.4, 0.1])),
    *[Solid(np.array([side * 1.604, 0.0, 0.8]), np.array([0.2, 3.4, 1.8])) for side in (-1.0, 1.0)],
    *[Solid(np.array([0.0, side * 1.604, 0.8]), np.array([3.4, 0.2, 1.8])) for side in (-1.0, 1.0)],
    Solid(np.array([-0.9, 0.7, 0.2]), np.array([0.8, 0.5, 0.4]), yaw=0.4),
    Solid(np.array([0.1, -0.1, 0.203]), np.array([0.4, 0.4, 0.4]), yaw=0.3),
]


def around(count=8):
    """Poses on a circle that look at the cube, over it to the other wall."""
    angles = np.arange(count) * 2 * np.pi / count
    return np.stack(
        [looking_at(np.array([1.2 * np.cos(a), 1.2 * np.sin(a), 1.1]), np.array([0, 0, 0.2])) for a in angles]
    )


def frame(pose, time, noise=0.0, seed=0, solids=SOLIDS):
    """An ordered frame, with noise along the ray (standard deviation, metres) and a twentieth of the pixels lost."""
    random = np.random.default_rng([seed, int(time * 1000)])
    rays = CAMERA.rays()
    lengths = np.linalg.norm(rays, axis=1)
    ranges = cast(solids, pose[:3, 3], rays / lengths[:, None] @ pose[:3, :3].T)[0]
    ranges = ranges + noise * random.standard_normal(len(ranges))
    ranges[random.random(len(ranges)) < 0.05] = np.nan
    points = rays * (ranges / lengths)[:, None]
    return Frame.of_image(points.reshape(CAMERA.height, CAMERA.width, 3), time, "camera")


def survey(poses, noise=0.0, seed=0, solids=SOLIDS):
    """A frame from each pose, a second apart, and the trajectory."""
    times = np.arange(len(poses), dtype=float)
    frames = [frame(pose, float(time), noise, seed, solids) for pose, time in zip(poses, times, strict=True)]
    return frames, Trajectory(times, poses)


def off(poses, shift, degrees, seed=0):
    """The poses with random errors of this length and angle."""
    random = np.random.default_rng(seed)
    axes, directions = (x / np.linalg.norm(x, axis=1)[:, None] for x in random.standard_normal((2, len(poses), 3)))
    wrong = poses.copy()
    wrong[:, :3, :3] = Rotation.from_rotvec(np.radians(degrees) * axes).as_matrix() @ poses[:, :3, :3]
    wrong[:, :3, 3] += shift * directions
    return wrong


def distance_to_surfaces(points, solids=SOLIDS):
    """Of each point from the nearest face of a solid."""
    nearest = np.full(len(points), np.inf)
    for solid in solids:
        beyond = np.abs((points - solid.centre) @ solid.rotation) - solid.extent / 2
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        nearest = np.minimum(nearest, np.abs(outside + np.minimum(beyond.max(axis=1), 0)))
    return nearest


def motion(seed=0):
    """A rigid motion of the world."""
    rotation = Rotation.random(random_state=seed).as_matrix()
    return rigid_transform(rotation, np.random.default_rng(seed).uniform(-5, 5, 3))
