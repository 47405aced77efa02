"""From the segments of a surface scan to the records of its changes."""

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes.change import Change, Kind
from gmmjax.changes.differences import DetectionLimits, LocalDifference
from gmmjax.changes.evidence.examination import Examined
from gmmjax.changes.objects.consensus import CloudChanges, change_of

# A change exceeds the counting noise and the registration error by so many standard deviations.
LEAST_SIGNIFICANCE = 4.0
# The power that the odds are raised to, from the reliability curve over simulated laboratories.
SHARPENING = 3.0
# And of points that look changed, but are of no change, so many are.
OUTSIDE = 0.05


def surface_changes(
    points: Float[np.ndarray, "n 3"],
    member: Int[np.ndarray, " n"],
    difference: LocalDifference,
    examined: Examined,
    limits: DetectionLimits,
    kind: Kind,
) -> CloudChanges:
    """The changes of all points of a cloud: those of the working points that stand for them.

    A change's probability is the mean over the restarts and its points.

    Args:
        points: all points of the cloud, registered to the other one.
        member: the working point of each.
        difference: of each working point to the other cloud.
        examined: the candidates that the evidence left, of the working points.
        limits: of distances and offsets.
        kind: what a change of this cloud is.
    """
    probability = calibrated(examined.probability.mean(axis=0))
    labels = np.full(len(examined.labels), -1)
    items: list[Change] = []
    for label in range(examined.labels.max(initial=-1) + 1):
        own = examined.labels == label
        strength = significance(difference, own, limits)
        if strength < LEAST_SIGNIFICANCE:
            continue
        labels[own] = len(items)
        items.append(change_of(points[own[member]], kind, float(probability[own].mean()), strength))
    probability = np.where(labels >= 0, probability, OUTSIDE * probability)
    return CloudChanges(probability[member], labels[member], items)


def calibrated(probability: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The probability whose odds are those of the given one to the third power; 0.5 stays 0.5.

    Distances say "a quarter changed" of points of which hardly any has: seen over simulated scenes, the odds of what
    distances, offsets and mixture say together are too timid.
    """
    changed, unchanged = probability**SHARPENING, (1 - probability) ** SHARPENING
    return np.asarray(changed / (changed + unchanged))


def significance(difference: LocalDifference, own: np.ndarray, limits: DetectionLimits) -> float:
    """By how many standard deviations a segment exceeds what the other cloud has in its place.

    The greater of two: the excess of points over the other cloud's, against the counting noise of both and the points
    that a registration error could have brought; and the median offset against that error.
    """
    count = float(own.sum())
    explained = float((difference.distance[own] < limits.usual_distance + limits.registration_error).sum())
    excess = (count - explained) / np.sqrt(count + explained + explained**2)
    offset = float(np.median(difference.offset[own])) / max(limits.registration_error, np.finfo(np.float64).tiny)
    return max(float(excess), offset)
