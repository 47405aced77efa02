"""The signed distance between two scans at each point: by how much, and to which side, the surface has moved there.

It is M3C2's (`m3c2`), at the points of both scans and along the normals of their surfaces, which point to the side that
the surface was scanned from.
"""

import dataclasses
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes.differences import DetectionLimits, Differences, LocalDifference
from gmmjax.changes.m3c2 import M3C2Distances, M3C2Settings, m3c2_distances
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each

# What tells from which side surfaces were scanned: the sensor's position, that z is a height, or nothing.
OuterSide = Literal["sensor", "up", "unknown"]


@dataclasses.dataclass(frozen=True)
class SignedDistanceSettings:
    """The cylinders about the points of two scans, and where there are too few points to compare.

    Attributes:
        neighbours: points in a cylinder, on a flat surface, at the spacing of the sparser cloud there: its radius
            follows. Few: noisy distances, and a level of detection that is itself uncertain; many: small changes are
            averaged with what is beside them.
        margin: half length of a cylinder in the point's own cloud, in radii. Small: of rough surfaces a part is cut
            off; large: other surfaces are mixed in, beside edges first.
        reach: by which the cylinder is longer in the other cloud, in distances to its nearest point, which may lie
            beside the normal. 0: what has moved by more than the margin is not found; large: what lies behind the
            surface is mixed in.
        min_points: in a cylinder, of either cloud; with fewer there is no distance. 2: edges of clouds have one, with
            a level of detection that means little.
    """

    neighbours: float = 15.0
    margin: float = 1.5
    reach: float = 2.0
    min_points: int = 5


class PointFigures(NamedTuple):
    """The M3C2 figures of each point of a cloud: see `Changes`; NaN where there is nothing to compare with.

    Attributes:
        distance: signed.
        level_of_detection: at 95 %.
        significance: in standard errors.
    """

    distance: Float[np.ndarray, " n"]
    level_of_detection: Float[np.ndarray, " n"]
    significance: Float[np.ndarray, " n"]


class CorePoints(NamedTuple):
    """The points that distances are measured at, in the directions in which they are.

    Attributes:
        points: of one cloud.
        normals: of its surface there, towards the side that it was scanned from.
        spacing: of the cloud's points there.
    """

    points: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    spacing: Float64[np.ndarray, " n"]

    @classmethod
    def of(
        cls, surface: LocalSurface, towards: Float64[np.ndarray, "p 3"], chosen: Int[np.ndarray, " n"] | None = None
    ) -> "CorePoints":
        """Points of a surface, with their normals turned to the nearest of some places.

        Args:
            surface: of one cloud.
            towards: where the sensor stood.
            chosen: indices of the points; None: all.
        """
        chosen = np.arange(len(surface)) if chosen is None else chosen
        points, normals = surface.points[chosen], surface.normals[chosen]
        there = towards[cKDTree(towards).query(points)[1]]
        inward = ((there - points) * normals).sum(axis=1) < 0
        return cls(points, np.where(inward[:, None], -normals, normals), surface.spacing(chosen))


def signed_distances(
    clouds: Pair[Float64[np.ndarray, "_ 3"]],
    surfaces: Pair[LocalSurface],
    differences: Differences,
    towards: Pair[Float64[np.ndarray, "_ 3"]],
    settings: SignedDistanceSettings = SignedDistanceSettings(),
) -> Pair[PointFigures]:
    """The distance from the before to the after surface at each working point of either cloud, in the clouds' unit.

    Positive where the after surface lies on the outer side of the before one: towards the sensor.

    Args:
        clouds: all points of both clouds, registered.
        surfaces: of the working points, which are the core points.
        differences: of these from each other.
        towards: where the sensor of either survey stood, or is taken to have stood, in the before frame.
        settings: of the cylinders.
    """
    cores = each(CorePoints.of, surfaces, towards)
    errors = differences.local.map(lambda side: _registration_errors(side, differences.limits))
    return distances_at(clouds, cores, differences.local, errors, settings)


def distances_at(
    clouds: Pair[Float64[np.ndarray, "_ 3"]],
    cores: Pair[CorePoints],
    local: Pair[LocalDifference],
    errors: Pair[Float64[np.ndarray, " _"]],
    settings: SignedDistanceSettings = SignedDistanceSettings(),
    reach: float = np.inf,
) -> Pair[PointFigures]:
    """Measure signed distances at given core points of either cloud.

    Args:
        clouds: all points of both clouds that may be in a cylinder, registered.
        cores: the core points of either cloud.
        local: the differences of these.
        errors: the registration error at each of them.
        settings: of the cylinders.
        reach: half length of the cylinders, at most, in the unit of the clouds.
    """
    radii = each(lambda own, side: _radii(own, side, settings), cores, local)
    near = radii.map(lambda own: np.minimum(settings.margin * own, reach))
    far = each(lambda own, side: np.minimum(own + settings.reach * side.distance, reach), near, local)
    # The core points of both clouds at once: each cloud is packed once.
    found = m3c2_distances(
        np.concatenate([own.points for own in cores]),
        np.concatenate([own.normals for own in cores]),
        clouds,
        M3C2Settings(np.concatenate([*radii]), Pair(np.r_[near.before, far.after], np.r_[far.before, near.after])),
        np.concatenate([*errors]),
    )
    count = len(cores.before.points)
    return Pair(slice(count), slice(count, None)).map(lambda rows: _figures(found, rows, settings.min_points))


def overhead_viewpoint(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "1 3"]:
    """A place high above the middle of a cloud, along z, which its surfaces are taken to be seen from."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    return np.asarray((lower + upper) / 2 + np.array([0.0, 0.0, (upper - lower).max()]))[None]


def _figures(found: M3C2Distances, rows: slice, min_points: int) -> PointFigures:
    """Those of some core points, where either cloud has enough points."""
    enough: Bool[np.ndarray, " n"] = np.minimum(*found.count)[rows] >= min_points
    figures = found.distance, found.level_of_detection, found.significance
    return PointFigures(*(np.where(enough, values[rows], np.nan) for values in figures))


def _radii(
    core: CorePoints, difference: LocalDifference, settings: SignedDistanceSettings
) -> Float64[np.ndarray, " n"]:
    """The radii of the cylinders, by the larger of both clouds' spacings at each point."""
    return np.asarray(np.sqrt(settings.neighbours / np.pi) * np.maximum(core.spacing, difference.spacing))


def _registration_errors(difference: LocalDifference, limits: DetectionLimits) -> Float64[np.ndarray, " n"]:
    if difference.error is not None:
        return difference.error
    return np.full(len(difference.distance), limits.registration_error)
