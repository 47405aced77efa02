"""Points with masses: what a mixture is fitted to. Mass 0 is padding."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from gmmjax._typing import Array

SMALLEST_BUCKET = 256


class WeightedPoints(eqx.Module):
    """Points in d dimensions, each standing for a number of observations.

    Attributes:
        points: coordinates.
        mass: how many observations each point stands for, such as the count of its voxel; 0 is padding.
        scatter: covariance of those observations about the point, such as that within a voxel; None: they are at it.
    """

    points: Float[Array, "n d"]
    mass: Float[Array, " n"]
    scatter: Float[Array, "n d d"] | None = None

    def padded(self) -> "WeightedPoints":
        """Pad the points on the host with mass 0 to the next of the `bucket` sizes, so that few shapes compile."""
        padding = bucket(len(self.mass)) - len(self.mass)
        # Padding repeats the first point, so that it lies within the data's range whatever the offset.
        rows = np.concatenate([np.arange(len(self.mass)), np.zeros(padding, int)])
        scatter = None if self.scatter is None else np.asarray(self.scatter)[rows]
        return WeightedPoints(np.asarray(self.points)[rows], np.pad(np.asarray(self.mass), (0, padding)), scatter)


def bucket(size: int) -> int:
    """The padded size for `size` points: 256, 384, 512, 768, 1024, ...: two sizes an octave, at most a half wasted."""
    bucket = SMALLEST_BUCKET
    while size > bucket:
        # 2^i and 1.5 * 2^i alternate.
        bucket = bucket * 3 // 2 if bucket & (bucket - 1) == 0 else bucket * 4 // 3
    return bucket
