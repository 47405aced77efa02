"""Surfaces of revolution that rays hit: cups, bowls, cans, bottles, balls."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.scenes.ray_casting import UNLABELLED, Solid


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Revolved(Solid):
    """The surface that a polyline sweeps out about the third axis; open or closed, and hit from either side.

    Attributes:
        profile: radius and height of the polyline's corners [k, 2], metres; height 0 is the middle of the extent.
    """

    profile: Float[np.ndarray, "k 2"]

    @classmethod
    def standing(cls, profile: Sequence[tuple[float, float]], label: int = UNLABELLED) -> "Revolved":
        """Upright, the axis through the origin of the world.

        Args:
            profile: radius and height of each corner; the height is that in the world.
            label: of what it belongs to.
        """
        corners = np.array(profile, float)
        widest, low, high = 2 * corners[:, 0].max(), corners[:, 1].min(), corners[:, 1].max()
        middle = np.array([0.0, 0.0, (low + high) / 2])
        extent = np.array([widest, widest, high - low])
        return cls(centre=middle, extent=extent, label=label, profile=corners - [0.0, middle[2]])

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Where each ray hits it first, in its own coordinates; inf where it does not."""
        lower, upper = self.profile[:-1], self.profile[1:]
        flat = np.abs(upper[:, 1] - lower[:, 1]) < 1e-9
        hits = np.full(len(along), np.inf)
        if flat.any():
            hits = np.fmin(hits, _annuli(start, along, lower[flat], upper[flat]))
        if not flat.all():
            hits = np.fmin(hits, _cones(start, along, lower[~flat], upper[~flat]))
        return hits


def _annuli(start: np.ndarray, along: np.ndarray, inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """Where rays cross the flat rings of the profile."""
    ranges = (inner[:, 1] - start[2]) / along[:, 2:]
    radius = np.hypot(*(start[axis] + ranges * along[:, axis, None] for axis in (0, 1)))
    least, most = np.minimum(inner[:, 0], outer[:, 0]), np.maximum(inner[:, 0], outer[:, 0])
    inside = (ranges > 0) & (radius >= least) & (radius <= most)
    return np.asarray(np.where(inside, ranges, np.inf).min(axis=1))


def _cones(start: np.ndarray, along: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Where rays cross the conical rings: x^2 + y^2 = r(z)^2 with the radius linear in the height."""
    slope = (upper[:, 0] - lower[:, 0]) / (upper[:, 1] - lower[:, 1])
    radius = lower[:, 0] + slope * (start[2] - lower[:, 1])
    growth = slope * along[:, 2:]
    quadratic = (along[:, :2] ** 2).sum(axis=1)[:, None] - growth**2
    linear = (along[:, :2] @ start[:2])[:, None] - growth * radius
    square = linear**2 - quadratic * (start[:2] @ start[:2] - radius**2)
    root = np.sqrt(np.where(square >= 0, square, np.nan))
    least, most = np.minimum(lower[:, 1], upper[:, 1]), np.maximum(lower[:, 1], upper[:, 1])
    nearest = np.full(len(along), np.inf)
    for ranges in ((-linear - root) / quadratic, (-linear + root) / quadratic):
        height = start[2] + ranges * along[:, 2:]
        inside = (ranges > 0) & (height >= least) & (height <= most) & (radius + ranges * growth >= 0)
        nearest = np.minimum(nearest, np.where(inside, ranges, np.inf).min(axis=1))
    return nearest
