"""Changes of volumetric clouds: the components of the joint mixture that one cloud has and the other has not."""

import numpy as np
from jaxtyping import Float

from gmmjax.changes.change import Kind
from gmmjax.changes.fit.joint_fit import CHUNK, JointFits, component_excess
from gmmjax.changes.objects.cloud_changes import SMALLEST_CHANGE, CloudChanges, change_of

# Standard deviations of the counts, at least, by which a component's points exceed what the other cloud has there.
MIN_SIGNIFICANCE = 5.0


def restart_weights(message_length: Float[np.ndarray, " r"], comparable: bool) -> Float[np.ndarray, " r"]:
    """The weight of each restart, summing to 1.

    Restarts on the same points are weighted by exp(-message length), the posterior odds of their mixtures: a restart
    that ended in a worse mixture has next to no weight, those that ended in the same one share it. Restarts on
    different subsamples are weighted equally.

    Args:
        message_length: of the joint mixture of each, in nats.
        comparable: whether all restarts were fitted to the same points.
    """
    if not comparable:
        return np.full(len(message_length), 1 / len(message_length))
    weights = np.exp(message_length.min() - message_length)
    return weights / weights.sum()


def volumetric_changes(
    points: Float[np.ndarray, "n 3"],
    fits: JointFits,
    weights: Float[np.ndarray, " r"],
    kind: Kind,
    threshold: float,
) -> CloudChanges:
    """The changes of one cloud whose points fill volumes.

    Each point gets the posterior that it is of a component which changed, averaged over the restarts. The components of
    the best restart separate the changes: a change has those points of a component whose probability reaches the
    threshold.

    Args:
        points: all points of the cloud, registered to the other one.
        fits: joint mixtures.
        weights: of the restarts.
        kind: what a change of this cloud is.
        threshold: probability from which a point is changed.
    """
    after, best = kind == "appeared", int(np.argmin(fits.message_length))
    probability = _mean_posterior(points, fits, weights, after)
    posterior, slots = component_excess(fits, points, after, best)
    changed = probability >= threshold
    found = CloudChanges(probability, np.full(len(points), -1), [])
    for slot in np.unique(slots[changed]):
        members = changed & (slots == slot)
        significance = _significance(int(members.sum()), float(posterior[members].mean()))
        if members.sum() < SMALLEST_CHANGE or significance < MIN_SIGNIFICANCE:
            continue
        found.labels[members] = len(found.items)
        found.items.append(change_of(points[members], kind, float(probability[members].mean()), significance))
    return found


def _mean_posterior(
    points: Float[np.ndarray, "n 3"], fits: JointFits, weights: Float[np.ndarray, " r"], after: bool
) -> Float[np.ndarray, " n"]:
    """The posterior that each point is of a component which changed, averaged over the restarts.

    Some points at a time: all points by all restarts are more than memory holds.
    """
    means = [np.zeros(0)]
    for first in range(0, len(points), CHUNK):
        chunk = points[first : first + CHUNK]
        restarts = range(len(weights))
        means.append(weights @ np.stack([component_excess(fits, chunk, after, restart)[0] for restart in restarts]))
    return np.concatenate(means)


def _significance(count: int, share: float) -> float:
    """Excess over the expected count, in standard deviations of both Poisson counts."""
    expected = count * (1 - share)
    return float((count - expected) / np.sqrt(count + expected))
