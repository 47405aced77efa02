"""The lining of a tunnel: a cylinder about the x axis that is uneven, as a height field over the unrolled wall."""

import dataclasses

import numpy as np

from tests.benchmarks.surveyor.terrain import Columns, Terrain

# Of Newton's iteration towards the wall: its steps, the least slope that it trusts, and how near it must come, metres.
STEPS, LEAST_SLOPE, NEAR_ENOUGH = 20, 0.1, 1e-4


@dataclasses.dataclass(frozen=True, eq=False)
class Lining:
    """A wall that surrounds whoever scans it.

    Attributes:
        radius: of the cylinder, metres.
        inward: how far the wall stands into the tunnel, over x and the arc length from the side where y is positive,
            upwards; the seam is at the bottom.
    """

    radius: float
    inward: Terrain

    @classmethod
    def arc(cls, radius: float) -> tuple[float, float]:
        """From where to where the arc length goes."""
        return -np.pi / 2 * radius, 3 * np.pi / 2 * radius

    def ranges(self, columns: Columns) -> np.ndarray:
        """How far along each ray it is met [c, r]; inf where the ray leaves the tunnel."""
        directions = columns.directions()
        origins = np.broadcast_to(columns.origins[:, None], directions.shape).reshape(-1, 3)
        along = directions.reshape(-1, 3)
        found = self._cylinder(origins, along)
        with np.errstate(invalid="ignore"):
            for _ in range(STEPS):
                places = origins + found[:, None] * along
                off, outward = self._off(places)
                found -= off / np.maximum((along * outward).sum(axis=1), LEAST_SLOPE)
            off, _ = self._off(origins + found[:, None] * along)
        met = (np.abs(off) < NEAR_ENOUGH) & (found > 0)
        return np.where(met, found, np.inf).reshape(directions.shape[:2])

    def normals(self, places: np.ndarray) -> np.ndarray:
        """Unit normals at places [n, 3], into the tunnel."""
        local = self.inward.normals(self.unrolled(places))
        outward = _outward(places)
        around = np.stack([np.zeros(len(places)), -outward[:, 2], outward[:, 1]], axis=1)
        return local[:, :1] * np.array([1.0, 0, 0]) + local[:, 1:2] * around - local[:, 2:] * outward

    def distances(self, places: np.ndarray) -> np.ndarray:
        """How far places [n, 3] are from it, across the cylinder; NaN beyond its ends."""
        return np.abs(self._off(places)[0])

    def sees(self, origin: np.ndarray, places: np.ndarray, slack: float) -> np.ndarray:
        """Which places [n, 3] it does not hide: all of them, as from anywhere inside."""
        return np.ones(len(places), bool)

    def nodes(self, places: np.ndarray) -> np.ndarray:
        """The nodes of its grid next to places [n, 3]."""
        return self.inward.nodes(self.unrolled(places))

    def unrolled(self, places: np.ndarray) -> np.ndarray:
        """x and the arc length of places [n, 3]."""
        angles = np.arctan2(places[:, 2], places[:, 1])
        angles = np.where(angles < -np.pi / 2, angles + 2 * np.pi, angles)
        return np.stack([places[:, 0], self.radius * angles], axis=1)

    def _off(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far places are outside of the wall, and which way that is."""
        reach = np.hypot(places[:, 1], places[:, 2])
        return reach - self.radius + self.inward.at(self.unrolled(places)), _outward(places)

    def _cylinder(self, origins: np.ndarray, along: np.ndarray) -> np.ndarray:
        quadratic = np.maximum((along[:, 1:] ** 2).sum(axis=1), 1e-12)
        linear = (origins[:, 1:] * along[:, 1:]).sum(axis=1)
        constant = (origins[:, 1:] ** 2).sum(axis=1) - self.radius**2
        return np.asarray((-linear + np.sqrt(linear**2 - quadratic * constant)) / quadratic)


def _outward(places: np.ndarray) -> np.ndarray:
    across = places * (0, 1, 1)
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))
