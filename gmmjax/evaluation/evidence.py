"""The evidence test of the joint method, for the segments of any detector."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import cKDTree

from gmmjax.changes import surface
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.free_space import observation
from gmmjax.changes.local_difference import difference_scale, local_difference
from gmmjax.changes.scales import WorkingCloud, working_pair
from gmmjax.clouds import SensorViews
from gmmjax.evaluation.labelled_pair import LabelledPair


def without_unobserved(
    pair: LabelledPair, labels_before: Int[np.ndarray, " n0"], labels_after: Int[np.ndarray, " n1"]
) -> tuple[Int[np.ndarray, " n0"], Int[np.ndarray, " n1"]]:
    """The labels without those segments that the other survey cannot speak about.

    With the other survey's views it must have seen that there was nothing; without them the segment must not only
    continue the surfaces beside it. Clouds that fill volumes hide nothing: all their segments stay.

    Args:
        pair: the clouds, and where they were seen from if that is known.
        labels_before: per point -1 or the number of a change.
        labels_after: the same for the after cloud.
    """
    working = working_pair(pair.before.points, pair.after.points, DetectionConfig())
    if working.volumetric:
        return labels_before, labels_after
    clouds = working.before, working.after
    trees = [cKDTree(cloud.points) for cloud in clouds]
    differences = [local_difference(trees[own].data, trees[own], trees[1 - own]) for own in (0, 1)]
    scales = surface.SurfaceScales.of(working.spacing, difference_scale(*differences))
    dropped = []
    for own, (labels, views) in enumerate(((labels_before, pair.after.views), (labels_after, pair.before.views))):
        cloud = surface.SurfaceCloud(clouds[own].points, differences[own], np.zeros((1, len(clouds[own].points))))
        voxels = _voxel_labels(clouds[own], labels)
        dropped.append(_dropped(cloud, voxels, clouds[1 - own].points, scales, views)[clouds[own].member])
    return np.where(dropped[0], -1, labels_before), np.where(dropped[1], -1, labels_after)


def _dropped(
    cloud: surface.SurfaceCloud,
    labels: Int[np.ndarray, " n"],
    other: np.ndarray,
    scales: surface.SurfaceScales,
    views: SensorViews | None,
) -> Bool[np.ndarray, " n"]:
    """The points whose segments do not pass."""
    if views is None:
        return surface.continuing(cloud.points, labels, other, scales)
    observed = observation(cloud.points, other, views, scales.distance)
    dropped = surface.not_seen_empty(cloud, labels, observed, other, scales)
    hidden = surface.hidden_parts(cloud.points, np.where(dropped, -1, labels), observed, scales)
    return dropped | surface.continuing(cloud.points, hidden, other, scales)


def _voxel_labels(cloud: WorkingCloud, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """The label of each voxel: that of one of its points, of a changed one where it has any."""
    voxels = np.full(len(cloud.points), -1)
    np.maximum.at(voxels, cloud.member, labels)
    return voxels
