"""The stage that measures how far each point of one scan is from the surface of the other.

The distance along the normal between local means is that of M3C2 (Lague, Brodu and Leroux 2013, section 3), on nearest
neighbours in place of cylinders: averages see offsets smaller than the noise of single points. The distance to the
nearest point sees what is adjacent to a surface, beyond its edge, where the offset along the normal does not.
"""

import dataclasses
import functools
import logging
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from gmmjax.geometry import MEAN_NEIGHBOURS, MEDIAN_TO_DEVIATION, LocalSurface, evenly_chosen, nearest_neighbours
from gmmjax.pair import Pair, each, parallel_map

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class DifferenceSettings:
    """The distance and the offset from which a point is certainly changed; the greatest of all limits applies.

    All values are empirical: they come from development on the scenes of docs/results.md.

    Attributes:
        spacings: distance to the other cloud, in point spacings, both of the sparser cloud and of the other one there.
            0: sparse surfaces look changed, unless another limit is larger.
        distances: the same, in median distances of the less changed cloud. 0: that limit does not apply.
        thicknesses: the same, in standard deviations of the other surface's points about their plane there.
            0: thick surfaces, such as vegetation, look changed.
        offsets: offset from the other cloud's plane, in registration errors, and in standard deviations of the offset
            there. It must be positive.
        overlap: distance to the other cloud, in spacings there, up to which a point is of the overlap of both clouds,
            whose median distances and offsets count. Infinite: at half overlap half of the points have no counterpart,
            and every change is within the median distance.
        min_overlap: fraction of a cloud that is of the overlap, at least; of less, all points are taken. 0: of clouds
            that lie far apart, a few points that meet by chance are taken.
        region: number of the nearest points, of those that are no sure change, whose median offset is the registration
            error at a place: it grows with the range and differs from place to place. Few: a change of that size is
            taken for registration error; infinite: that of the pair is everywhere.
        regions: number of places, evenly chosen, that the registration error is computed at; elsewhere it is that of
            the nearest one. 1: that of one place is everywhere.
        regions_around: number of the nearest of these places, itself counted, whose median is the error at a place,
            where the spacing differs from place to place: a region of small voxels is no larger than a change. 1: a
            change that fills a region is taken for registration error; large: that of the pair is everywhere.
        min_error: registration error at a place, in that of the pair, at least. 1: small changes near the sensor
            are lost in the error far from it.
        max_error: the same, at most. 1: the edges of what is badly registered look changed; infinite: where a change
            fills a region, all of it is taken for registration error.
        finest_offset: least registration error, in point spacings, for surfaces without noise such as computed planes.
            0: the rounding of their coordinates (1e-9 m in a country's grid) looks like an offset.
        opposite_height: distance along the normal, in spacings of the other cloud there, up to which its surface lies
            opposite a point. 0: pipes on a floor are missed, and erosion of less than a spacing is taken for noise;
            larger: what stands before a surface, in clutter, is off it, and the floor below a thin object is taken for
            ground below a deposit.
        slenderness: width by length of the neighbourhood that a plane goes through, up to which it is a row of points,
            along a line of a scanner or a cable: the plane may be turned about it by any angle, and offsets from it say
            nothing. 0: where the lines of a scanner meet, straight above it, surfaces look displaced; 1: offsets say
            nothing anywhere.
        density_ratio: density of a cloud by that of the other one there, above which relief between the points of the
            other one counts as noise of its offset. 0: so it does in clouds of equal density; infinite: a bump that
            only the dense cloud shows is an offset.
    """

    spacings: float = 3.0
    distances: float = 3.0
    thicknesses: float = 4.0
    offsets: float = 7.0
    overlap: float = 10.0
    min_overlap: float = 0.2
    region: int = 400
    regions: int = 400
    regions_around: int = 16
    min_error: float = 0.3
    max_error: float = 2.0
    finest_offset: float = 1e-6
    opposite_height: float = 1.0
    slenderness: float = 0.2
    density_ratio: float = 2.0


class LocalDifference(NamedTuple):
    """Distance of each point of one cloud from the other one, in the unit of the clouds.

    Attributes:
        distance: to the nearest point of the other cloud.
        offset: absolute distance between local means along the normal of the other cloud's surface.
        noise: standard deviation of that offset by the scatter of both surfaces about their planes, by relief that the
            other cloud is too sparse to show, and by the uncertainty of the normal; infinite where the other cloud is a
            row of points, which has no normal.
        thickness: standard deviation of the other cloud's points about their plane there.
        spacing: of the other cloud's points there.
        point_offset: absolute distance of the point itself along the normal of the other cloud's surface, where that
            lies opposite, and 0 elsewhere: a pipe on a floor is narrower than what a local mean is taken of. What is
            farther off is told by its distance.
        point_noise: standard deviation of that offset, likewise.
        error: registration error there; None: that of the pair.
        own_spacing: of the cloud's own points there, where it differs from place to place; None: that of the pair.
    """

    distance: Float[np.ndarray, " n"]
    offset: Float[np.ndarray, " n"]
    noise: Float[np.ndarray, " n"]
    thickness: Float[np.ndarray, " n"]
    spacing: Float[np.ndarray, " n"]
    point_offset: Float[np.ndarray, " n"]
    point_noise: Float[np.ndarray, " n"]
    error: Float[np.ndarray, " n"] | None = None
    own_spacing: Float[np.ndarray, " n"] | None = None


class DetectionLimits(NamedTuple):
    """The limits of distances and offsets in a pair of scans, most of whose points are unchanged.

    Attributes:
        spacing: of neighbouring points, in the sparser cloud.
        median_distance: to the nearest point of the other cloud, in the less changed cloud.
        registration_error: robust standard deviation of the offsets, to which the noise of the local means contributes;
            positive.
        distance: to the other cloud from which a point is certainly changed, where no local limit is larger.
        offset: from the other cloud's plane, likewise.
        settings: by which the limits were derived.
    """

    spacing: float
    median_distance: float
    registration_error: float
    distance: float
    offset: float
    settings: DifferenceSettings

    def offset_errors(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The registration error or the noise of the offset at each point, whichever is greater."""
        return np.maximum(self._error(difference), difference.noise)

    def local_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The limit of the offset of each point, by the registration error and the noise there."""
        return self.settings.offsets * self.offset_errors(difference)

    def local_point_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The same of the offset of the point itself, whose noise is not averaged."""
        error = np.sqrt(MEAN_NEIGHBOURS) * self._error(difference)
        return self.settings.offsets * np.maximum(error, difference.point_noise)

    def relative_mean_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The offset of the local mean of each point, in its limit."""
        return difference.offset / self.local_offset(difference)

    def relative_point_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The offset of each point itself, in its limit."""
        return difference.point_offset / self.local_point_offset(difference)

    def relative_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The offset of each point in its limit: that of its local mean or its own, whichever is greater."""
        return np.maximum(self.relative_mean_offset(difference), self.relative_point_offset(difference))

    def _error(self, difference: LocalDifference) -> float | Float[np.ndarray, " n"]:
        return self.registration_error if difference.error is None else difference.error

    def local_distance(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The limit of the distance of each point, larger where the other cloud is sparser, thicker or farther off."""
        settings, error = self.settings, self._error(difference)
        of_pair: float | np.ndarray = max(settings.spacings * self.spacing, settings.distances * self.median_distance)
        if difference.own_spacing is not None:
            of_pair = settings.spacings * difference.own_spacing
        of_other = np.maximum(settings.spacings * difference.spacing, settings.thicknesses * difference.thickness)
        return np.maximum(of_pair, np.maximum(settings.offsets * error, of_other))


class Differences(NamedTuple):
    """The differences of both clouds from each other.

    Attributes:
        local: of each point of either cloud.
        limits: from which they are certain changes.
    """

    local: Pair[LocalDifference]
    limits: DetectionLimits


def differences_between(
    surfaces: Pair[LocalSurface],
    spacing: float,
    settings: DifferenceSettings = DifferenceSettings(),
    own_spacing: Pair[Float[np.ndarray, " _"] | None] = Pair(None, None),
) -> Differences:
    """The differences of two registered clouds from each other.

    Args:
        surfaces: of both clouds.
        spacing: of neighbouring points, in the sparser cloud.
        settings: of the limits.
        own_spacing: at each point, where it differs from place to place; None: that of the pair is everywhere.
    """
    local = parallel_map(functools.partial(local_difference, settings=settings), surfaces, surfaces.swapped)
    local = each(lambda side, own: side._replace(own_spacing=own), local, own_spacing)
    limits = detection_limits(local, spacing, settings)
    return Differences(parallel_map(lambda own, side: _with_error(own, side, limits), surfaces, local), limits)


def local_difference(
    own: LocalSurface,
    other: LocalSurface,
    chosen: Int[np.ndarray, " n"] | None = None,
    settings: DifferenceSettings = DifferenceSettings(),
) -> LocalDifference:
    """The distance and the offset of each point of one cloud to another one.

    Args:
        own: the cloud.
        other: the other cloud.
        chosen: indices of the points that are compared; None: all.
        settings: where the other surface lies opposite a point, and what of it is a row of points.
    """
    chosen = np.arange(len(own)) if chosen is None else chosen
    groups, points = own.groups(chosen), own.points[chosen]
    means = groups.mean(axis=1)
    there = other.nearest(means)
    of_means, of_points = other.heights(means, there), other.heights(points, there)
    normals, scatter = other.normals.take(there, axis=0), other.variances[there, 0]
    own_scatter = ((groups - means[:, None]) @ normals[:, :, None])[..., 0].var(axis=1)
    tilts, reach, spacing = other.tilts(there), other.reach(there), other.spacing(there)
    of_planes = own_scatter / groups.shape[1] + scatter / other.counts.take(there)
    density_ratio = (spacing / np.maximum(own.spacing(chosen), np.finfo(float).tiny)) ** 2
    of_relief = _unresolved_relief(scatter, density_ratio, groups.shape[1], settings)
    # Beyond its edge, too, a plane is turned no farther than there.
    by_tilt, by_tilt_of_points = (tilts * np.minimum(heights.beside, reach) for heights in (of_means, of_points))
    on_scan_lines = other.on_scan_lines(there, settings.slenderness)
    opposite = (of_points.beside <= reach) & (np.abs(of_points.above) <= settings.opposite_height * spacing)
    return LocalDifference(
        distance=nearest_neighbours(other.tree, points, 1)[0][:, 0],
        offset=np.abs(of_means.above),
        noise=np.where(on_scan_lines, np.inf, np.sqrt(np.maximum(of_planes, of_relief) + by_tilt**2)),
        thickness=np.sqrt(scatter),
        spacing=spacing,
        point_offset=np.where(opposite, np.abs(of_points.above), 0.0),
        point_noise=np.where(on_scan_lines, np.inf, np.sqrt(scatter + by_tilt_of_points**2)),
    )


def _unresolved_relief(
    scatter: Float[np.ndarray, " n"],
    density_ratio: Float[np.ndarray, " n"],
    averaged: int,
    settings: DifferenceSettings,
) -> Float[np.ndarray, " n"]:
    """The variance of the offset by relief between the points of the other cloud, which it is too sparse to resolve.

    The points of a dense cloud that are averaged lie in few cells of a sparse one, at least in one.

    Args:
        scatter: variance of the other cloud's points about their plane, for each point.
        density_ratio: of the own cloud to the other one there.
        averaged: number of points whose mean is compared.
        settings: how much denser the own cloud must be.
    """
    cells = np.maximum(averaged / np.maximum(density_ratio, 1.0), 1.0)
    return np.where(density_ratio > settings.density_ratio, scatter / cells, 0.0)


def detection_limits(
    local: Pair[LocalDifference], spacing: float, settings: DifferenceSettings = DifferenceSettings()
) -> DetectionLimits:
    """The limits, from the median distance and offset in the overlap, of the cloud in which less has changed.

    Args:
        local: the differences of both clouds.
        spacing: of neighbouring points, in the sparser cloud.
        settings: of the limits.
    """
    finest = settings.finest_offset * max(float(np.median(side.spacing)) for side in local)
    common = local.map(lambda side: _in_overlap(side, spacing, settings))
    offsets = each(lambda side, own: float(np.median(side.offset[own])), local, common)
    distances = each(lambda side, own: float(np.median(side.distance[own])), local, common)
    error, median_distance = max(MEDIAN_TO_DEVIATION * min(offsets), finest), min(distances)
    offset = settings.offsets * error
    distance = max(settings.spacings * spacing, settings.distances * median_distance, offset)
    about = error, distance, offset
    logger.info("differences: registration error %.4g; certain from distance %.4g and offset %.4g on", *about)
    return DetectionLimits(spacing, median_distance, error, distance, offset, settings)


def _in_overlap(side: LocalDifference, spacing: float, settings: DifferenceSettings) -> Bool[np.ndarray, " n"]:
    """The points of the overlap of both clouds, or all points where that is too small."""
    own_spacing = spacing if side.own_spacing is None else side.own_spacing
    common = side.distance <= settings.overlap * np.maximum(side.spacing, own_spacing)
    return common if common.mean() >= settings.min_overlap else np.ones(len(common), bool)


def within_limits(side: LocalDifference, limits: DetectionLimits) -> Bool[np.ndarray, " n"]:
    """The points that are no sure change.

    Args:
        side: the differences of a cloud.
        limits: from which they are certain changes.
    """
    if side.own_spacing is None:
        return np.asarray((side.distance <= limits.distance) & (side.offset <= limits.offset))
    within = (side.distance <= limits.local_distance(side)) & (side.offset <= limits.local_offset(side))
    return np.asarray(within)


def median_errors(
    points: Float[np.ndarray, "n 3"], side: LocalDifference, places: Float[np.ndarray, "p 3"], limits: DetectionLimits
) -> Float[np.ndarray, " p"]:
    """The median offset, as a standard deviation, of the region around each of some places.

    Args:
        points: of a cloud, some of which are no sure change.
        side: their differences.
        places: that regions are around.
        limits: from which differences are certain changes.
    """
    rows = np.flatnonzero(within_limits(side, limits))
    regions = nearest_neighbours(cKDTree(points[rows]), places, limits.settings.region)[1]
    return np.asarray(MEDIAN_TO_DEVIATION * np.median(side.offset[rows][regions], axis=1))


def registration_errors(
    places: Float[np.ndarray, "p 3"], medians: Float[np.ndarray, " p"], limits: DetectionLimits
) -> Float[np.ndarray, " p"]:
    """The registration error at some places of a cloud whose spacing differs from place to place.

    Args:
        places: of the cloud.
        medians: of the regions around them.
        limits: of the pair.
    """
    settings = limits.settings
    around = nearest_neighbours(cKDTree(places), places, settings.regions_around)[1]
    return bounded_error(np.median(medians[around], axis=1), limits)


def bounded_error(errors: Float[np.ndarray, " p"], limits: DetectionLimits) -> Float[np.ndarray, " p"]:
    """Registration errors of places, as far from that of the pair as they may be."""
    least, most = limits.settings.min_error, limits.settings.max_error
    return np.clip(errors, least * limits.registration_error, most * limits.registration_error)


def _with_error(own: LocalSurface, side: LocalDifference, limits: DetectionLimits) -> LocalDifference:
    """The differences of a cloud with the registration error at each point: the median offset of the region around."""
    settings = limits.settings
    rows = np.flatnonzero(within_limits(side, limits))
    if len(rows) < settings.region:
        return side
    places = own.points[rows[evenly_chosen(len(rows), settings.regions)]]
    medians = median_errors(own.points, side, places, limits)
    everywhere = side.own_spacing is None
    errors = bounded_error(medians, limits) if everywhere else registration_errors(places, medians, limits)
    nearest = nearest_neighbours(cKDTree(places), own.points, 1)[1][:, 0]
    return side._replace(error=errors[nearest])
