"""Laser scanners that look at solids: on a tripod, spinning on something that walks or drives, from an aircraft."""

import abc
import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from gmmjax.scenes.ray_casting import UNLABELLED, Solid, behind_edges, cast
from gmmjax.scenes.recording import PoseErrors, Recording, joined

# Widest vertical field of view of `SensorViews`, degrees.
WIDEST_VERTICAL = 179.0


@dataclasses.dataclass(frozen=True)
class Beam:
    """Range measurement of a laser.

    Attributes:
        noise: standard deviation along the ray, metres.
        growth: what the noise grows by with every metre of range.
        min_range: nothing nearer is returned, metres.
        max_range: nor anything further.
        mixed: share of the rays at depth edges that return something between the two surfaces.
        edge: a jump in range between neighbouring rays from which there is a depth edge, metres.
        lost: share of the rays without a return.
    """

    noise: float = 0.003
    growth: float = 0.0002
    min_range: float = 0.4
    max_range: float = 60.0
    mixed: float = 0.1
    edge: float = 0.1
    lost: float = 0.02

    def points(
        self,
        solids: Sequence[Solid],
        pose: Float[np.ndarray, "4 4"],
        directions: Float[np.ndarray, "rows columns 3"],
        random: np.random.Generator,
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """The points that it returns from a pose, in the world, and the label of what each belongs to.

        Args:
            solids: that it looks at.
            pose: of the sensor, sensor to world.
            directions: unit directions of its rays, in the sensor's coordinates; neighbours are neighbours.
            random: of noise, mixed rays and losses.
        """
        rays = directions.reshape(-1, 3) @ pose[:3, :3].T
        ranges, labels = cast(solids, pose[:3, 3], rays)
        # The sky gives no edges: a ray that hits nothing else has nothing to mix.
        hit = np.isfinite(ranges)
        ranges = np.where(hit, ranges, 0.0)
        behind = behind_edges(ranges.reshape(directions.shape[:2]), self.edge).ravel()
        mixes = hit & (behind > ranges) & (random.random(len(ranges)) < self.mixed)
        ranges = np.where(mixes, ranges + random.random(len(ranges)) * (behind - ranges), ranges)
        measured = ranges + (self.noise + self.growth * ranges) * random.standard_normal(len(ranges))
        returned = hit & (ranges > self.min_range) & (measured < self.max_range)
        returned &= random.random(len(ranges)) > self.lost
        points = pose[:3, 3] + rays[returned] * measured[returned, None]
        return points, np.where(mixes, UNLABELLED, labels)[returned]


@dataclasses.dataclass(frozen=True)
class LaserScanner:
    """Scanner that measures its own set of directions once from each pose.

    Attributes:
        beam: how it measures.
    """

    beam: Beam = Beam()

    def recording(
        self,
        solids: Sequence[Solid],
        poses: Float[np.ndarray, "v 4 4"],
        random: np.random.Generator,
        errors: PoseErrors = PoseErrors(),
    ) -> Recording:
        """One scan from each pose, which is a camera's that looks at the middle of the field of view."""
        frames = [self.beam.points(solids, pose, self._directions(random), random) for pose in poses]
        believed = errors.believed(poses, random)
        return joined(frames, poses, believed, self._field_of_view, self.beam.max_range, self._min_elevation)

    @abc.abstractmethod
    def _directions(self, random: np.random.Generator) -> Float[np.ndarray, "rows columns 3"]:
        """Unit directions of its rays, in its own coordinates: x right, y down, z forward."""

    @property
    @abc.abstractmethod
    def _field_of_view(self) -> tuple[float, float]:
        """Full horizontal and vertical angle, degrees."""

    @property
    def _min_elevation(self) -> float:
        return -90.0


@dataclasses.dataclass(frozen=True)
class TripodScanner(LaserScanner):
    """A terrestrial scanner that stands level: the sphere about it but for the cone that its tripod hides.

    Attributes:
        beam: how it measures.
        rays: about so many from each station.
        horizontal: field of view in azimuth, degrees; above 180.
        lowest: elevation of its lowest rays, degrees.
        highest: elevation of its highest rays.
    """

    rays: int = 60_000
    horizontal: float = 360.0
    lowest: float = -60.0
    highest: float = 90.0

    def _directions(self, random: np.random.Generator) -> np.ndarray:
        step = np.sqrt(self.horizontal * (self.highest - self.lowest) / self.rays)
        azimuths = np.arange(-self.horizontal / 2, self.horizontal / 2, step) + step * random.random()
        elevations = np.arange(self.lowest, self.highest, step) + step * random.random()
        return turning_directions(np.radians(azimuths), np.radians(np.minimum(elevations, self.highest)))

    @property
    def _field_of_view(self) -> tuple[float, float]:
        # Symmetric about the horizon, so that all rays lie in it.
        return self.horizontal, min(2 * max(-self.lowest, self.highest), WIDEST_VERTICAL)

    @property
    def _min_elevation(self) -> float:
        return self.lowest


@dataclasses.dataclass(frozen=True)
class SpinningLidar(LaserScanner):
    """A lidar of several beams that spins while it is carried along level: a revolution from each pose.

    Attributes:
        beam: how it measures.
        rings: beams, one above the other.
        vertical: full angle between the lowest and the highest beam, degrees; half of it below the horizon.
        columns: measurements of each beam in a revolution.
    """

    beam: Beam = Beam(noise=0.015, growth=0.0, max_range=40.0)
    rings: int = 16
    vertical: float = 30.0
    columns: int = 360

    def _directions(self, random: np.random.Generator) -> np.ndarray:
        azimuths = 2 * np.pi * (np.arange(self.columns) + random.random()) / self.columns - np.pi
        half = np.radians(self.vertical) / 2
        return turning_directions(azimuths, np.linspace(-half, half, self.rings))

    @property
    def _field_of_view(self) -> tuple[float, float]:
        return 360.0, self.vertical


@dataclasses.dataclass(frozen=True)
class AirborneScanner(LaserScanner):
    """A scanner that looks down from far above, the tops of its images ahead: the swath beneath each pose.

    Attributes:
        beam: how it measures.
        across: full angle of the swath, degrees.
        along: full angle in the direction of flight that is measured from one pose.
        rays: about so many from each pose.
    """

    beam: Beam = Beam(noise=0.02, growth=0.0, max_range=2000.0, edge=0.5)
    across: float = 40.0
    along: float = 5.0
    rays: int = 3000

    def _directions(self, random: np.random.Generator) -> np.ndarray:
        across, along = (np.tan(np.radians(angle) / 2) for angle in self._field_of_view)
        rows = max(1, round(np.sqrt(self.rays * along / across)))
        columns = max(1, self.rays // rows)
        jitter = random.random((2, rows, columns))
        x = across * ((np.arange(columns) + jitter[0]) / columns * 2 - 1)
        y = along * ((np.arange(rows)[:, None] + jitter[1]) / rows * 2 - 1)
        rays = np.stack([x, y, np.ones((rows, columns))], axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    @property
    def _field_of_view(self) -> tuple[float, float]:
        return self.across, self.along


def turning_directions(
    azimuths: Float[np.ndarray, " columns"], elevations: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, "rows columns 3"]:
    """Unit directions in a sensor's coordinates: x right, y down, z forward.

    Args:
        azimuths: from the z axis to the right, radians.
        elevations: above the level of the sensor, radians.
    """
    level = np.cos(elevations)[:, None]
    down = np.broadcast_to(-np.sin(elevations)[:, None], (len(elevations), len(azimuths)))
    return np.stack([np.sin(azimuths) * level, down, np.cos(azimuths) * level], axis=-1)
