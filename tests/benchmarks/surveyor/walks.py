"""A mobile scanner that is carried along straight lines, and turns in planes across its way."""

import dataclasses

import numpy as np

from tests.benchmarks.surveyor.scanning import World, sees
from tests.benchmarks.surveyor.terrain import Columns

# Each plane is turned from straight ahead by these angles: two heads, crossed.
HEADS = np.radians([45.0, -135.0, -45.0, 135.0])


@dataclasses.dataclass(frozen=True, eq=False)
class Walk:
    """One straight part of the way.

    Attributes:
        start: of the scanner [3].
        end: likewise.
        elevations: of the lowest and of the highest ray, radians.
    """

    start: np.ndarray
    end: np.ndarray
    elevations: tuple[float, float] = (np.radians(-65), np.radians(89))

    @property
    def position(self) -> np.ndarray:
        """The middle of it."""
        return (self.start + self.end) / 2

    @property
    def azimuths(self) -> tuple[float, float]:
        """Of a turning scanner that would see as much, radians."""
        return self._heading - np.pi, self._heading + np.pi

    def columns(self, rays: float, random: np.random.Generator) -> Columns:
        """About so many rays; where it is carried faster, fewer."""
        length = float(np.linalg.norm(self.end - self.start))
        low, high = self.elevations
        # As dense along the way as in the planes, at six metres.
        rows = max(8, int(np.sqrt(rays / len(HEADS) * 6 * (high - low) / length)))
        stops = max(2, int(rays / len(HEADS) / rows))
        pace = 1 + 0.5 * np.sin(np.linspace(0, random.uniform(6, 12), stops) + random.uniform(0, 6))
        share = np.cumsum(pace) / pace.sum()
        places = self.start + share[:, None] * (self.end - self.start)
        return Columns(
            np.tile(places, (len(HEADS), 1)),
            np.repeat(self._heading + HEADS, stops),
            np.linspace(low, high, rows) + random.uniform(0, (high - low) / rows),
        )

    def seen(self, world: World, places: np.ndarray, slack: float, random: np.random.Generator) -> np.ndarray:
        """Which places lie on what it sees, or before it, as one of its planes passes them."""
        length = float(np.linalg.norm((self.end - self.start)[:2]))
        forward = (self.end - self.start) / length
        offset = (places - self.start)[:, :2]
        along, across = offset @ forward[:2], np.abs(offset @ np.array([-forward[1], forward[0]]))
        visible = np.zeros(len(places), bool)
        for stop in (along - across, along + across):
            rows = np.flatnonzero(~visible & (stop >= 0) & (stop <= length))
            origins = self.start + stop[rows, None] * forward
            rise = np.arctan2(places[rows, 2] - origins[:, 2], np.hypot(across[rows], across[rows]))
            inside = (rise >= self.elevations[0]) & (rise <= self.elevations[1])
            rows, origins = rows[inside], origins[inside]
            if len(rows):
                visible[rows] = sees(world, origins, places[rows], slack, random)
        return visible

    @property
    def _heading(self) -> float:
        across = self.end - self.start
        return float(np.arctan2(across[1], across[0]))
