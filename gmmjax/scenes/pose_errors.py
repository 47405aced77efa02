"""How far the poses that a survey believes in are off the true ones."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rotation_about
from gmmjax.scenes.rigid_motions import small_motion


@dataclasses.dataclass(frozen=True)
class PoseErrors:
    """How far the believed poses of a survey are off the true ones.

    Attributes:
        jitter: standard deviation of the shift of each pose on its own, metres.
        jitter_degrees: the same of its rotation.
        drift: shift at the end of the path, metres; it grows along the path.
        drift_degrees: the same of the rotation, about the place of the first pose.
    """

    jitter: float = 0.0
    jitter_degrees: float = 0.0
    drift: float = 0.0
    drift_degrees: float = 0.0

    def believed(self, poses: Float[np.ndarray, "v 4 4"], random: np.random.Generator) -> Float[np.ndarray, "v 4 4"]:
        """The poses with these errors."""
        axis, direction = (vector / np.linalg.norm(vector) for vector in random.standard_normal((2, 3)))
        shares = np.linspace(0.0, 1.0, len(poses)) if len(poses) > 1 else np.zeros(1)
        return np.stack(
            [
                self._jittered(self._drifted(pose, poses[0], share, axis, direction), random)
                for pose, share in zip(poses, shares, strict=True)
            ]
        )

    def _drifted(
        self, pose: np.ndarray, first: np.ndarray, share: float, axis: np.ndarray, direction: np.ndarray
    ) -> np.ndarray:
        turn = Rotation.from_rotvec(share * np.radians(self.drift_degrees) * axis).as_matrix()
        return rotation_about(turn, first[:3, 3], first[:3, 3] + share * self.drift * direction) @ pose

    def _jittered(self, pose: np.ndarray, random: np.random.Generator) -> np.ndarray:
        shift, degrees = np.abs(random.standard_normal(2)) * (self.jitter, self.jitter_degrees)
        motion = small_motion(random, shift, degrees)
        return rotation_about(motion[:3, :3], pose[:3, 3], pose[:3, 3] + motion[:3, 3]) @ pose
