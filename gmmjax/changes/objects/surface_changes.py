"""From the segments of a surface scan to the records of its changes."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes.change import Kind
from gmmjax.changes.differences import DetectionLimits, LocalDifference
from gmmjax.changes.evidence.examination import Examined
from gmmjax.changes.objects.cloud_changes import CloudChanges, change_of, rejected_of


@dataclasses.dataclass(frozen=True)
class SurfaceChangeSettings:
    """Settings of the probability of the points of changes.

    Attributes:
        sharpening: power that the odds of a point that looks changed are raised to, from the reliability curve over
            simulated laboratories. 1: they stay as they were measured.
        outside: factor of the probability of points that look changed but are of no change; from the same curve, of
            those about this fraction has changed. 1: they keep the probability of a change.
    """

    sharpening: float = 3.0
    outside: float = 0.05


def surface_changes(
    points: Float[np.ndarray, "n 3"],
    member: Int[np.ndarray, " n"],
    difference: LocalDifference,
    examined: Examined,
    kind: Kind,
    limits: DetectionLimits,
    settings: SurfaceChangeSettings = SurfaceChangeSettings(),
) -> CloudChanges:
    """The changes of all points of a cloud: those of the working points that stand for them.

    Args:
        points: all points of the cloud, registered to the other one.
        member: the working point of each.
        difference: of each working point to the other cloud.
        examined: the candidates that are changes, of the working points.
        kind: what a change of this cloud is.
        limits: of distances and offsets.
        settings: how probable points are.
    """
    labels, probability = examined.labels, outside_probability(examined.looks_changed, settings)
    rejected = []
    for rows, why_not in examined.rejected:
        probability[rows] = why_not.changed
        own = np.zeros(len(labels), bool)
        own[rows] = True
        rejected.append(rejected_of(points[own[member]], kind, why_not))
    items = []
    for label, (of_change, why) in enumerate(zip(examined.probability, examined.explanations, strict=True)):
        own = labels == label
        probability[own] = of_change
        deviations = significance(difference, own, limits)
        items.append(change_of(points[own[member]], kind, float(of_change), deviations, why))
    return CloudChanges(probability[member], labels[member], items, tuple(rejected))


def outside_probability(
    looks_changed: Float[np.ndarray, " n"], settings: SurfaceChangeSettings = SurfaceChangeSettings()
) -> Float[np.ndarray, " n"]:
    """The probability of points that are of no candidate.

    Args:
        looks_changed: by the mixture, the distance and the offset.
        settings: how probable such points are.
    """
    return np.asarray(settings.outside * calibrated(looks_changed, settings))


def calibrated(
    probability: Float[np.ndarray, " n"], settings: SurfaceChangeSettings = SurfaceChangeSettings()
) -> Float[np.ndarray, " n"]:
    """The probability with its odds raised to the power `sharpening`; 0.5 stays 0.5.

    Uncalibrated probabilities are too moderate: of the points with 0.25 by distance, offset and mixture, hardly any has
    changed in simulated scenes.
    """
    changed, unchanged = probability**settings.sharpening, (1 - probability) ** settings.sharpening
    return np.asarray(changed / (changed + unchanged))


def significance(difference: LocalDifference, own: Bool[np.ndarray, " n"], limits: DetectionLimits) -> float:
    """The number of standard deviations by which a segment exceeds what the other cloud has in its place.

    The greater of two: the excess of points over the other cloud's, divided by the counting noise of both and the
    points that a registration error can account for; and the median offset divided by that error.

    Args:
        difference: of each working point to the other cloud.
        own: whether each is a point of the segment.
        limits: of distances and offsets.
    """
    count = float(own.sum())
    explained = float((difference.distance[own] < limits.median_distance + limits.registration_error).sum())
    excess = (count - explained) / np.sqrt(count + explained + explained**2)
    offset = float(np.median(difference.offset[own])) / max(limits.registration_error, np.finfo(np.float64).tiny)
    return max(float(excess), offset)
