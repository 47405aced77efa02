"""Changes of volumetric clouds: the components of the joint mixture that one cloud has and the other has not."""

import numpy as np
from jaxtyping import Float

from gmmjax.changes.change import Change, Kind
from gmmjax.changes.fit.joint_fit import JointFits, component_excess
from gmmjax.changes.objects.consensus import SMALLEST_CHANGE, CloudChanges, change_of

# A component's points must exceed what the other cloud has there by so many standard deviations of the counts.
LEAST_SIGNIFICANCE = 5.0


def restart_weights(fits: JointFits, comparable: bool) -> Float[np.ndarray, " r"]:
    """How much each restart counts, summing to 1.

    Restarts that saw the same points are weighted by exp(-message length), the posterior odds of the mixtures that they
    ended in: a restart that ended in a worse mixture has no say, those that ended in the same one share. On different
    subsamples all count the same.
    """
    if not comparable:
        return np.full(len(fits.message_length), 1 / len(fits.message_length))
    weights = np.exp(fits.message_length.min() - fits.message_length)
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
    the best restart tell the changes apart: a change has those points of a component whose probability reaches the
    threshold.

    Args:
        points: all points of the cloud, registered to the other one.
        fits: joint mixtures.
        weights: of the restarts.
        kind: what a change of this cloud is.
        threshold: probability from which a point is changed.
    """
    posterior, slots = component_excess(fits, points, kind == "appeared")
    probability = weights @ posterior
    best = int(np.argmin(fits.message_length))
    changed = probability >= threshold
    labels = np.full(len(points), -1)
    items: list[Change] = []
    for slot in np.unique(slots[best][changed]):
        members = changed & (slots[best] == slot)
        significance = _significance(int(members.sum()), float(posterior[best][members].mean()))
        if members.sum() < SMALLEST_CHANGE or significance < LEAST_SIGNIFICANCE:
            continue
        labels[members] = len(items)
        items.append(change_of(points[members], kind, float(probability[members].mean()), significance))
    return CloudChanges(probability, labels, items)


def _significance(count: int, share: float) -> float:
    """Excess over the expected count, in standard deviations of both Poisson counts."""
    expected = count * (1 - share)
    return float((count - expected) / np.sqrt(count + expected))
