"""The average over any number of restarts: how sure it is, and how it converges."""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gmmjax.changes.fit.restart_fits import RestartFits
from gmmjax.changes.record import Changes


class Doubling(NamedTuple):
    """The differences that more restarts made.

    Attributes:
        restarts: number of them after the doubling.
        difference: of the probabilities before and after it, see `largest_difference`.
    """

    restarts: int
    difference: float


@dataclasses.dataclass(frozen=True, eq=False)
class Consensus:
    """The changes, averaged over restarts, with all that is needed to add more of them.

    Attributes:
        changes: the record, as a detection with as many restarts gives it.
        restarts: that it is the average of.
        fits: of all restarts that were computed so far, which may be more than the record is the average of.
        standard_errors: of each change: of the mean over its points of the probability that they look changed, the
            standard error over the restarts. None with a single restart.
        settled: whether the probabilities have settled; None: nobody asked.
        convergence: what each doubling of the restarts changed; () where nobody asked.
    """

    changes: Changes
    restarts: int
    fits: RestartFits
    standard_errors: tuple[float | None, ...]
    settled: bool | None = None
    convergence: tuple[Doubling, ...] = ()


def doublings(most: int) -> Iterator[int]:
    """Numbers of restarts after which the probabilities are compared: 2, 4, 8, ..., and the last one.

    Args:
        most: the last one.
    """
    yield from itertools.takewhile(lambda count: count < most, (2**power for power in itertools.count(1)))
    yield most


def largest_difference(earlier: Changes, later: Changes) -> float:
    """The largest difference between the probabilities of two detections of one pair of clouds.

    For each change of either record, the mean over its points of the absolute difference of their probabilities; of
    these the largest. 0 where neither has a change.

    Args:
        earlier: of fewer restarts.
        later: of more.
    """
    differences = np.abs(_probabilities(earlier) - _probabilities(later))
    return max((_largest_mean(differences, changes) for changes in (earlier, later)), default=0.0)


def _largest_mean(differences: np.ndarray, changes: Changes) -> float:
    labels = np.concatenate([changes.labels_before, changes.labels_after])
    inside = labels >= 0
    counts = np.bincount(labels[inside], minlength=1)
    means = np.bincount(labels[inside], differences[inside], minlength=1) / np.maximum(counts, 1)
    return float(means.max())


def _probabilities(changes: Changes) -> np.ndarray:
    return np.concatenate([changes.probability_before, changes.probability_after])
