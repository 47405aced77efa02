"""Terrain as a height field: rays meet it column by column, each column of one azimuth from one place."""

import dataclasses
from typing import NamedTuple

import numpy as np


class Columns(NamedTuple):
    """The rays of a scanner: each column lies in an upright half plane.

    Attributes:
        origins: where each column starts [c, 3].
        azimuths: its direction from the x axis about the vertical, radians [c].
        elevations: of its rays above the horizon, radians, increasing [r].
    """

    origins: np.ndarray
    azimuths: np.ndarray
    elevations: np.ndarray

    def directions(self) -> np.ndarray:
        """Unit directions [c, r, 3]."""
        level, up = np.cos(self.elevations), np.sin(self.elevations)
        flat = np.stack([np.cos(self.azimuths), np.sin(self.azimuths)], axis=1)[:, None] * level[:, None]
        return np.concatenate([flat, np.broadcast_to(up[:, None], (*flat.shape[:2], 1))], axis=2)

    def part(self, rows: slice) -> "Columns":
        return Columns(self.origins[rows], self.azimuths[rows], self.elevations)


@dataclasses.dataclass(frozen=True, eq=False)
class Terrain:
    """Heights at the nodes of a square grid, bilinear between them.

    Attributes:
        heights: [nx, ny], metres.
        lower: x and y of the first node.
        cell: distance of the nodes, metres.
    """

    heights: np.ndarray
    lower: np.ndarray
    cell: float

    def at(self, places: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
        """The height, or another quantity of the nodes, at places [..., 2]; NaN outside."""
        grid = self.heights if values is None else values
        steps = (places - self.lower) / self.cell
        inside = ((steps >= 0) & (steps < np.array(grid.shape) - 1)).all(axis=-1)
        x, y = np.where(inside[..., None], steps, 0.0).astype(np.intp).transpose(-1, *range(steps.ndim - 1))
        u, v = steps[..., 0] - x, steps[..., 1] - y
        low = grid[x, y] * (1 - v) + grid[x, y + 1] * v
        high = grid[x + 1, y] * (1 - v) + grid[x + 1, y + 1] * v
        return np.where(inside, low * (1 - u) + high * u, np.nan)

    def normals(self, places: np.ndarray) -> np.ndarray:
        """Unit normals at places [n, 2], or above or below them [n, 3], over the width of a cell."""
        step, places = self.cell / 2, places[:, :2]
        rise = [
            (self.at(places + shift) - self.at(places - shift)) / self.cell
            for shift in (np.array([step, 0]), np.array([0, step]))
        ]
        normals = np.stack([-rise[0], -rise[1], np.ones(len(places))], axis=1)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def distances(self, places: np.ndarray) -> np.ndarray:
        """How far places [n, 3] are from it, to first order; NaN outside."""
        return np.abs(places[:, 2] - self.at(places[:, :2])) * self.normals(places)[:, 2]

    def nodes(self, places: np.ndarray) -> np.ndarray:
        """The nodes of the grid next to places [n, 2 or 3]."""
        nodes = np.round((places[:, :2] - self.lower) / self.cell).astype(np.intp)
        return np.clip(nodes, 0, np.array(self.heights.shape) - 1)

    def ranges(self, columns: Columns) -> np.ndarray:
        """How far along each ray it is met [c, r]; inf where it is not, or where the ray comes from below."""
        result = np.full((len(columns.azimuths), len(columns.elevations)), np.inf)
        tangents = np.tan(columns.elevations)
        for first in range(0, len(result), 64):
            own = columns.part(slice(first, first + 64))
            distances, rise = self._profiles(own.origins, own.azimuths)
            horizon = np.maximum.accumulate(np.where(np.isnan(rise), -np.inf, rise / distances), axis=1)
            for column, skyline in enumerate(horizon):
                following = np.searchsorted(skyline, tangents)
                rows = np.flatnonzero((following > 0) & (following < len(skyline)))
                after = following[rows]
                # The ray is above the terrain at the first sample and below it at the second.
                below, above = (rise[column, k] - tangents[rows] * distances[k] for k in (after - 1, after))
                share = below / (below - above)
                flat = distances[after - 1] + share * (distances[after] - distances[after - 1])
                met = flat / np.cos(columns.elevations[rows])
                result[first + column, rows] = np.where(np.isfinite(met), met, np.inf)
        return result

    def sees(self, origin: np.ndarray, places: np.ndarray, slack: float) -> np.ndarray:
        """Which places [n, 3] the terrain does not hide from one origin.

        Args:
            origin: of the rays.
            places: on the terrain or above it.
            slack: a place is hidden when the ray passes below the terrain by more than this, metres.
        """
        offset = places - origin
        distance, azimuth = np.hypot(offset[:, 0], offset[:, 1]), np.arctan2(offset[:, 1], offset[:, 0])
        step = self.cell / 2 / max(float(distance.max()), 1.0)
        order = np.argsort(azimuth)
        numbers = np.floor(azimuth[order] / step).astype(np.int64)
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        visible = np.zeros(len(places), bool)
        for first in range(0, len(starts), 64):
            own = starts[first : first + 64]
            end = starts[first + 64] if first + 64 < len(starts) else len(order)
            rows = order[own[0] : end]
            azimuths = (numbers[own] + 0.5) * step
            distances, rise = self._profiles(np.broadcast_to(origin, (len(own), 3)), azimuths)
            skyline = np.where(np.isnan(rise), -np.inf, (rise - slack) / distances)
            horizon = np.maximum.accumulate(skyline, axis=1)
            column = np.searchsorted(own, np.arange(own[0], end), side="right") - 1
            before = np.searchsorted(distances, distance[rows])
            hidden = horizon[column, np.maximum(before - 1, 0)] > offset[rows, 2] / distance[rows]
            visible[rows] = (before == 0) | ~hidden
        return visible

    def _profiles(self, origins: np.ndarray, azimuths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Level distances [s], and how far the terrain rises above the origins there [c, s]; NaN outside."""
        corners = self.lower + self.cell * np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) * self.heights.shape
        farthest = np.linalg.norm(corners[:, None] - origins[None, :, :2], axis=2).max()
        distances = np.arange(0.5, farthest, 0.7 * self.cell)
        level = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        places = origins[:, None, :2] + distances[:, None] * level[:, None]
        return distances, self.at(places) - origins[:, 2:]
