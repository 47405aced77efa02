"""Rigid motions as matrices [4, 4]."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry.rigid import rigid_transform


def looking_at(position: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """A camera's pose, upright: x right, y down, z towards the target."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return rigid_transform(np.stack([right, np.cross(forward, right), forward], axis=1), position)


def small_motion(random: np.random.Generator, shift: float, degrees: float) -> Float[np.ndarray, "4 4"]:
    """A motion of this length and angle in random directions."""
    axis, direction = (vector / np.linalg.norm(vector) for vector in random.standard_normal((2, 3)))
    return rigid_transform(Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix(), shift * direction)
