"""Surveys by laser scanners: on tripods, and from aircraft whose flight lines overlap."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families.things import chance, log_uniform
from gmmjax.scenes.laser_scanner import AirborneScanner, Beam, LaserScanner, TripodScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import PoseErrors, Recording, drawn_density
from gmmjax.scenes.rigid_motions import looking_down, turned, upright
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


@dataclasses.dataclass(frozen=True)
class TripodSurveys:
    """Random parameters of two surveys from tripods.

    Attributes:
        rays: between how many a survey has, from all of its stations together. The more there are, the more of them end
            in the air at depth edges; fused in voxels, each such point weighs as much as a surface's.
        most: between how many points the denser cloud has, where it has so many.
        least: points that the other one keeps.
        hidden_by: a place is hidden when something on its ray is nearer by more than this, metres.
        highest: between which elevations the highest rays are, degrees.
        fused: share of the clouds that are fused in voxels; the others keep points drawn at random.
        misregistration: largest translation, metres, and rotation, degrees.
    """

    rays: tuple[int, int]
    most: tuple[int, int]
    least: int
    hidden_by: float
    highest: tuple[float, float] = (60.0, 90.0)
    fused: float = 0.7
    misregistration: tuple[float, float] = (0.1, 0.4)

    def scanners(self, random: np.random.Generator) -> Pair[TripodScanner]:
        """One make in both surveys, or two."""
        full = chance(random, 0.75)
        first = self._scanner(random, full)
        return Pair(first, self._scanner(random, full) if chance(random, 0.4) else first)

    def _scanner(self, random: np.random.Generator, full: bool) -> TripodScanner:
        beam = Beam(
            noise=log_uniform(random, 0.0005, 0.012),
            growth=random.uniform(0.0, 0.0004),
            min_range=random.uniform(0.3, 0.8),
            max_range=random.uniform(20, 80),
            mixed=random.uniform(0.0, 0.5),
            lost=random.uniform(0.0, 0.05),
        )
        horizontal = 360.0 if full else random.uniform(200, 300)
        count = int(log_uniform(random, *map(float, self.rays)))
        return TripodScanner(beam, count, horizontal, random.uniform(-65, -40), random.uniform(*self.highest))

    def scene(
        self,
        random: np.random.Generator,
        solids: Pair[list[Solid]],
        poses: Pair[Float[np.ndarray, "v 4 4"]],
        scanners: Pair[TripodScanner],
    ) -> SurveyedScene:
        """The scene of two surveys, whose stations share the rays, each registered to the others with a small error."""
        recordings = each(
            lambda own, there, scanner: dataclasses.replace(scanner, rays=scanner.rays // len(there)).recording(
                own, there, random, PoseErrors(random.uniform(0.0, 0.006), random.uniform(0.0, 0.04))
            ),
            solids,
            poses,
            scanners,
        )
        recordings = drawn_density(random, recordings, most=self.most, least=self.least, fused=self.fused)
        shift, degrees = self.misregistration
        frame = Frame.drawn(random, shift=shift, degrees=degrees)
        return surveyed_scene(solids, recordings, frame, hidden_by=self.hidden_by)

    def scene_from(
        self, random: np.random.Generator, solids: Pair[list[Solid]], places: Pair[list[Float[np.ndarray, "2"]]]
    ) -> SurveyedScene:
        """The scene of two surveys from these places of a floor: all look the same way within half a right angle."""
        height, heading = random.uniform(1.2, 2.0), random.uniform(0, 2 * np.pi)
        poses = places.map(
            lambda side: np.stack(
                [
                    upright(np.array([*place, height + random.normal(0, 0.05)]), heading + random.uniform(-0.8, 0.8))
                    for place in side
                ]
            )
        )
        return self.scene(random, solids, poses, self.scanners(random))


def scanned(
    random: np.random.Generator,
    scanner: LaserScanner,
    solids: Pair[list[Solid]],
    poses: Pair[Float[np.ndarray, "v 4 4"]],
    most: int = 10**9,
) -> Pair[Recording]:
    """The surveys of one scanner, with at most this number of points."""
    return each(lambda own, there: scanner.recording(own, there, random).thinned(most, random), solids, poses)


def level_poses(
    random: np.random.Generator,
    places: Float[np.ndarray, "v 2"],
    height: float | Sequence[float],
    aim: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "v 4 4"]:
    """Poses of a scanner that stands level at these places and heights, metres, within 0.4 radians towards the aim."""
    positions = np.column_stack([places, np.broadcast_to(height, len(places))])
    towards = aim[:2] - places
    azimuths = np.arctan2(towards[:, 1], towards[:, 0]) + random.uniform(-0.4, 0.4, len(places))
    return np.stack([upright(place, azimuth) for place, azimuth in zip(positions, azimuths, strict=True)])


@dataclasses.dataclass(frozen=True)
class Flight:
    """Flight lines over an area about the origin.

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
        rotation = turned(self.heading)[:3, :3]
        places = [rotation @ [x, y, self.altitude] for x in along for y in across]
        return np.stack([looking_down(place, self.heading) for place in places])

    def scanner(self, beam: Beam, rays: float) -> AirborneScanner:
        """One that covers the area with about so many rays."""
        across, along = (
            2 * np.degrees(np.arctan(self.edge * (1 + more) / count / 2 / self.altitude))
            for count, more in ((self.lines, self.overlap), (self.scans, 0.1))
        )
        return AirborneScanner(beam, float(across), float(along), int(rays / self.lines / self.scans))


def flown_over(
    random: np.random.Generator, solids: Pair[list[Solid]], edge: float, beam: Beam, rays: float
) -> Pair[Recording]:
    """An area of this extent, metres, flown over twice, not by the same lines; the denser survey has these rays."""
    altitude = random.uniform(2.5, 7.0) * edge
    high = dataclasses.replace(beam, max_range=2 * altitude)
    first = _flight(random, edge, altitude)
    second = _flight(random, edge, altitude * random.uniform(0.8, 1.25)) if chance(random, 0.7) else first
    errors = PoseErrors(jitter=random.uniform(0, 0.02))
    sparser = 1.0 if chance(random, 0.5) else random.uniform(0.4, 1.0)
    shares = Pair(1.0, sparser) if chance(random, 0.5) else Pair(sparser, 1.0)
    return each(
        lambda own, flight, share: flight.scanner(high, share * rays).recording(own, flight.poses(), random, errors),
        solids,
        Pair(first, second),
        shares,
    )


def _flight(random: np.random.Generator, edge: float, altitude: float) -> Flight:
    heading = float(random.choice([0.0, np.pi / 2, random.uniform(0, np.pi)], p=[0.4, 0.3, 0.3]))
    return Flight(edge, altitude, int(random.integers(1, 4)), random.uniform(0.1, 0.5), heading)
