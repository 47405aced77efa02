"""The evidence test of the joint method, for the segments of any detector."""

import numpy as np
from jaxtyping import Int

from gmmjax.changes.evidence import surface
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.evidence.free_space import Survey
from gmmjax.changes.differences import difference_scale, local_difference
from gmmjax.changes.prepare.resolution import WorkingCloud, working_pair
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
    surveys = Survey.of(clouds[0].points, pair.before.views), Survey.of(clouds[1].points, pair.after.views)
    differences = [local_difference(surveys[own].surface, surveys[1 - own].surface) for own in (0, 1)]
    scales = surface.SurfaceScales.of(working.spacing, difference_scale(*differences))
    kept = []
    for own, labels in enumerate((labels_before, labels_after)):
        cloud = surface.SurfaceCloud(clouds[own].points, differences[own], np.zeros((1, len(clouds[own].points))))
        dropped, _ = surface.put_to_evidence(cloud, _voxel_labels(clouds[own], labels), surveys[1 - own], scales)
        kept.append(np.where(dropped[clouds[own].member], -1, labels))
    return kept[0], kept[1]


def _voxel_labels(cloud: WorkingCloud, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """The label of each voxel: that of one of its points, of a changed one where it has any."""
    voxels = np.full(len(cloud.points), -1)
    np.maximum.at(voxels, cloud.member, labels)
    return voxels
