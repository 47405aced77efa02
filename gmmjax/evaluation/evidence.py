"""The evidence test of the joint method, for the segments of any detector."""

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes import (
    Candidates,
    LocalDifference,
    Survey,
    WorkingCloud,
    differences_between,
    without_evidence,
    working_pair,
)
from gmmjax.clouds import SensorViews
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


def without_unobserved(
    points: Pair[Float[np.ndarray, "_ 3"]], views: Pair[SensorViews | None], labels: Pair[Int[np.ndarray, " _"]]
) -> Pair[Int[np.ndarray, " _"]]:
    """The labels without those segments that the other survey cannot speak about.

    With the other survey's views it must have seen that there was nothing; without them the segment must not only
    continue the surfaces beside it. Clouds that fill volumes hide nothing: all their segments stay.

    Args:
        points: of both clouds.
        views: where they were seen from, if that is known.
        labels: per point -1 or the number of a change.
    """
    working = working_pair(points)
    if working.volumetric:
        return labels
    surfaces = working.clouds.map(lambda cloud: LocalSurface.of(cloud.points))
    surveys = each(Survey, surfaces, views)
    measured = differences_between(surfaces, working.spacing)

    def kept(cloud: WorkingCloud, difference: LocalDifference, labels: np.ndarray, other: Survey) -> np.ndarray:
        nothing = np.zeros((1, len(cloud.points)))
        segments = Candidates(cloud.points, difference, nothing, _voxel_labels(cloud, labels))
        rejected, _ = without_evidence(segments, other, measured.limits)
        return np.where(rejected[cloud.member], -1, labels)

    return each(kept, working.clouds, measured.local, labels, surveys.swapped)


def _voxel_labels(cloud: WorkingCloud, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """The label of each voxel: that of one of its points, of a changed one where it has any."""
    voxels = np.full(len(cloud.points), -1)
    np.maximum.at(voxels, cloud.member, labels)
    return voxels
