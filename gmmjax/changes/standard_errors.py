"""The standard error of an average over restarts."""

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.pair import Pair, each


def means_of_changes(
    probability: Pair[RestartValues], labels: Pair[Int[np.ndarray, " _"]], count: int
) -> Float[np.ndarray, "r c"]:
    """For each restart the mean over the points of each change of the probability that they look changed.

    Args:
        probability: of the points of either cloud.
        labels: of either cloud, per point -1 or the index of its change.
        count: number of changes, each with a point.
    """
    rows = labels.map(lambda own: np.flatnonzero(own >= 0))
    of_rows = np.concatenate(list(each(lambda own, chosen: own[chosen], labels, rows)))
    points = np.bincount(of_rows, minlength=count)
    restarts = zip(*each(lambda own, chosen: own.each(chosen), probability, rows), strict=True)
    return np.stack([np.bincount(of_rows, np.concatenate(both), count) / points for both in restarts])


def standard_error(means: Float[np.ndarray, "r c"], weights: Float[np.ndarray, " r"]) -> Float[np.ndarray, " c"]:
    """The standard error of weighted means; of equal weights the standard deviation by the root of the number.

    Args:
        means: by r restarts, at least two, of each of c changes.
        weights: of the restarts, summing to 1.
    """
    deviations, restarts = means - weights @ means, len(weights)
    return np.asarray(np.sqrt(weights**2 @ deviations**2 * restarts / (restarts - 1)))


def means_of_pairs(
    components: RestartValues,
    labels: Int[np.ndarray, " n"],
    count: int,
    voted: Bool[np.ndarray, "other own k"],
) -> Float[np.ndarray, "other own c"]:
    """For each pair of restarts the share of the points of each change whose Gaussian changed; 0 where it has none.

    Args:
        components: the Gaussian of each point of one cloud.
        labels: of the cloud, per point -1 or the index of its change.
        count: number of changes.
        voted: by which restarts of the other cloud each Gaussian of each restart of the cloud changed.
    """
    rows, slots = np.flatnonzero(labels >= 0), voted.shape[2]
    points = np.maximum(np.bincount(labels[rows], minlength=count), 1)
    means = []
    for component, own in zip(components.each(rows), voted.swapaxes(0, 1), strict=True):
        numbers = np.bincount(labels[rows] * slots + component, minlength=count * slots).reshape(count, slots)
        means.append(own @ numbers.T / points)
    return np.stack(means, axis=1)


def standard_error_of_pairs(
    means: Float[np.ndarray, "other own c"], solved: Bool[np.ndarray, "other own"]
) -> Float[np.ndarray, " c"]:
    """The standard error of the mean over all pairs of restarts: what those of the one and of the other cloud add.

    Args:
        means: by each pair.
        solved: which pairs are averaged over.
    """
    variance = np.zeros(means.shape[2])
    for axis in (0, 1):
        numbers = solved.sum(axis=axis)
        kept = (means * solved[..., None]).sum(axis=axis)[numbers > 0] / numbers[numbers > 0, None]
        variance += kept.var(axis=0, ddof=1) / len(kept)
    return np.sqrt(variance)
