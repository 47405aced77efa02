"""The evidence test of the joint method, for the segments of any detector."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes import DetectionConfig, JointDetector, Scan
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair, each


def without_unobserved(
    points: Pair[Float[np.ndarray, "_ 3"]],
    views: Pair[SensorViews | None],
    labels: Pair[Int[np.ndarray, " _"]],
    config: DetectionConfig = DetectionConfig(),
) -> Pair[Int[np.ndarray, " _"]]:
    """The labels without those segments that the verdict of "joint" turns down, by the facts of its own candidates.

    The clouds are taken as they are, without registration. Clouds that fill volumes hide nothing: all their segments
    stay.

    Args:
        points: of both clouds.
        views: where they were seen from, if that is known.
        labels: per point -1 or the number of a change.
        config: of the evidence.
    """
    as_given = dataclasses.replace(config, method="joint", registration="never", kinds="both")
    return JointDetector(as_given).evident(each(Scan, points, views), labels)
