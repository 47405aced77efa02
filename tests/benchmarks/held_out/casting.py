"""Rays from one place against triangle meshes, terrain and foliage; no code of `gmmjax.scenes`."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

# Rays times triangles that are computed at one time.
CHUNK = 3_000_000
# The change of points that nobody can judge: rims where the ground was displaced by less than the noise.
RIM = 10_000


class Met(NamedTuple):
    """The rays that meet a body, by index [m], with the range and the cosine between ray and normal of each."""

    rays: np.ndarray
    ranges: np.ndarray
    facing: np.ndarray


class Body(Protocol):
    """What rays may meet."""

    @property
    def changes(self) -> frozenset[int]:
        """Ids of the changes that its points may be of."""

    def meet(
        self, origin: np.ndarray, directions: np.ndarray, random: np.random.Generator | None, lowered: float
    ) -> Met:
        """The rays [n, 3] from the origin that meet it; `lowered`: see `first_hits`."""

    def change_at(self, places: np.ndarray) -> np.ndarray:
        """The id of the change that places [n, 3] on it are of; -1 for none."""


@dataclasses.dataclass(frozen=True, eq=False)
class Thing:
    """A mesh with what became of it.

    Attributes:
        triangles: [t, 3, 3], metres.
        change: id of its change; -1: it is there at both times, in one place.
    """

    triangles: np.ndarray
    change: int = -1

    @property
    def changes(self) -> frozenset[int]:
        return frozenset({self.change} - {-1})

    @functools.cached_property
    def sphere(self) -> tuple[np.ndarray, float]:
        """Centre and radius of a sphere about it."""
        corners = self.triangles.reshape(-1, 3)
        centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return centre, float(np.linalg.norm(corners - centre, axis=1).max())

    def meet(
        self, origin: np.ndarray, directions: np.ndarray, random: np.random.Generator | None, lowered: float
    ) -> Met:
        rays = _near_rays(*self.sphere, origin, directions)
        step = max(1, CHUNK // len(self.triangles))
        parts = [
            _meet(self.triangles - origin, directions[rays[start : start + step]])
            for start in range(0, len(rays), step)
        ]
        ranges, facing = (np.concatenate(own) for own in zip(*parts, strict=True)) if parts else (np.empty(0),) * 2
        return Met(rays, ranges, facing)

    def change_at(self, places: np.ndarray) -> np.ndarray:
        return np.full(len(places), self.change)


@dataclasses.dataclass(frozen=True, eq=False)
class Foliage:
    """An ellipsoid of leaves, which stop each ray at another depth, and hide nothing for certain.

    Attributes:
        centre: metres.
        half: half its extent along the axes.
        free_path: mean depth that a ray reaches in it, metres.
    """

    centre: np.ndarray
    half: np.ndarray
    free_path: float
    changes: frozenset[int] = frozenset()

    def meet(
        self, origin: np.ndarray, directions: np.ndarray, random: np.random.Generator | None, lowered: float
    ) -> Met:
        rays = _near_rays(self.centre, float(self.half.max()), origin, directions) if random else np.empty(0, np.intp)
        if not random or not len(rays):
            return Met(rays, np.empty(0), np.empty(0))
        start, along = (origin - self.centre) / self.half, directions[rays] / self.half
        quadratic, linear = (along**2).sum(axis=1), along @ start
        root = np.sqrt(np.maximum(linear**2 - quadratic * (start @ start - 1), 0))
        stops = np.maximum((-linear - root) / quadratic, 0) + random.exponential(self.free_path, len(rays))
        ranges = np.where((root > 0) & (stops < (-linear + root) / quadratic), stops, np.inf)
        return Met(rays, ranges, np.full(len(rays), 0.7))

    def change_at(self, places: np.ndarray) -> np.ndarray:
        return np.full(len(places), -1)


@dataclasses.dataclass(frozen=True, eq=False)
class Terrain:
    """Heights at the nodes of a square grid, bilinear between them, met from above.

    Attributes:
        heights: [nx, ny], metres.
        lower: x and y of the first node.
        cell: distance of the nodes, metres.
        numbers: id of the change at each node, -1 for none, `RIM` where nobody can judge it; None: nothing changed.
        depths: by the id of a change how deep it is, metres.
    """

    heights: np.ndarray
    lower: np.ndarray
    cell: float
    numbers: np.ndarray | None = None
    depths: Mapping[int, float] = dataclasses.field(default_factory=dict)

    @property
    def changes(self) -> frozenset[int]:
        return frozenset(self.depths)

    def at(self, places: np.ndarray) -> np.ndarray:
        """The height at places [..., 2]; NaN outside."""
        steps = (places - self.lower) / self.cell
        inside = ((steps >= 0) & (steps < np.array(self.heights.shape) - 1)).all(axis=-1)
        x, y = np.moveaxis(np.where(inside[..., None], steps, 0.0).astype(np.intp), -1, 0)
        u, v = steps[..., 0] - x, steps[..., 1] - y
        low = self.heights[x, y] * (1 - v) + self.heights[x, y + 1] * v
        high = self.heights[x + 1, y] * (1 - v) + self.heights[x + 1, y + 1] * v
        return np.where(inside, low * (1 - u) + high * u, np.nan)

    def normals(self, places: np.ndarray) -> np.ndarray:
        """Unit normals at places [n, 2] over the width of a cell."""
        sides = self.cell / 2 * np.eye(2)
        rise = [(self.at(places + shift) - self.at(places - shift)) / self.cell for shift in sides]
        normals = np.stack([-rise[0], -rise[1], np.ones(len(places))], axis=1)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def change_at(self, places: np.ndarray) -> np.ndarray:
        if self.numbers is None:
            return np.full(len(places), -1)
        nodes = np.round((places[:, :2] - self.lower) / self.cell).astype(np.intp)
        x, y = np.clip(nodes, 0, np.array(self.heights.shape) - 1).T
        return np.asarray(self.numbers[x, y])

    def meet(
        self, origin: np.ndarray, directions: np.ndarray, random: np.random.Generator | None, lowered: float
    ) -> Met:
        level = np.maximum(np.hypot(directions[:, 0], directions[:, 1]), 1e-9)
        azimuths, tangents = np.arctan2(directions[:, 1], directions[:, 0]), directions[:, 2] / level
        corners = self.lower + self.cell * np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) * self.heights.shape
        distances = np.arange(0.5, np.linalg.norm(corners - origin[:2], axis=1).max(), 0.7 * self.cell)
        order = np.argsort(azimuths)
        # Rays that lie within half a cell of each other share a profile.
        numbers = np.floor(azimuths[order] / (self.cell / 2 / distances[-1]))
        flat = np.full(len(directions), np.inf)
        for rows in np.split(order, np.flatnonzero(np.diff(numbers)) + 1):
            azimuth = azimuths[rows].mean()
            line = origin[:2] + distances[:, None] * np.array([np.cos(azimuth), np.sin(azimuth)])
            rise = self.at(line) - origin[2] - lowered
            flat[rows] = _crossings(distances, rise, tangents[rows])
        rays = np.flatnonzero(np.isfinite(flat))
        places = origin + (flat[rays] / level[rays])[:, None] * directions[rays]
        facing = np.abs((self.normals(places[:, :2]) * directions[rays]).sum(axis=1))
        return Met(rays, flat[rays] / level[rays], np.nan_to_num(facing, nan=1.0))


class Hits(NamedTuple):
    """What each ray meets first.

    Attributes:
        ranges: inf where it meets nothing.
        change: id of the change that it meets; -1 for none.
        facing: cosine between the ray and the surface's normal.
    """

    ranges: np.ndarray
    change: np.ndarray
    facing: np.ndarray


def first_hits(
    bodies: Sequence[Body],
    origin: np.ndarray,
    directions: np.ndarray,
    random: np.random.Generator | None = None,
    lowered: float = 0.0,
) -> Hits:
    """Casts rays of unit direction [n, 3] from one place.

    Args:
        bodies: that may be met.
        origin: of the rays [3].
        directions: of the rays.
        random: of what stops a ray among leaves; None: there are none.
        lowered: by so much terrain is lower than it is, metres: rays that graze it pass.
    """
    hits = Hits(np.full(len(directions), np.inf), np.full(len(directions), -1), np.ones(len(directions)))
    for body in bodies:
        met = body.meet(origin, directions, random, lowered)
        nearer = met.ranges < hits.ranges[met.rays]
        rays = met.rays[nearer]
        hits.ranges[rays], hits.facing[rays] = met.ranges[nearer], met.facing[nearer]
        hits.change[rays] = body.change_at(origin + met.ranges[nearer, None] * directions[rays])
    return hits


def _crossings(distances: np.ndarray, rise: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """How far from the origin rays meet a profile; inf where they do not, or come from below."""
    skyline = np.maximum.accumulate(np.where(np.isnan(rise), -np.inf, rise / distances))
    after = np.searchsorted(skyline, tangents)
    rows = np.flatnonzero((after > 0) & (after < len(skyline)))
    following = after[rows]
    # The ray is above the terrain at the first sample and below it at the second.
    below, above = (rise[k] - tangents[rows] * distances[k] for k in (following - 1, following))
    flat = distances[following - 1] + below / (below - above) * np.diff(distances)[following - 1]
    result = np.full(len(tangents), np.inf)
    result[rows] = np.where(np.isfinite(flat), flat, np.inf)
    return result


def _near_rays(centre: np.ndarray, radius: float, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The rays that meet a sphere."""
    towards = centre - origin
    square = float(towards @ towards)
    if square <= radius**2:
        return np.arange(len(directions))
    return np.flatnonzero(directions @ towards >= np.sqrt(square - radius**2) - 1e-9)


def _meet(triangles: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest range of each ray, and how it faces the surface there; the origin is at zero.

    With one origin the signs of three products tell which triangles are met.
    """
    a, b, c = triangles.transpose(1, 0, 2)
    sides = [directions @ np.cross(*pair).T for pair in ((a, b), (b, c), (c, a))]
    least, most = np.minimum.reduce(sides), np.maximum.reduce(sides)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ray, which = np.nonzero((least >= -1e-12) | (most <= 1e-12))
    along = (directions[ray] * normal[which]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (a[which] * normal[which]).sum(axis=1) / along
    ahead = distance > 1e-6
    ray, distance, along = ray[ahead], distance[ahead], along[ahead]
    order = np.argsort(distance, kind="stable")[::-1]
    ranges, facing = np.full(len(directions), np.inf), np.ones(len(directions))
    # Of a ray's several hits the last one written is the nearest.
    ranges[ray[order]], facing[ray[order]] = distance[order], np.abs(along[order])
    return ranges, facing
