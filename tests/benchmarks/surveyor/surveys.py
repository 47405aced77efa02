"""Two surveys of a world that changed in between, with the truth of what can be judged."""

import dataclasses
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews
from gmmjax.geometry import rotation_about, transformed
from gmmjax.pair import Pair, each
from gmmjax.scenes import upright
from tests.benchmarks.surveyor.scanning import TERRAIN, Beam, Scan, World, changes_of, scanned, sees
from tests.benchmarks.surveyor.solids import UNCHANGED, UNJUDGED
from tests.benchmarks.surveyor.terrain import Columns


class Scanner(Protocol):
    """Something that scans from one place, or along one line."""

    @property
    def position(self) -> np.ndarray:
        """Where it is, in the middle."""

    @property
    def azimuths(self) -> tuple[float, float]:
        """From where to where it looks, radians."""

    def columns(self, rays: float, random: np.random.Generator) -> Columns:
        """About so many rays."""

    def seen(self, world: World, places: np.ndarray, slack: float, random: np.random.Generator) -> np.ndarray:
        """Which places lie on what it sees, or before it."""


@dataclasses.dataclass(frozen=True)
class Station:
    """A scanner on a tripod.

    Attributes:
        position: of its mirror.
        azimuths: from where to where it turns, radians.
        elevations: of its lowest and of its highest ray, radians.
    """

    position: np.ndarray
    azimuths: tuple[float, float] = (-np.pi, np.pi)
    elevations: tuple[float, float] = (np.radians(-60), np.radians(90))

    def columns(self, rays: float, random: np.random.Generator) -> Columns:
        """About so many rays, in equal steps of either angle."""
        (left, right), (low, high) = self.azimuths, self.elevations
        step = np.sqrt((right - left) * (high - low) / rays)
        azimuths = np.arange(left, right - 0.5 * step, step) + step * random.random()
        elevations = np.arange(low, high - 0.5 * step, step) + 0.5 * step * random.random()
        return Columns(np.broadcast_to(self.position, (len(azimuths), 3)), azimuths, elevations)

    def covers(self, places: np.ndarray) -> np.ndarray:
        """Which places lie in the directions that it looks in."""
        offset = places - self.position
        azimuth = np.arctan2(offset[:, 1], offset[:, 0])
        elevation = np.arctan2(offset[:, 2], np.hypot(offset[:, 0], offset[:, 1]))
        (left, right), (low, high) = self.azimuths, self.elevations
        turned = (azimuth - left) % (2 * np.pi)
        return np.asarray((turned <= right - left) & (elevation >= low) & (elevation <= high))

    def seen(self, world: World, places: np.ndarray, slack: float, random: np.random.Generator) -> np.ndarray:
        """Which places lie on what it sees, or before it."""
        visible = self.covers(places)
        rows = np.flatnonzero(visible)
        visible[rows] = sees(world, self.position, places[rows], slack, random)
        return visible


@dataclasses.dataclass(frozen=True, eq=False)
class Lowered:
    """What became of the terrain: rock that fell, debris that lies on it.

    Attributes:
        numbers: of the change at each node of the terrain's grid; `UNCHANGED` where there is none.
        depth: by the change's number, its depth along the normal, metres.
    """

    numbers: np.ndarray
    depth: dict[int, float]


@dataclasses.dataclass(frozen=True, eq=False)
class Site:
    """Two worlds and how they are surveyed.

    Attributes:
        worlds: before and after.
        stations: of the two surveys.
        beam: of the scanner.
        lowered: what became of the terrain; None: nothing.
        slack: depth below a surface from which on a place is hidden, metres.
        least_distance: what a changed point is off the other world's surfaces, at least, to be judged, metres.
        views: whether the scanners' poses are told.
    """

    worlds: Pair[World]
    stations: Pair[Sequence[Scanner]]
    beam: Beam
    lowered: Lowered | None = None
    slack: float = 0.02
    least_distance: float = 0.015
    views: bool = True


@dataclasses.dataclass(frozen=True, eq=False)
class SurveyedPair:
    """Two surveys with the truth.

    Attributes:
        name: of the scene.
        points: of either survey [n, 3].
        truth: per point -1 unchanged, -2 nobody can judge it, else the number of its change; what moved has the same
            number in both. Unjudged are: places that the other survey could not see, points between a changed surface
            and another one, thin rims where a change is hardly deeper than the noise, and changes of few points.
        unseen: per point whether the other survey could not see its place.
        source: per point the number of the change that it belongs to, judged or not; -1 for none.
        views: where the scanners stood; None: it is not told.
    """

    name: str
    points: Pair[np.ndarray]
    truth: Pair[np.ndarray]
    unseen: Pair[np.ndarray]
    source: Pair[np.ndarray]
    views: Pair[SensorViews | None]

    @property
    def unchanged(self) -> bool:
        return all((source < 0).all() for source in self.source)


@dataclasses.dataclass(frozen=True)
class Errors:
    """How far off clouds are put together.

    Attributes:
        station: standard deviation of each station's position, metres.
        station_degrees: of its orientation.
        survey: shift of the whole after survey, metres.
        survey_degrees: its turn about the middle of the scene.
    """

    station: float = 0.001
    station_degrees: float = 0.002
    survey: float = 0.003
    survey_degrees: float = 0.005


# A change is judged where it has this many points that can be.
LEAST_POINTS = 40


def surveyed(
    name: str,
    site: Site,
    points: int,
    errors: Errors,
    offset: Sequence[float],
    random: np.random.Generator,
) -> SurveyedPair:
    """Surveys the site at both times.

    Args:
        name: of the pair.
        site: what is surveyed.
        points: about so many a side.
        errors: of putting the clouds together.
        offset: that is added to all coordinates [3].
        random: of noise and errors.
    """
    sides = each(
        lambda world, stations: _survey(world, stations, site.beam, points, random), site.worlds, site.stations
    )
    scans = sides.map(lambda side: Scan(*(np.concatenate(own) for own in zip(*side, strict=True))))
    labels = each(lambda scan, world, other: _labels(scan, world, other, site), scans, site.worlds, site.worlds.swapped)
    unseen = each(
        lambda scan, label, world, stations, other: ~_observed(scan, label[1], world, stations, other, site, random),
        scans,
        labels,
        site.worlds,
        site.stations.swapped,
        site.worlds.swapped,
    )
    truth = each(lambda label, hidden: _judged(np.where(hidden, UNJUDGED, label[0])), labels, unseen)
    middle = scans.before.points.mean(axis=0)
    motion = Pair(np.eye(4), motion_about(errors.survey, errors.survey_degrees, middle, random))
    moved = each(
        lambda side, stations, own: _placed(side, stations, own, errors, site, offset, random),
        sides,
        site.stations,
        motion,
    )
    return SurveyedPair(
        name,
        moved.map(lambda own: own[0]),
        truth,
        unseen,
        labels.map(lambda label: label[1]),
        moved.map(lambda own: own[1]),
    )


def _survey(
    world: World, stations: Sequence[Scanner], beam: Beam, points: int, random: np.random.Generator
) -> list[Scan]:
    return [
        scanned(world, full_columns(world, station, beam, points / len(stations), random), beam, random)
        for station in stations
    ]


def full_columns(world: World, station: Scanner, beam: Beam, points: float, random: np.random.Generator) -> Columns:
    """The rays of a station of which about so many return."""
    trial = station.columns(20_000, random)
    share = len(scanned(world, trial, beam, random).points) / (len(trial.azimuths) * len(trial.elevations))
    return station.columns(points / share, random)


def _observed(
    scan: Scan,
    source: np.ndarray,
    world: World,
    stations: Sequence[Scanner],
    other: World,
    site: Site,
    random: np.random.Generator,
) -> np.ndarray:
    """Which points' places another survey saw.

    Leaves do not hide each other. What terrain that came or went hides of itself is seen: both are one surface, which
    was displaced.
    """
    leaves = np.array([bool(thing.free_path) for thing in world.things] + [False])
    in_leaves = leaves[np.where(scan.thing >= 0, scan.thing, len(world.things))]
    displaced = (scan.thing == TERRAIN) & (source >= 0)
    bare = World([thing for thing in other.things if not thing.free_path], other.terrain)
    deep = site.slack + 2 * max(site.lowered.depth.values(), default=0.0) if site.lowered else site.slack
    visible = np.zeros(len(source), bool)
    for rows, against, slack in (
        (np.flatnonzero(in_leaves), bare, site.slack),
        (np.flatnonzero(displaced), other, deep),
        (np.flatnonzero(~in_leaves & ~displaced), other, site.slack),
    ):
        if len(rows):
            visible[rows] = _seen(scan.places[rows], stations, against, slack, random)
    return visible


def _seen(
    places: np.ndarray, stations: Sequence[Scanner], world: World, slack: float, random: np.random.Generator
) -> np.ndarray:
    visible = np.zeros(len(places), bool)
    for station in stations:
        rows = np.flatnonzero(~visible)
        if not len(rows):
            break
        visible[rows] = station.seen(world, places[rows], slack, random)
    return visible


def _labels(scan: Scan, world: World, other: World, site: Site) -> tuple[np.ndarray, np.ndarray]:
    """The truth of a survey but for what the other one could not see, and the change that each point belongs to."""
    source, behind = changes_of(world, scan.thing), changes_of(world, scan.mixed)
    if site.lowered is not None and world.terrain is not None:
        rows = np.flatnonzero(scan.thing == TERRAIN)
        source[rows] = _lowered_at(site.lowered, world, scan.places[rows])
    changed = np.flatnonzero((source >= 0) | (behind >= 0))
    truth = source.copy()
    apart = other.distances(scan.places[changed], 1.0)
    least = np.full(len(changed), site.least_distance)
    if site.lowered is not None:
        # Of a deep change the rim is deeper than that of a shallow one before it can be told from the shape around it.
        depth = np.array([site.lowered.depth.get(number, 0.0) for number in source[changed]])
        least = np.maximum(least, 0.3 * depth)
        source[changed[(apart < 0.25 * site.least_distance) & (depth > 0)]] = UNCHANGED
        truth[changed] = source[changed]
    unclear = (apart < least) & (truth[changed] >= 0) | (scan.mixed[changed] != scan.thing[changed])
    truth[changed[unclear]] = UNJUDGED
    return truth, source


def _lowered_at(lowered: Lowered, world: World, places: np.ndarray) -> np.ndarray:
    assert world.terrain is not None
    nodes = world.terrain.nodes(places)
    return np.asarray(lowered.numbers[nodes[:, 0], nodes[:, 1]])


def _judged(truth: np.ndarray) -> np.ndarray:
    numbers, counts = np.unique(truth[truth >= 0], return_counts=True)
    few = numbers[counts < LEAST_POINTS]
    return np.where(np.isin(truth, few), UNJUDGED, truth)


def _placed(
    scans: Sequence[Scan],
    stations: Sequence[Scanner],
    motion: np.ndarray,
    errors: Errors,
    site: Site,
    offset: Sequence[float],
    random: np.random.Generator,
) -> tuple[np.ndarray, SensorViews | None]:
    """The points of all stations, each off by a little, and where the stations are believed to stand."""
    points, poses = [], []
    for scan, station in zip(scans, stations, strict=True):
        own = motion @ motion_about(errors.station, errors.station_degrees, station.position, random)
        points.append(transformed(scan.points, own) + np.asarray(offset))
        pose = own @ upright(station.position, float(np.mean(station.azimuths)))
        pose[:3, 3] += np.asarray(offset)
        poses.append(pose)
    if not site.views:
        return np.concatenate(points), None
    return np.concatenate(points), SensorViews(np.stack(poses), (360.0, 179.0), site.beam.max_range)


def motion_about(metres: float, degrees: float, centre: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Shifted and turned about a place by normal errors of these lengths."""
    direction, axis = random.standard_normal((2, 3))
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.sqrt(3)).as_matrix()
    return rotation_about(turn, centre, centre + metres * direction / np.sqrt(3))
