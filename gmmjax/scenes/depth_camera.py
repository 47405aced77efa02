"""Depth cameras that look at solids: noise, flying pixels and drop-outs included."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter

from gmmjax.scenes.ray_casting import UNLABELLED, Solid, behind_edges, cast
from gmmjax.scenes.recording import PoseErrors, Recording, joined
from gmmjax.surveys import Intrinsics

# Surfaces whose normal is further from the ray than this cosine return less and less, none at zero.
GRAZING = 0.2


@dataclasses.dataclass(frozen=True)
class DepthCamera:
    """A time-of-flight camera like the thesis's HazCam (224 x 171 pixels).

    Attributes:
        columns: pixels across.
        rows: pixels down.
        field_of_view: full horizontal and vertical angle, degrees.
        min_range: nothing nearer is returned, metres.
        max_range: nor anything further.
        noise: standard deviation along the ray at 2 m; half of it is constant, half grows with the range.
        flying: share of the pixels at depth edges that fall between the two surfaces.
        lost: share of the pixels without a return.
        edge: a jump in range between neighbouring pixels from which there is a depth edge, metres.
    """

    columns: int = 224
    rows: int = 171
    field_of_view: tuple[float, float] = (62.0, 45.0)
    min_range: float = 0.3
    max_range: float = 4.0
    noise: float = 0.008
    flying: float = 0.05
    lost: float = 0.03
    edge: float = 0.1

    def directions(self) -> Float[np.ndarray, "n 3"]:
        """Unit directions of all pixels, row by row; x right, y down, z forward."""
        across, down = (np.tan(np.radians(angle) / 2) for angle in self.field_of_view)
        x = across * ((np.arange(self.columns) + 0.5) / self.columns * 2 - 1)
        y = down * ((np.arange(self.rows) + 0.5) / self.rows * 2 - 1)
        rays = np.stack([*np.meshgrid(x, y), np.ones((self.rows, self.columns))], axis=-1).reshape(-1, 3)
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def intrinsics(self) -> Intrinsics:
        """Its pinhole model."""
        return Intrinsics.of_field_of_view(self.field_of_view, self.columns, self.rows)

    def measured(
        self, solids: Sequence[Solid], pose: Float[np.ndarray, "4 4"], random: np.random.Generator
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """The range along the ray of every pixel, NaN where there is no return, and the label of what is seen there."""
        ranges, labels = cast(solids, pose[:3, 3], self.directions() @ pose[:3, :3].T)
        ranges = np.minimum(ranges, 2 * self.max_range)
        measured = ranges + self.noise * (0.5 + ranges / 4) * random.standard_normal(len(ranges))
        behind = behind_edges(ranges.reshape(self.rows, self.columns), self.edge).ravel()
        flies = (behind > ranges) & (random.random(len(ranges)) < self.flying)
        measured = np.where(flies, ranges + random.random(len(ranges)) * (behind - ranges), measured)
        returned = (ranges > self.min_range) & (measured < self.max_range)
        returned &= random.random(len(ranges)) > self.lost
        returned &= random.random(len(ranges)) < self._facing(ranges) / GRAZING
        return np.where(returned, measured, np.nan), np.where(flies, UNLABELLED, labels)

    def frame(
        self, solids: Sequence[Solid], pose: Float[np.ndarray, "4 4"], random: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """The points that it returns from a pose, in the world, and the label of what each belongs to."""
        measured, labels = self.measured(solids, pose, random)
        return self.points(pose, measured), labels[np.isfinite(measured)]

    def points(self, pose: Float[np.ndarray, "4 4"], ranges: Float[np.ndarray, " n"]) -> Float[np.ndarray, "m 3"]:
        """End points in the world of the pixels' rays from a pose, without those that have no range (NaN)."""
        returned = np.isfinite(ranges)
        directions = self.directions() @ pose[:3, :3].T
        return np.asarray(pose[:3, 3] + directions[returned] * ranges[returned, None])

    def _facing(self, ranges: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Cosine between each ray and the surface's normal, from the neighbouring pixels; 1 at edges and borders."""
        places = (self.directions() * ranges[:, None]).reshape(self.rows, self.columns, 3)
        right = places[1:-1, 2:] - places[1:-1, :-2]
        down = places[2:, 1:-1] - places[:-2, 1:-1]
        normal = np.cross(right, down)
        length = np.linalg.norm(normal, axis=2) * np.linalg.norm(places[1:-1, 1:-1], axis=2)
        facing = np.ones((self.rows, self.columns))
        cosine = np.abs((normal * places[1:-1, 1:-1]).sum(axis=2)) / np.maximum(length, 1e-12)
        smooth = np.maximum(np.linalg.norm(right, axis=2), np.linalg.norm(down, axis=2)) < self.edge
        facing[1:-1, 1:-1] = np.where(smooth, cosine, 1.0)
        return facing.ravel()


def recorded_frames(
    camera: DepthCamera,
    solids: Sequence[Solid],
    poses: Float[np.ndarray, "v 4 4"],
    random: np.random.Generator,
    errors: PoseErrors = PoseErrors(),
) -> Recording:
    """The frames of a depth camera, one beside the other in one cloud."""
    believed = errors.believed(poses, random)
    frames = [camera.frame(solids, pose, random) for pose in poses]
    return joined(frames, poses, believed, camera.field_of_view, camera.max_range)


@dataclasses.dataclass(frozen=True, eq=False)
class TriangulatingCamera:
    """Structured light or stereo: noise that grows with the square of the range, frames that are slowly distorted.

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
        """The error of all frames of one survey, per pixel at 1 m: a few waves longer than half the frame."""
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
        if pixels is not None:
            measured[~pixels] = np.nan
        return ideal.points(pose, measured), labels[np.isfinite(measured)]

    def recording(
        self, solids: Sequence[Solid], poses: Float[np.ndarray, "v 4 4"], random: np.random.Generator
    ) -> Recording:
        """A frame from each pose; the distortion is the same in all."""
        distortion = self.distortion_of(random)
        return self.joined([self.frame(solids, pose, distortion, random) for pose in poses], poses)

    def joined(
        self,
        frames: Sequence[tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, " _"]]],
        poses: Float[np.ndarray, "v 4 4"],
    ) -> Recording:
        """The recording of these frames, whose poses are known."""
        return joined(frames, poses, poses, self.camera.field_of_view, self.camera.max_range)

    def _noise(self, random: np.random.Generator) -> np.ndarray:
        """Noise of standard deviation 1, per pixel."""
        noise = random.standard_normal((self.camera.rows, self.camera.columns))
        if self.blur:
            noise = gaussian_filter(noise, self.blur)
            noise /= noise.std()
        return noise.ravel()
