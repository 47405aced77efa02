"""The stage that measures how far each point of one scan is from the surface of the other.

The distance along the normal between local means is that of M3C2 (Lague, Brodu and Leroux 2013, section 3), on nearest
neighbours in place of cylinders: averages see offsets smaller than the noise of single points. The distance to the
nearest point sees what lies beside a surface, where normals say nothing.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.geometry.neighbours import nearest_neighbours
from gmmjax.geometry.statistics import MEDIAN_TO_DEVIATION
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class DifferenceSettings:
    """From which distance and offset on a point is surely changed.

    Attributes:
        spacings: distance to the other cloud, in spacings of either cloud.
        distances: the same, in usual distances of the pair.
        thicknesses: the same, in standard deviations of the other surface's points about their plane there.
        offsets: offset from the other cloud's plane, in standard deviations of usual offsets.
        finest_offset: in spacings: surfaces without noise, such as computed planes, are compared no finer than this.
            0: the rounding of their coordinates (1e-9 m in a country's grid) would look like an offset.
    """

    spacings: float = 3.0
    distances: float = 3.0
    thicknesses: float = 4.0
    offsets: float = 7.0
    finest_offset: float = 1e-6


class LocalDifference(NamedTuple):
    """For each point of one cloud how far it is from the other one.

    Attributes:
        distance: to the nearest point of the other cloud.
        offset: along the normal of the other cloud's surface, between local means.
        noise: standard deviation of that offset by the scatter of both surfaces about their planes.
        thickness: standard deviation of the other cloud's points about their plane there.
        spacing: of the other cloud's points there.
    """

    distance: Float[np.ndarray, " n"]
    offset: Float[np.ndarray, " n"]
    noise: Float[np.ndarray, " n"]
    thickness: Float[np.ndarray, " n"]
    spacing: Float[np.ndarray, " n"]


class DetectionLimits(NamedTuple):
    """What distances and offsets mean in a pair of scans, most of whose points are unchanged.

    Attributes:
        spacing: of neighbouring points.
        usual_distance: median distance to the nearest point of the other cloud.
        registration_error: robust standard deviation of the offsets: noise of the local means and registration error
            together; positive.
        distance: from the other cloud, from which on a point is surely changed where that is as dense as usual.
        offset: from the other cloud's plane, likewise.
        settings: what is surely changed.
    """

    spacing: float
    usual_distance: float
    registration_error: float
    distance: float
    offset: float
    settings: DifferenceSettings

    def local_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The limit of the offset of each point, larger where its neighbourhood is noisier."""
        return np.maximum(self.offset, self.settings.offsets * difference.noise)

    def local_distance(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The limit of the distance of each point, larger where the other cloud is sparser or thicker."""
        local = np.maximum(
            self.settings.spacings * difference.spacing, self.settings.thicknesses * difference.thickness
        )
        return np.maximum(self.distance, local)


class Differences(NamedTuple):
    """The differences of both clouds from each other.

    Attributes:
        local: of each point of either cloud.
        limits: from which on they are changes.
    """

    local: Pair[LocalDifference]
    limits: DetectionLimits


def differences(
    surfaces: Pair[LocalSurface], spacing: float, settings: DifferenceSettings = DifferenceSettings()
) -> Differences:
    """The differences of two registered clouds from each other.

    Args:
        surfaces: of both clouds.
        spacing: of neighbouring points, in the sparser cloud.
        settings: what is surely changed.
    """
    local = each(local_difference, surfaces, surfaces.swapped)
    return Differences(local, detection_limits(local, spacing, settings))


def local_difference(
    own: LocalSurface, other: LocalSurface, chosen: Int[np.ndarray, " n"] | None = None
) -> LocalDifference:
    """The distance and the offset of each point of one cloud to another one.

    Args:
        own: the cloud.
        other: the other cloud.
        chosen: indices of the points that are asked for; all by default.
    """
    chosen = np.arange(len(own)) if chosen is None else chosen
    groups = own.groups(chosen)
    means = groups.mean(axis=1)
    there = other.nearest(means)
    normals, variances = other.normals[there], other.variances[there]
    own_scatter = ((groups - means[:, None]) @ normals[:, :, None])[..., 0].var(axis=1)
    return LocalDifference(
        distance=nearest_neighbours(other.tree, own.points[chosen], 1)[0][:, 0],
        offset=np.abs(((means - other.centres[there]) * normals).sum(axis=1)),
        noise=np.sqrt(own_scatter / groups.shape[1] + variances[:, 0] / other.neighbours.shape[1]),
        thickness=np.sqrt(variances[:, 0]),
        spacing=other.spacing(there),
    )


def detection_limits(
    local: Pair[LocalDifference], spacing: float, settings: DifferenceSettings = DifferenceSettings()
) -> DetectionLimits:
    """The limits by the medians of the cloud in which less has changed.

    Args:
        local: the differences of both clouds.
        spacing: of neighbouring points, in the sparser cloud.
        settings: what is surely changed.
    """
    finest = settings.finest_offset * max(float(np.median(side.spacing)) for side in local)
    error = max(MEDIAN_TO_DEVIATION * min(float(np.median(side.offset)) for side in local), finest)
    usual = min(float(np.median(side.distance)) for side in local)
    offset = settings.offsets * error
    distance = max(settings.spacings * spacing, settings.distances * usual, offset)
    return DetectionLimits(spacing, usual, error, distance, offset, settings)
