"""Rigid transforms of simulated cameras and things, as matrices [4, 4]."""

from collections.abc import Sequence
from typing import SupportsFloat, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform

# Three lengths, of any kind of numbers.
Coordinates: TypeAlias = Sequence[SupportsFloat] | np.ndarray


def looking_at(position: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Pose of an upright camera, camera to world: x right, y down, z towards the target, which is not below it."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return rigid_transform(np.stack([right, np.cross(forward, right), forward], axis=1), position)


def upright(position: Float[np.ndarray, "3"], heading: float) -> Float[np.ndarray, "4 4"]:
    """Pose of a level camera or scanner; the heading is from the x axis to its z axis about the vertical, radians."""
    return looking_at(position, position + np.array([np.cos(heading), np.sin(heading), 0.0]))


def looking_down(position: Float[np.ndarray, "3"], heading: float) -> Float[np.ndarray, "4 4"]:
    """Pose of a camera or scanner that looks straight down, the top of its image towards the heading, radians."""
    top = np.array([np.cos(heading), np.sin(heading), 0.0])
    forward = np.array([0.0, 0.0, -1.0])
    return rigid_transform(np.stack([np.cross(-top, forward), -top, forward], axis=1), position)


def turned(yaw: float, at: Coordinates = (0.0, 0.0, 0.0)) -> Float[np.ndarray, "4 4"]:
    """Pose of a thing at a place, rotated about the vertical by the yaw, radians."""
    return rigid_transform(Rotation.from_euler("z", yaw).as_matrix(), np.array(at, float))


def small_motion(random: np.random.Generator, shift: float, degrees: float) -> Float[np.ndarray, "4 4"]:
    """Rigid transform of this translation, metres, and angle, about a random axis and in a random direction."""
    axis, direction = (vector / np.linalg.norm(vector) for vector in random.standard_normal((2, 3)))
    return rigid_transform(Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix(), shift * direction)
