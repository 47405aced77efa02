"""Rigid transforms of simulated cameras, as matrices [4, 4]."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform


def looking_at(position: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The pose of an upright camera, camera to world: x right, y down, z towards the target.

    Args:
        position: of the camera, in the world.
        target: point on its optical axis; not straight above or below the camera.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return rigid_transform(np.stack([right, np.cross(forward, right), forward], axis=1), position)


def upright(position: Float[np.ndarray, "3"], heading: float) -> Float[np.ndarray, "4 4"]:
    """The pose of a camera or scanner that stands level.

    Args:
        position: in the world.
        heading: direction of its z axis from the world's x axis about the vertical, radians.
    """
    return looking_at(position, position + np.array([np.cos(heading), np.sin(heading), 0.0]))


def looking_down(position: Float[np.ndarray, "3"], heading: float) -> Float[np.ndarray, "4 4"]:
    """The pose of a camera or scanner whose z axis points straight down.

    Args:
        position: in the world.
        heading: direction of the top of its image, radians.
    """
    top = np.array([np.cos(heading), np.sin(heading), 0.0])
    forward = np.array([0.0, 0.0, -1.0])
    return rigid_transform(np.stack([np.cross(-top, forward), -top, forward], axis=1), position)


def small_motion(random: np.random.Generator, shift: float, degrees: float) -> Float[np.ndarray, "4 4"]:
    """A rigid transform with random rotation axis and direction of translation.

    Args:
        random: of the axis and the direction.
        shift: length of the translation.
        degrees: angle of the rotation.
    """
    axis, direction = (vector / np.linalg.norm(vector) for vector in random.standard_normal((2, 3)))
    return rigid_transform(Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix(), shift * direction)
