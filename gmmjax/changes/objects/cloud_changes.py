"""The changes of one cloud as every detector returns them, and those of both clouds in one list."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes.change import Box, Change, Kind
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
    """

    probability: Float[np.ndarray, " n"]
    labels: Int[np.ndarray, " n"]
    items: list[Change]

    def none(self) -> "CloudChanges":
        """No changes of the same points."""
        return CloudChanges(np.zeros_like(self.probability), np.full_like(self.labels, -1), [])

    def with_confidence(self, confidence: float) -> "CloudChanges":
        """With all probabilities multiplied by a confidence."""
        items = [dataclasses.replace(change, probability=confidence * change.probability) for change in self.items]
        return CloudChanges(confidence * self.probability, self.labels, items)


def change_of(points: Float[np.ndarray, "n 3"], kind: Kind, probability: float, significance: float) -> Change:
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
    order = sorted(range(len(items)), key=lambda index: (-items[index].probability, -items[index].point_count))
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
