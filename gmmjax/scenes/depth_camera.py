"""A depth camera that looks at solids: noise, flying pixels and drop-outs included."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from gmmjax.scenes.depth_edges import behind_edges
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, cast
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
        least_range: nothing nearer is returned, metres.
        max_range: nor anything further.
        noise: standard deviation along the ray at 2 m; half of it is constant, half grows with the range.
        flying: share of the pixels at depth edges that fall between the two surfaces.
        lost: share of the pixels without a return.
        edge: a jump in range between neighbouring pixels from which there is a depth edge, metres.
    """

    columns: int = 224
    rows: int = 171
    field_of_view: tuple[float, float] = (62.0, 45.0)
    least_range: float = 0.3
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
        returned = (ranges > self.least_range) & (measured < self.max_range)
        returned &= random.random(len(ranges)) > self.lost
        returned &= random.random(len(ranges)) < self._facing(ranges) / GRAZING
        return np.where(returned, measured, np.nan), np.where(flies, UNLABELLED, labels)

    def frame(
        self, solids: Sequence[Solid], pose: Float[np.ndarray, "4 4"], random: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """The points that it returns from a pose, in the world, and the label of what each belongs to."""
        measured, labels = self.measured(solids, pose, random)
        returned = np.isfinite(measured)
        directions = self.directions() @ pose[:3, :3].T
        return pose[:3, 3] + directions[returned] * measured[returned, None], labels[returned]

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
