"""Solids of other shapes than boxes and cylinders: ellipsoids, bowls, cups, vegetation, ground, revolved profiles."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates

from gmmjax.scenes.ray_casting import UNLABELLED, Solid, through_box


@dataclasses.dataclass(frozen=True, eq=False)
class Ellipsoid(Solid):
    """An ellipsoid that fills its extent."""

    def contains(self, points: Float[np.ndarray, "n 3"], margin: float = 0.0) -> Bool[np.ndarray, " n"]:
        """Mask of the points inside, or outside by no more than the margin on each axis."""
        own = (points - self.centre) @ self.rotation / (self.extent / 2 + margin)
        return np.asarray((own**2).sum(axis=1) <= 1)

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates."""
        near, _ = _through_ellipsoid(start, along, self.extent / 2)
        return np.where(near > 0, near, np.inf)


@dataclasses.dataclass(frozen=True, eq=False)
class Bowl(Solid):
    """The lower half of an ellipsoid, open above, without thickness."""

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates; from inside too."""
        half = self.extent * [0.5, 0.5, 1.0]
        middle = np.array([0.0, 0.0, self.extent[2] / 2])
        return _first(
            [
                np.where(root * along[:, 2] + start[2] <= middle[2], root, np.inf)
                for root in _through_ellipsoid(start - middle, along, half)
            ]
        )


@dataclasses.dataclass(frozen=True, eq=False)
class Cup(Solid):
    """An elliptic cylinder with a bottom, open above, without thickness."""

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates; from inside too."""
        half = self.extent / 2
        flat = np.array([half[0], half[1], np.inf])
        sides = [
            np.where(np.abs(root * along[:, 2] + start[2]) <= half[2], root, np.inf)
            for root in _through_ellipsoid(start, along, flat)
        ]
        bottom = (-half[2] - start[2]) / along[:, 2]
        across = (start[:2] + bottom[:, None] * along[:, :2]) / half[:2]
        return _first([*sides, np.where((across**2).sum(axis=1) <= 1, bottom, np.inf)])


@dataclasses.dataclass(frozen=True, eq=False)
class Vegetation(Solid):
    """An ellipsoid of leaves: a ray is stopped at a random depth in it, or passes.

    The depth is drawn from the ray itself, so that no two surveys, whose rays differ, hit the same leaves.

    Attributes:
        free_path: mean depth that a ray reaches, metres.
    """

    free_path: float = 0.3

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates; from inside too."""
        enters, leaves = _through_ellipsoid(start, along, self.extent / 2)
        stopped = np.maximum(enters, 0.0) - self.free_path * np.log(_random_of(along))
        return np.where(stopped < leaves, stopped, np.inf)


@dataclasses.dataclass(frozen=True, eq=False)
class Ground(Solid):
    """Ground whose height differs from place to place.

    Attributes:
        heights: [rows, columns] above the middle of its extent, on a regular grid that spans the extent in x (rows)
            and y (columns), at least 2 x 2; all within half the extent's third length.
    """

    heights: Float[np.ndarray, "rows columns"] = dataclasses.field(default_factory=lambda: np.zeros((2, 2)))

    def height_at(self, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """The height of places in its own coordinates, bilinear between the nodes of the grid."""
        steps = np.array(self.heights.shape) - 1
        nodes = (places / self.extent[:2] + 0.5) * steps
        return np.asarray(map_coordinates(self.heights, nodes.T, order=1, mode="nearest"))

    def contains(self, points: Float[np.ndarray, "n 3"], margin: float = 0.0) -> Bool[np.ndarray, " n"]:
        """Mask of the points in the ground, or above it by no more than the margin."""
        own = (points - self.centre) @ self.rotation
        inside = (np.abs(own) <= self.extent / 2 + margin).all(axis=1)
        return np.asarray(inside & (own[:, 2] <= self.height_at(own[:, :2]) + margin))

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates, by steps of a grid cell, and bisection of the step that crosses."""
        enters, leaves = through_box(start, along, self.extent / 2)
        found = np.full(len(along), np.inf)
        active = np.flatnonzero(leaves > np.maximum(enters, 0.0))
        reached = np.maximum(enters, 0.0)[active]
        above = self._above(start, along[active], reached)
        active, reached, above = active[above > 0], reached[above > 0], above[above > 0]
        cell = float((self.extent[:2] / (np.array(self.heights.shape) - 1)).min())
        while len(active):
            stop = leaves[active]
            # A steep ray crosses the whole extent within a cell: it is stopped by the height as well.
            step = cell / np.maximum(np.linalg.norm(along[active, :2], axis=1), 0.25)
            following = np.minimum(reached + step, stop)
            left = self._above(start, along[active], following)
            crosses = left <= 0
            found[active[crosses]] = self._crossing(start, along[active[crosses]], reached[crosses], following[crosses])
            goes_on = ~crosses & (following < stop)
            active, reached, above = active[goes_on], following[goes_on], left[goes_on]
        return found

    def _crossing(self, start: np.ndarray, along: np.ndarray, above: np.ndarray, below: np.ndarray) -> np.ndarray:
        """Find where rays cross the ground between two ranges: five bisections, then linear interpolation."""
        for _ in range(5):
            middle = (above + below) / 2
            over = self._above(start, along, middle) > 0
            above, below = np.where(over, middle, above), np.where(over, below, middle)
        high, low = self._above(start, along, above), self._above(start, along, below)
        return np.asarray(above + (below - above) * high / (high - low))

    def _above(self, start: np.ndarray, along: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        places = start + ranges[:, None] * along
        return np.asarray(places[:, 2] - self.height_at(places[:, :2]))


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Revolved(Solid):
    """The surface that a polyline sweeps out about the third axis; open or closed, and hit from either side.

    Attributes:
        profile: radius and height of the polyline's corners [k, 2], metres; height 0 is the middle of the extent.
    """

    profile: Float[np.ndarray, "k 2"]

    @classmethod
    def standing(cls, profile: Sequence[tuple[float, float]], label: int = UNLABELLED) -> "Revolved":
        """Upright on the axis through the origin; the profile is radius and height of each corner in the world."""
        corners = np.array(profile, float)
        widest, low, high = 2 * corners[:, 0].max(), corners[:, 1].min(), corners[:, 1].max()
        middle = np.array([0.0, 0.0, (low + high) / 2])
        extent = np.array([widest, widest, high - low])
        return cls(centre=middle, extent=extent, label=label, profile=corners - [0.0, middle[2]])

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates; from either side."""
        lower, upper = self.profile[:-1], self.profile[1:]
        flat = np.abs(upper[:, 1] - lower[:, 1]) < 1e-9
        hits = np.full(len(along), np.inf)
        if flat.any():
            hits = np.fmin(hits, _annuli(start, along, lower[flat], upper[flat]))
        if not flat.all():
            hits = np.fmin(hits, _cones(start, along, lower[~flat], upper[~flat]))
        return hits


def _through_ellipsoid(start: np.ndarray, along: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ranges at which each ray enters and leaves an ellipsoid about the origin; NaN where it misses."""
    origin, direction = start / half, along / half
    quadratic, linear = (direction**2).sum(axis=1), direction @ origin
    discriminant = linear**2 - quadratic * (origin @ origin - 1)
    root = np.sqrt(np.where(discriminant >= 0, discriminant, np.nan))
    return (-linear - root) / quadratic, (-linear + root) / quadratic


def _first(candidates: list[np.ndarray]) -> np.ndarray:
    """The least positive range of each ray; inf where there is none."""
    return np.asarray(np.min([np.where(ranges > 0, ranges, np.inf) for ranges in candidates], axis=0))


def _random_of(along: np.ndarray) -> np.ndarray:
    """A number in (0, 1) for each ray, that looks random: neighbouring rays have unrelated ones."""
    bits = np.ascontiguousarray(along).view(np.uint64)
    mixed = bits[:, 0] ^ (bits[:, 1] << np.uint64(21)) ^ (bits[:, 2] >> np.uint64(13))
    for shift, factor in ((33, 0xFF51AFD7ED558CCD), (33, 0xC4CEB9FE1A85EC53), (33, 1)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray(((mixed >> np.uint64(12)).astype(float) + 0.5) / 2.0**52)


def _annuli(start: np.ndarray, along: np.ndarray, inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """Ranges at which rays cross the flat rings of the profile."""
    ranges = (inner[:, 1] - start[2]) / along[:, 2:]
    radius = np.hypot(*(start[axis] + ranges * along[:, axis, None] for axis in (0, 1)))
    least, most = np.minimum(inner[:, 0], outer[:, 0]), np.maximum(inner[:, 0], outer[:, 0])
    inside = (ranges > 0) & (radius >= least) & (radius <= most)
    return np.asarray(np.where(inside, ranges, np.inf).min(axis=1))


def _cones(start: np.ndarray, along: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Ranges at which rays cross the conical rings: x^2 + y^2 = r(z)^2 with the radius linear in the height."""
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
