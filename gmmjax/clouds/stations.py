"""Stations of a scanner on a tripod, recognised by the density of the ground around them.

A scanner that turns in equal steps s of both of its angles, at the height h above level ground, has h / (s² r² d)
points on a unit of its area at the distance d from its foot, r² = d² + h² away: the element of its elevation
atan(h / d) is h dd / r², that of its azimuth 1 / d, and their product over s² is the number of rays. So there is a
dense ring around a hole, which is what the scanner cannot see below itself. Little else in a scan looks like this;
clouds whose density was made even, and those of sensors that were carried, do not.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy.fft
from jaxtyping import Bool, Float64, Int
from scipy.ndimage import uniform_filter
from scipy.optimize import least_squares

from gmmjax.clouds.ground_map import GroundMap, GroundSettings
from gmmjax.geometry import evenly_chosen


@dataclasses.dataclass(frozen=True)
class StationSettings:
    """Settings of the search for stations in maps of the ground.

    All values are empirical: chosen on simulated halls and warehouses by another generator, and
    on the families that the verdict is learned from.

    Attributes:
        points_per_cell: mean number of points in a cell of the map; each of these is tried, and the one taken that
            shows the most stations. Fewer: smaller cells, for dense scans, in which a tripod is many cells high.
        max_points: that are looked at, evenly chosen. Fewer: faster, and smaller stations are missed.
        ground: what the ground is in these maps.
        rims: radii in cells of the holes that are looked for.
        arcs: that rings are divided into. 1: those around the shadows of things are proposed, too.
        contrast: between a ring and the hole within, at least, in roots of counts, whose standard deviation is a half.
            0: all cells are looked at.
        share: of the greatest contrast that those have at least that are looked at with it; others come later. 0: the
            shadows of things are taken for stations at first, which spoils the fit of those beside them.
        reach: radius in cells of what a station is fitted to.
        near: the same in radii of the hole. Large: what other stations and things do further away biases the height.
        sweeps: how often each of several stations is fitted to what the others leave. 0: the height of the first ones
            is too large, by half of it at worst, as the points of others beside it count with it.
        freedom: largest factor that the number of rays changes by in a fit. 1: it is what was guessed.
        fewest: expected points in a cell that it is fitted to, at least. 0: the stripes of distant ground count.
        height: of a station in cells, at least, for its place to be measured. Small: its height is off by up to half.
        sectors: that the surroundings of a station are divided into,
        rings: and each of them by distance. 1: what is as dense everywhere may look like a station.
        seen: share of these parts that must have as many points as is expected; others are hidden by things. 0: no
            other test than that of single cells and of the hole.
        agreement: largest factor between the numbers of points in a part, expected and found.
        deviation: median of the absolute logarithms of that factor in single cells, at most.
        filled: number of points in a cell of the hole by that beside it, at most. 1: what is dense to its middle, such
            as the way of a scanner that was carried, may look like a row of stations.
        largest: radius of the hole by the length of the map, at most. 0.5: the middle of a sparse survey from the air
            may look like one.
        hole: radius of the hole below a scanner by its height, at least and at most: the tangent of its lowest ray's
            angle to the vertical. 0 and infinite: anything dense is a station.
    """

    points_per_cell: tuple[float, ...] = (64.0, 16.0, 4.0)
    max_points: int = 2_000_000
    ground: GroundSettings = GroundSettings()
    rims: tuple[float, ...] = (2.0, 3.0, 4.0, 6.0, 8.0, 11.0, 15.0, 20.0)
    arcs: int = 6
    contrast: float = 1.5
    share: float = 0.5
    reach: float = 30.0
    near: float = 3.0
    sweeps: int = 3
    freedom: float = 10.0
    fewest: float = 5.0
    height: float = 10.0
    sectors: int = 16
    rings: int = 3
    seen: float = 0.65
    agreement: float = 1.4
    deviation: float = 0.3
    filled: float = 0.15
    largest: float = 0.25
    hole: tuple[float, float] = (0.3, 1.5)


def recognised_stations(
    points: Float64[np.ndarray, "n 3"],
    counts: Int[np.ndarray, " n"] | None = None,
    settings: StationSettings = StationSettings(),
) -> Float64[np.ndarray, "s 3"]:
    """Positions of the scanner's mirror at the stations that can be recognised; the equation is the module's.

    Args:
        points: finite coordinates of a scan, or the means of its voxels; z points up. In any unit.
        counts: how many points each of them stands for; None: one.
        settings: what is a station.

    Returns:
        Positions in the unit and frame of the points, in no particular order; none where the ground shows no station.
    """
    if len(points) < 2:
        return np.empty((0, 3))
    rows = evenly_chosen(len(points), settings.max_points)
    # Each map orders the points of its cells by height: in that order it is quick.
    rows = rows[np.argsort(points[rows, 2], kind="stable")]
    points, weights = points[rows], np.ones(len(rows)) if counts is None else counts[rows].astype(float)
    best: tuple[GroundMap, list[_Station]] | None = None
    for points_per_cell in settings.points_per_cell:
        ground = GroundMap.of(points, weights, points_per_cell, settings.ground)
        stations = [] if ground is None else _stations(ground, settings)
        if best is not None and len(stations) <= len(best[1]):
            break
        if ground is not None and stations:
            best = ground, stations
    if best is None:
        return np.empty((0, 3))
    return _positions(points, weights, *best, settings)


def _positions(
    points: Float64[np.ndarray, "n 3"],
    weights: Float64[np.ndarray, " n"],
    ground: GroundMap,
    stations: "list[_Station]",
    settings: StationSettings,
) -> Float64[np.ndarray, "s 3"]:
    """Positions of the stations on a map on which enough cells have their height."""
    refinement = settings.height / float(np.median([own.height for own in stations]))
    points_per_cell = ground.points_per_cell / refinement**2
    finer = GroundMap.of(points, weights, points_per_cell, settings.ground) if refinement > 1 else None
    if finer is not None:
        stations = [own.scaled(ground.cell / finer.cell) for own in stations]
        ground, stations = finer, _fitted_together(finer, stations, settings)
    return np.stack([_position(ground, own) for own in stations])


def _position(ground: GroundMap, station: "_Station") -> Float64[np.ndarray, "3"]:
    """Position of the mirror, above the ground around it."""
    distance = ground.distances(station.centre)
    beside = (distance > station.rim) & (distance < max(2 * station.height, 2 * station.rim)) & (ground.counts > 0)
    level = np.median(ground.heights[beside if beside.any() else ground.counts > 0])
    return np.append(ground.corner + (station.centre + 0.5) * ground.cell, level + station.height * ground.cell)


class _Station(NamedTuple):
    """A station on the map; lengths in cells.

    Attributes:
        centre: its foot, by the rows and columns of the map.
        height: of the mirror above the ground.
        rays: in a square radian.
        rim: radius of the hole below it.
    """

    centre: Float64[np.ndarray, "2"]
    height: float
    rays: float
    rim: float

    def expected(self, distance: np.ndarray) -> np.ndarray:
        """Number of points in cells of the ground at some distance from its foot; see the module."""
        away = np.maximum(distance, self.nearest)
        return np.asarray(self.rays * self.height / ((away**2 + self.height**2) * away))

    @property
    def nearest(self) -> float:
        """Distance from its foot within which there is nothing to be expected but a hole."""
        return max(0.8 * self.rim, 0.5)

    def has_hole(self, settings: StationSettings) -> bool:
        """True if the hole below it is that of a scanner."""
        return settings.hole[0] < self.rim / self.height < settings.hole[1]

    def scaled(self, cells: float) -> "_Station":
        """The station on a map of the same place with so many cells along the edge of a cell."""
        return _Station((self.centre + 0.5) * cells - 0.5, self.height * cells, self.rays, self.rim * cells)


def _stations(ground: GroundMap, settings: StationSettings) -> list[_Station]:
    """The stations on a map: those of the proposed ones that the ground agrees with, once the others are explained.

    Those that are found make others stand out, so that these are proposed again.
    """
    stations: list[_Station] = []
    while True:
        number = len(stations)
        stations = _agreeing(ground, [*stations, *_proposed(ground, stations, settings)], settings)
        if len(stations) <= number:
            return stations


def _agreeing(ground: GroundMap, stations: list[_Station], settings: StationSettings) -> list[_Station]:
    """The stations without those, a few at a time, that the ground agrees with the least."""
    while stations:
        stations = _fitted_together(ground, stations, settings)
        total = _expected(ground, stations)
        agreement = [
            0.0
            if any(np.linalg.norm(own.centre - other.centre) < other.rim for other in stations[:index])
            else _agreement(ground, total - _expected(ground, [own]), own, settings)
            for index, own in enumerate(stations)
        ]
        worst = min(agreement)
        if worst >= settings.seen:
            break
        # What is none at all goes at once, of others the worst: without it the next may be one.
        stations = [own for own, share in zip(stations, agreement, strict=True) if share > worst]
    return stations


def _expected(ground: GroundMap, stations: list[_Station]) -> Float64[np.ndarray, "i j"]:
    """The number of points in each cell that these stations give it together."""
    total = np.zeros_like(ground.counts)
    for own in stations:
        total += own.expected(ground.distances(own.centre))
    return total


def _proposed(ground: GroundMap, known: list[_Station], settings: StationSettings) -> Iterator[_Station]:
    """Candidates for other stations: the densest rings around holes that the known stations do not explain.

    Roots of counts, whose variances are alike, are compared: of the ring in the mean with those of the hole.
    """
    excess = np.maximum(ground.counts - _expected(ground, known), 0)
    rims = [own for own in settings.rims if own < settings.largest * max(excess.shape)]
    if not rims or not excess.any():
        return
    contrast = np.stack([_ring_contrast(np.sqrt(excess), rim, settings.arcs) for rim in rims])
    for own in known:
        contrast[:, ground.distances(own.centre) < 2 * own.rim] = 0
    least = max(settings.contrast, settings.share * float(contrast.max()))
    while contrast.max() >= least:
        scale, *place = np.unravel_index(np.argmax(contrast), contrast.shape)
        centre, rim = np.array(place, float), rims[int(scale)]
        distance = ground.distances(centre)
        contrast[:, distance < 2 * rim] = 0
        yield _guessed(excess, distance, centre, rim, settings)


def _ring_contrast(roots: Float64[np.ndarray, "i j"], rim: float, arcs: int) -> Float64[np.ndarray, "i j"]:
    """Excess of the mean of the second darkest arc of a ring around each cell over the hole within.

    Of the ring around the shadow of a thing the arcs behind it are dark; one may be so of a station's.
    """
    size = int(rim) + 3
    row, column = np.mgrid[-size : size + 1, -size : size + 1]
    away, arc = np.hypot(row, column), ((np.arctan2(column, row) / (2 * np.pi) + 0.5) * arcs).astype(int) % arcs
    ring, hole = (away >= rim) & (away < rim + 2), away < rim - 0.5
    *brightness, within = _means_within(roots, [*(ring & (arc == n) for n in range(arcs)), hole])
    return np.asarray(np.partition(brightness, 1, axis=0)[1] - within)


def _means_within(
    values: Float64[np.ndarray, "i j"], masks: Sequence[Bool[np.ndarray, "m m"]]
) -> list[Float64[np.ndarray, "i j"]]:
    """Means of the values under each mask, centred on each cell; beyond the edge of the map they are 0.

    Args:
        values: of the cells.
        masks: of one odd size m; each has a cell at least.
    """
    edge = len(masks[0])
    # As `scipy.signal.fftconvolve`, whose import takes half a second, with one transform of the values for all masks.
    shape = [scipy.fft.next_fast_len(side + edge - 1, real=True) for side in values.shape]
    spectrum = scipy.fft.rfft2(values, shape)
    sums = [scipy.fft.irfft2(spectrum * scipy.fft.rfft2(mask / mask.sum(), shape), shape) for mask in masks]
    rows, columns = (slice(edge // 2, edge // 2 + side) for side in values.shape)
    return [np.asarray(own[rows, columns]) for own in sums]


def _guessed(
    excess: Float64[np.ndarray, "i j"],
    distance: Float64[np.ndarray, "i j"],
    centre: Float64[np.ndarray, "2"],
    rim: float,
    settings: StationSettings,
) -> _Station:
    """The station in a hole: of a height between the least and the largest for it."""
    height = rim / np.sqrt(settings.hole[0] * settings.hole[1])
    beside = (distance >= rim) & (distance < rim + 3)
    rays = np.mean((excess * (distance**2 + height**2) * distance / height)[beside])
    return _Station(centre, float(height), float(rays), rim)


def _fitted_together(ground: GroundMap, stations: list[_Station], settings: StationSettings) -> list[_Station]:
    """The stations, each fitted again to what the others leave: the first ones were fitted to what is of later ones."""
    total = _expected(ground, stations)
    for _ in range(settings.sweeps):
        again: list[_Station] = []
        for own in stations:
            others = np.maximum(total - _expected(ground, [own]), 0)
            again.append(_fitted(ground, others, own, settings))
            total = others + _expected(ground, again[-1:])
        stations = again
    return stations


def _fitted(
    ground: GroundMap, explained: Float64[np.ndarray, "i j"], start: _Station, settings: StationSettings
) -> _Station:
    """The station that explains the density around one best, by least squares.

    Residuals are those of the roots of the counts, whose variances are alike; a soft norm bounds what is hidden. Ground
    that is seen from afar is in stripes and says nothing.
    """
    distance = ground.distances(start.centre)
    # It may have left the map.
    if distance.min() > 1:
        return start
    rim = _rim(np.maximum(ground.counts - explained, 0), distance, settings)
    used = (distance > rim + 1.5) & (distance < min(settings.reach, settings.near * rim)) & (ground.counts > 0)
    used &= start.expected(distance) + explained > settings.fewest
    if used.sum() < settings.reach:
        return start
    return _refined(ground.counts, explained, used, start._replace(rim=rim), settings)


def _rim(excess: Float64[np.ndarray, "i j"], distance: Float64[np.ndarray, "i j"], settings: StationSettings) -> float:
    """The distance at which the ground is densest."""
    within = distance < 0.7 * settings.reach
    ring = distance[within].astype(int)
    total, number = np.bincount(ring, excess[within]), np.bincount(ring)
    return float(np.argmax(total / np.maximum(number, 1)))


def _refined(
    counts: Float64[np.ndarray, "i j"],
    explained: Float64[np.ndarray, "i j"],
    used: Bool[np.ndarray, "i j"],
    start: _Station,
    settings: StationSettings,
) -> _Station:
    """The station whose expected counts in some cells are the nearest to those found."""
    rows, columns = np.nonzero(used)
    found, others = np.sqrt(counts[used]), explained[used]

    def station(values: Float64[np.ndarray, "4"]) -> _Station:
        height, rays = np.exp(values[2:])
        return _Station(values[:2], float(height), float(rays), start.rim)

    def residuals(values: Float64[np.ndarray, "4"]) -> Float64[np.ndarray, " m"]:
        distance = np.hypot(rows - values[0], columns - values[1])
        return 2 * (found - np.sqrt(station(values).expected(distance) + others))

    def derivatives(values: Float64[np.ndarray, "4"]) -> Float64[np.ndarray, "m 4"]:
        own, offsets = station(values), np.stack([rows - values[0], columns - values[1]])
        distance = np.maximum(np.hypot(*offsets), own.nearest)
        expected, squared = own.expected(distance), distance**2 + own.height**2
        of_place = expected * (1 / distance + 2 * distance / squared) * offsets / distance
        of_height = expected * (1 - 2 * own.height**2 / squared)
        return np.stack([*of_place, of_height, expected], axis=1) / -np.sqrt(expected + others)[:, None]

    # It stays within its hole, and its height may be twice as far off as a scanner's: what ends beyond those is none.
    rim = max(start.rim, settings.rims[0])
    lower = np.append(start.centre - rim, np.log([rim / settings.hole[1] / 2, start.rays / settings.freedom]))
    upper = np.append(start.centre + rim, np.log([rim / settings.hole[0] * 2, start.rays * settings.freedom]))
    values = np.clip(np.append(start.centre, np.log([start.height, start.rays])), lower + 1e-6, upper - 1e-6)
    fit = least_squares(residuals, values, derivatives, bounds=(lower, upper), loss="soft_l1")
    return station(fit.x)


def _agreement(
    ground: GroundMap, explained: Float64[np.ndarray, "i j"], station: _Station, settings: StationSettings
) -> float:
    """The share of the surroundings in which the ground has the density that a station gives it; 0 where it is none."""
    distance = ground.distances(station.centre)
    if not station.has_hole(settings) or station.rim > settings.largest * max(distance.shape):
        return 0.0
    excess, expected = np.maximum(ground.counts - explained, 0), station.expected(distance) + explained
    hole, beside = distance < 0.7 * station.rim, np.abs(distance - station.rim) < 1.5
    if not hole.any() or excess[hole].mean() > settings.filled * excess[beside].mean():
        return 0.0
    edges = np.geomspace(station.rim + 1.5, 2 * max(station.rim + 1.5, station.height), settings.rings + 1)
    around = (distance > edges[0]) & (distance < edges[-1])
    cells = around & (expected > settings.fewest) & (ground.counts > 0)
    if not cells.any() or _deviation(ground.counts, expected, cells) > settings.deviation:
        return 0.0
    row, column = ground.offsets(station.centre)
    sector = ((np.arctan2(column, row) / (2 * np.pi) + 0.5) * settings.sectors).astype(int) % settings.sectors
    part = (sector + settings.sectors * (np.searchsorted(edges, distance) - 1))[around]
    number = settings.sectors * settings.rings
    found, wanted = (np.bincount(part, own[around], minlength=number) for own in (ground.counts, expected))
    factor = np.where(wanted > 0, found, 0.0) / np.where(wanted > 0, wanted, 1.0)
    return float(((factor > 1 / settings.agreement) & (factor < settings.agreement)).mean())


def _deviation(
    counts: Float64[np.ndarray, "i j"], expected: Float64[np.ndarray, "i j"], cells: Bool[np.ndarray, "i j"]
) -> float:
    """The median absolute logarithm of counts by expected ones, of cells with their neighbours: voxels are in steps."""
    sums = [uniform_filter(np.where(cells, own, 0.0), 3, mode="constant")[cells] for own in (counts, expected)]
    return float(np.median(np.abs(np.log(sums[0] / sums[1]))))
