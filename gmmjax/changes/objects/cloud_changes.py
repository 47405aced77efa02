"""The changes of one cloud as every detector returns them, and those of both clouds in one list."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes.change import Box, Change, Kind, Reason, RejectedCandidate
from gmmjax.changes.explanation import Explanation
from gmmjax.mixtures import parameters_per_component
from gmmjax.pair import Pair

# Points of the smallest change: one more than the parameters of a Gaussian. With fewer its covariance is singular.
SMALLEST_CHANGE = parameters_per_component(3) + 1


class CloudChanges(NamedTuple):
    """The changes of one cloud.

    Attributes:
        probability: of each point, that it is changed.
        labels: per point -1 or the index into `items`.
        items: the changes of this cloud.
        rejected: what looked changed in it, and is no change.
    """

    probability: Float[np.ndarray, " n"]
    labels: Int[np.ndarray, " n"]
    items: list[Change]
    rejected: tuple[RejectedCandidate, ...] = ()

    def none(self) -> "CloudChanges":
        """No changes of the same points."""
        return CloudChanges(np.zeros_like(self.probability), np.full_like(self.labels, -1), [])

    def with_confidence(self, confidence: float) -> "CloudChanges":
        """With all probabilities multiplied by a confidence."""
        items = [dataclasses.replace(change, probability=confidence * change.probability) for change in self.items]
        rejected = tuple(dataclasses.replace(one, probability=confidence * one.probability) for one in self.rejected)
        return CloudChanges(confidence * self.probability, self.labels, items, rejected)


def change_of(
    points: Float[np.ndarray, "n 3"],
    kind: Kind,
    probability: float,
    significance: float,
    explanation: Explanation | None = None,
) -> Change:
    """The record of a change with these points: their mean, covariance and box."""
    mean = points.mean(axis=0)
    return Change(
        kind=kind,
        probability=probability,
        significance=float(significance),
        point_count=len(points),
        mean=mean,
        covariance=(points - mean).T @ (points - mean) / len(points),
        box=Box.around(points),
        explanation=explanation,
    )


def rejected_of(points: Float[np.ndarray, "n 3"], kind: Kind, explanation: Explanation) -> RejectedCandidate:
    """The record of a candidate with these points that is no change; the reason is the likelier one of the verdict."""
    reason: Reason = "not observed" if explanation.unobserved > explanation.unchanged else "unchanged"
    return RejectedCandidate(
        kind=kind,
        reason=reason,
        probability=explanation.changed,
        point_count=len(points),
        mean=points.mean(axis=0),
        box=Box.around(points),
        explanation=explanation,
    )


def merged(changes: Pair[CloudChanges]) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """The changes of both clouds in one list, most probable and then largest first, and the labels that refer to it."""
    after = changes.after.labels
    labels = Pair(changes.before.labels, np.where(after >= 0, after + len(changes.before.items), -1))
    return most_probable_first((*changes.before.items, *changes.after.items), labels)


def most_probable_first(
    items: tuple[Change, ...], labels: Pair[Int[np.ndarray, " _"]]
) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """The changes, most probable and then largest first, and the labels that refer to them.

    Args:
        items: the changes of both clouds.
        labels: of either cloud, per point -1 or an index into them.
    """
    order = sorted(range(len(items)), key=lambda index: _rank(items[index]))
    return reordered(items, labels, order)


def reordered(
    items: tuple[Change, ...], labels: Pair[Int[np.ndarray, " _"]], order: Sequence[int]
) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
    """The changes in another order, or some of them; labels and partners follow, those of a change left out are none.

    Args:
        items: the changes of both clouds.
        labels: of either cloud, per point -1 or an index into them.
        order: indices of the changes that are kept.
    """
    # One more entry, so that the label -1 stays -1.
    place = np.full(len(items) + 1, -1)
    place[list(order)] = np.arange(len(order))
    kept = (items[index] for index in order)
    followed = tuple(
        item if item.partner is None else dataclasses.replace(item, partner=int(place[item.partner])) for item in kept
    )
    return followed, labels.map(lambda own: place[own])


def merged_rejected(changes: Pair[CloudChanges]) -> tuple[RejectedCandidate, ...]:
    """The rejected candidates of both clouds in one list, most probable and then largest first."""
    return tuple(sorted(changes.before.rejected + changes.after.rejected, key=_rank))


def _rank(found: Change | RejectedCandidate) -> tuple[float, int]:
    return -found.probability, -found.point_count
