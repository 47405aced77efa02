"""From the segments of a surface scan to the records of its changes."""

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes.change import Change, Kind
from gmmjax.changes.objects.consensus import CloudConsensus, change_of
from gmmjax.changes.differences import DifferenceScale, LocalDifference
from gmmjax.changes.evidence.surface import SurfaceCloud, SurfaceSegments

# A change exceeds the counting noise and the registration error by so many standard deviations.
LEAST_SIGNIFICANCE = 4.0
# The power that the odds are raised to, from the reliability curve over simulated laboratories.
SHARPENING = 3.0
# And of points that look changed, but are of no change, so many are.
OUTSIDE = 0.05


def surface_consensus(
    points: Float[np.ndarray, "n 3"],
    member: Int[np.ndarray, " n"],
    cloud: SurfaceCloud,
    segments: SurfaceSegments,
    usual: DifferenceScale,
    kind: Kind,
) -> CloudConsensus:
    """The changes of all points of a cloud: those of the working points that stand for them.

    A change's probability is the mean over the restarts and its points.

    Args:
        points: all points of the cloud, registered to the other one.
        member: the working point of each.
        cloud: the working points, with their differences to the other cloud.
        segments: of the working points.
        usual: the usual differences of the pair.
        kind: what a change of this cloud is.
    """
    probability = calibrated(segments.probability.mean(axis=0))
    labels = np.full(len(cloud.points), -1)
    items: list[Change] = []
    for label in range(segments.labels.max(initial=-1) + 1):
        own = segments.labels == label
        strength = significance(cloud.difference, own, usual)
        if strength < LEAST_SIGNIFICANCE:
            continue
        labels[own] = len(items)
        items.append(change_of(points[own[member]], kind, float(probability[own].mean()), strength))
    probability = np.where(labels >= 0, probability, OUTSIDE * probability)
    return CloudConsensus(probability[member], labels[member], items)


def calibrated(probability: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The probability whose odds are those of the given one to the third power; 0.5 stays 0.5.

    Distances say "a quarter changed" of points of which hardly any has: seen over simulated scenes, the odds of what
    distances, offsets and mixture say together are too timid.
    """
    changed, unchanged = probability**SHARPENING, (1 - probability) ** SHARPENING
    return np.asarray(changed / (changed + unchanged))


def significance(difference: LocalDifference, own: np.ndarray, usual: DifferenceScale) -> float:
    """By how many standard deviations a segment exceeds what the other cloud has in its place.

    The greater of two: the excess of points over the other cloud's, against the counting noise of both and the points
    that a registration error could have brought; and the median offset against that error.
    """
    count = float(own.sum())
    explained = float((difference.distance[own] < usual.distance + usual.offset).sum())
    excess = (count - explained) / np.sqrt(count + explained + explained**2)
    offset = float(np.median(difference.offset[own])) / max(usual.offset, np.finfo(np.float64).tiny)
    return max(float(excess), offset)
