"""A depth camera that triangulates: noise that grows with the square of the range, frames that are slowly distorted."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter

from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.ray_casting import Solid


@dataclasses.dataclass(frozen=True, eq=False)
class TriangulatingCamera:
    """Structured light or stereo, as of the common depth cameras for tables and rooms.

    Attributes:
        camera: its pixels, ranges, flying and lost pixels; its own noise is left out.
        noise: standard deviation along the ray at 1 m.
        blur: correlation length of the noise, pixels; 0 for independent pixels.
        distortion: standard deviation at 1 m of an error that differs slowly over the frame; it is that of one survey,
            drawn by `distortion_of`.
    """

    camera: DepthCamera
    noise: float
    blur: float
    distortion: float

    def distortion_of(self, random: np.random.Generator) -> Float[np.ndarray, " n"]:
        """What is wrong with all frames of one survey, per pixel at 1 m: a few waves longer than half the frame."""
        across, down = np.meshgrid(np.linspace(0, 1, self.camera.columns), np.linspace(0, 1, self.camera.rows))
        waves, phases = random.uniform(-1, 1, (4, 2)), random.uniform(0, 2 * np.pi, 4)
        parts = [
            np.cos(2 * np.pi * (wave[0] * across + wave[1] * down) + phase)
            for wave, phase in zip(waves, phases, strict=True)
        ]
        return np.asarray(self.distortion * np.sum(parts, axis=0).ravel() / np.sqrt(len(parts) / 2))

    def frame(
        self,
        solids: Sequence[Solid],
        pose: Float[np.ndarray, "4 4"],
        distortion: Float[np.ndarray, " pixels"],
        random: np.random.Generator,
        pixels: Bool[np.ndarray, " pixels"] | None = None,
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """The points that it returns from a pose, in the world, and the label of what each belongs to.

        Args:
            solids: of the scene.
            pose: camera to world.
            distortion: of the survey, per pixel at 1 m.
            random: of the noise, the lost and the flying pixels.
            pixels: which pixels are used; None: all.
        """
        ideal = dataclasses.replace(self.camera, noise=0.0)
        ranges, labels = ideal.measured(solids, pose, random)
        measured = ranges + ranges**2 * (distortion + self.noise * self._noise(random))
        returned = np.isfinite(measured) if pixels is None else np.isfinite(measured) & pixels
        directions = ideal.directions() @ pose[:3, :3].T
        return pose[:3, 3] + directions[returned] * measured[returned, None], labels[returned]

    def _noise(self, random: np.random.Generator) -> np.ndarray:
        """Of standard deviation 1, per pixel."""
        noise = random.standard_normal((self.camera.rows, self.camera.columns))
        if self.blur:
            noise = gaussian_filter(noise, self.blur)
            noise /= noise.std()
        return noise.ravel()
