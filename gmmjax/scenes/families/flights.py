"""Surveys of an area from an aircraft, in flight lines that overlap."""

import dataclasses

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families.arrangements import Arrangement, chance
from gmmjax.scenes.families.staging import turned
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam
from gmmjax.scenes.pose_errors import PoseErrors
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_down


@dataclasses.dataclass(frozen=True)
class Flight:
    """How an area about the origin is flown over.

    Attributes:
        edge: length of the area's edges, metres.
        altitude: above it, metres.
        lines: flight lines, side by side.
        overlap: share of a swath that it has in common with the next.
        heading: direction of the lines from the x axis, radians.
        scans: poses of each line.
    """

    edge: float
    altitude: float
    lines: int
    overlap: float
    heading: float
    scans: int = 6

    def poses(self) -> Float[np.ndarray, "v 4 4"]:
        """Above the middle of each scan, looking down, the tops of the images ahead."""
        across, along = (self.edge * ((np.arange(count) + 0.5) / count - 0.5) for count in (self.lines, self.scans))
        turn = turned(self.heading, (0.0, 0.0, 0.0))
        places = [turn[:3, :3] @ [x, y, self.altitude] for x in along for y in across]
        return np.stack([looking_down(place, self.heading) for place in places])

    def scanner(self, beam: Beam, rays: float) -> AirborneScanner:
        """One that covers the area with about so many rays."""
        across, along = (
            2 * np.degrees(np.arctan(self.edge * (1 + more) / count / 2 / self.altitude))
            for count, more in ((self.lines, self.overlap), (self.scans, 0.1))
        )
        return AirborneScanner(beam, float(across), float(along), int(rays / self.lines / self.scans))


def flown_over(
    random: np.random.Generator, arrangement: Arrangement, edge: float, beam: Beam, rays: float
) -> Pair[Recording]:
    """An area flown over twice, not by the same lines.

    Args:
        random: of the flights and of their numbers of points.
        arrangement: what stands in the area.
        edge: length of its edges, metres.
        beam: of the scanner.
        rays: about so many of the denser survey.
    """
    altitude = random.uniform(2.5, 7.0) * edge
    high = dataclasses.replace(beam, max_range=2 * altitude)
    first = _flight(random, edge, altitude)
    second = _flight(random, edge, altitude * random.uniform(0.8, 1.25)) if chance(random, 0.7) else first
    errors = PoseErrors(jitter=random.uniform(0, 0.02))
    sparser = 1.0 if chance(random, 0.5) else random.uniform(0.4, 1.0)
    return each(
        lambda solids, flight, share: flight.scanner(high, share * rays).recording(
            solids, flight.poses(), random, errors
        ),
        arrangement.solids,
        Pair(first, second),
        Pair(1.0, sparser) if chance(random, 0.5) else Pair(sparser, 1.0),
    )


def _flight(random: np.random.Generator, edge: float, altitude: float) -> Flight:
    heading = float(random.choice([0.0, np.pi / 2, random.uniform(0, np.pi)], p=[0.4, 0.3, 0.3]))
    return Flight(edge, altitude, int(random.integers(1, 4)), random.uniform(0.1, 0.5), heading)
