"""Depth cameras and turning scanners: what they return of a scene, with their noise."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from tests.benchmarks.held_out.casting import Body, first_hits


class Frame(NamedTuple):
    """What a sensor returned from one pose.

    Attributes:
        measured: points in the sensor's own coordinates [n, 3].
        places: where on the surfaces they truly are, in the world [n, 3].
        change: id of the change that each is of; -1 for none, and for those between two surfaces.
    """

    measured: np.ndarray
    places: np.ndarray
    change: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor with a fixed grid of rays; x right, y down, z forward.

    Attributes:
        rays: unit directions [rows, columns, 3].
        field_of_view: full horizontal and vertical angle, degrees.
        max_range: metres.
        noise: standard deviation along the ray as a polynomial of the range in metres, lowest power first.
        quantum: step of the inverse range, 1 / metres, as of a disparity; 0: none.
        blur: how far the noise of neighbouring pixels is alike, pixels.
        slanted: how much noise grows with the slant of the surface: by this times (1 / cosine - 1).
        mixed: share of the pixels at depth edges that return something between the two surfaces.
        edge_lost: share of them that return nothing.
        lost: share of all pixels that return nothing.
        grazing: cosine below which a surface returns nothing.
        blocked: rays that the carrier is in the way of [rows, columns]; None: none.
        min_range: metres.
        window: azimuths and elevations that are scanned, degrees; None: those of the field of view.
    """

    rays: np.ndarray
    field_of_view: tuple[float, float]
    max_range: float
    noise: tuple[float, ...]
    quantum: float = 0.0
    blur: float = 0.0
    slanted: float = 0.0
    mixed: float = 0.05
    edge_lost: float = 0.2
    lost: float = 0.02
    grazing: float = 0.1
    blocked: np.ndarray | None = None
    min_range: float = 0.2
    window: tuple[tuple[float, float], tuple[float, float]] | None = None

    def frame(self, bodies: Sequence[Body], pose: np.ndarray, random: np.random.Generator) -> Frame:
        """What it returns from a pose [4, 4], sensor to world."""
        shape, rays = self.rays.shape[:2], self.rays.reshape(-1, 3)
        hits = first_hits(bodies, pose[:3, 3], rays @ pose[:3, :3].T, random)
        ranges = np.where(np.isfinite(hits.ranges), hits.ranges, 4 * self.max_range)
        beyond = _beyond_edge(ranges.reshape(shape)).ravel()
        edge = beyond > ranges
        deviation = np.polynomial.Polynomial(self.noise)(np.minimum(ranges, self.max_range))
        deviation *= 1 + self.slanted * np.minimum(1 / np.maximum(hits.facing, 0.05) - 1, 5)
        measured = ranges + deviation * self._normal(shape, random)
        mixes = edge & (random.random(len(rays)) < self.mixed) & (beyond < 2 * self.max_range)
        measured = np.where(mixes, ranges + random.random(len(rays)) * (beyond - ranges), measured)
        if self.quantum:
            measured = 1 / (np.maximum(np.round(1 / measured / self.quantum), 1) * self.quantum)
        kept = (ranges > self.min_range) & (measured > self.min_range) & (measured < self.max_range)
        kept &= (random.random(len(rays)) >= self.lost) & (hits.facing > self.grazing * random.uniform(0.5, 1.5))
        kept &= mixes | ~edge | (random.random(len(rays)) >= self.edge_lost)
        kept &= np.isfinite(hits.ranges)
        if self.blocked is not None:
            kept &= ~self.blocked.ravel()
        places = pose[:3, 3] + (rays[kept] * ranges[kept, None]) @ pose[:3, :3].T
        return Frame(rays[kept] * measured[kept, None], places, np.where(mixes, -1, hits.change)[kept])

    def sees(self, points: np.ndarray, bodies: Sequence[Body], pose: np.ndarray, slack: float) -> np.ndarray:
        """Which points of the world lie on the surfaces, or before the surfaces, that it observes from a pose."""
        x, y, z = own = ((points - pose[:3, 3]) @ pose[:3, :3]).T
        across, up = (np.array([-angle, angle]) / 2 for angle in self.field_of_view)
        if self.window:
            across, up = map(np.array, self.window)
        depth = np.hypot(x, z) if self.field_of_view[0] > 180 else z
        ranges = np.linalg.norm(own, axis=0)
        azimuth, elevation = np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(-y, depth))
        inside = (azimuth >= across[0]) & (azimuth <= across[1]) & (elevation >= up[0]) & (elevation <= up[1])
        rows = np.flatnonzero(inside & (ranges < self.max_range) & (ranges > self.min_range))
        directions = (points[rows] - pose[:3, 3]) / ranges[rows, None]
        hits = first_hits(bodies, pose[:3, 3], directions, lowered=slack)
        visible = np.zeros(len(points), bool)
        visible[rows] = hits.ranges > ranges[rows] - slack
        return visible

    def _normal(self, shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
        noise = random.standard_normal(shape)
        if self.blur:
            noise = gaussian_filter(noise, self.blur)
            noise /= noise.std()
        return noise.ravel()


def camera(
    columns: int, rows: int, degrees: float, max_range: float, noise: tuple[float, ...], **settings: float
) -> Sensor:
    """A depth camera with square pixels.

    Args:
        columns: pixels across.
        rows: pixels down.
        degrees: horizontal field of view.
        max_range: metres.
        noise: see `Sensor`.
        settings: the other attributes of `Sensor`.
    """
    half = np.tan(np.radians(degrees) / 2)
    across = half * (2 * (np.arange(columns) + 0.5) / columns - 1)
    down = half * rows / columns * (2 * (np.arange(rows) + 0.5) / rows - 1)
    rays = np.stack([*np.meshgrid(across, down), np.ones((rows, columns))], axis=-1)
    vertical = 2 * float(np.degrees(np.arctan(half * rows / columns)))
    unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    return Sensor(unit, (degrees, vertical), max_range, noise, **settings)


def scanner(
    columns: int, elevations: np.ndarray, max_range: float, noise: tuple[float, ...], **settings: float | np.ndarray
) -> Sensor:
    """A scanner that turns about its y axis.

    Args:
        columns: steps of the full turn.
        elevations: of its rings, degrees; upwards is positive.
        max_range: metres.
        noise: see `Sensor`.
        settings: the other attributes of `Sensor`.
    """
    azimuth = np.linspace(-np.pi, np.pi, columns, endpoint=False)
    a, e = np.meshgrid(azimuth, np.radians(elevations))
    rays = np.stack([np.cos(e) * np.sin(a), -np.sin(e), np.cos(e) * np.cos(a)], axis=-1)
    vertical = min(2 * float(np.abs(elevations).max()) + 0.2, 179.0)
    return Sensor(rays, (360.0, vertical), max_range, noise, **settings)


def looking(
    position: Sequence[float] | np.ndarray, target: Sequence[float] | np.ndarray, roll: float = 0.0
) -> np.ndarray:
    """The pose [4, 4] of a sensor that looks from one place to another, turned about its axis by `roll` degrees."""
    position, target = np.asarray(position, float), np.asarray(target, float)
    forward = (target - position) / np.linalg.norm(target - position)
    up = np.array([0.0, 0, 1]) if abs(forward[2]) < 0.99 else np.array([0.0, 1, 0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([c * right + s * down, c * down - s * right, forward], axis=1)
    pose[:3, 3] = position
    return pose


def tripod(
    rays: float, turn: tuple[float, float], rise: tuple[float, float], max_range: float, noise: tuple[float, ...]
) -> Sensor:
    """A terrestrial scanner with about so many rays, in equal steps of azimuth (`turn`) and elevation, degrees."""
    step = np.sqrt((turn[1] - turn[0]) * (rise[1] - rise[0]) / rays)
    a, e = np.meshgrid(*(np.radians(np.arange(low, high - step / 2, step)) for low, high in (turn, rise)))
    directions = np.stack([np.cos(e) * np.sin(a), -np.sin(e), np.cos(e) * np.cos(a)], axis=-1)
    settings = {"slanted": 0.15, "mixed": 0.15, "edge_lost": 0.01, "lost": 0.01, "grazing": 0.04, "min_range": 0.6}
    return Sensor(directions, (360.0, 179.0), max_range, noise, **settings, window=(turn, rise))


def _beyond_edge(image: np.ndarray) -> np.ndarray:
    """The farthest of a pixel's four neighbours that is beyond a depth edge; its own range where there is none.

    On a plane the inverse range is nearly linear from pixel to pixel, at an edge it is not.
    """
    beyond = image.copy()
    for own, far in ((image, beyond), (image.T, beyond.T)):
        before, after = np.vstack([own[:1], own[:-1]]), np.vstack([own[1:], own[-1:]])
        bend = np.abs(1 / before + 1 / after - 2 / own) * own
        for other in (before, after):
            np.maximum(far, np.where((bend > 0.04) & (other > 1.03 * own + 0.02), other, own), out=far)
    return beyond
