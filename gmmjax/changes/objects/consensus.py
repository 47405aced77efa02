"""From the votes of all pairs of restarts to probabilities, labels and a list of changes."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax._programs import kept_jit
from gmmjax._typing import Array
from gmmjax.changes.change import Box, Change, Kind
from gmmjax.mixtures import GaussianMixture, parameters_per_component
from gmmjax.pair import Pair

# Points labelled in one pass: one compiled shape for clouds of every size.
CHUNK = 16384
SMALLEST_CHANGE = parameters_per_component(3) + 1


class CloudChanges(NamedTuple):
    """The changes of one cloud.

    Attributes:
        probability: per point, the mean over all pairs of restarts of the vote of its Gaussian.
        labels: per point -1 or the index into `items`.
        items: the changes of this cloud.
    """

    probability: Float[np.ndarray, " n"]
    labels: Int[np.ndarray, " n"]
    items: list[Change]

    def none(self) -> "CloudChanges":
        """No changes of the same points."""
        return CloudChanges(np.zeros_like(self.probability), np.full_like(self.labels, -1), [])

    def believed(self, confidence: float) -> "CloudChanges":
        """With all probabilities multiplied by a confidence."""
        items = [dataclasses.replace(change, probability=confidence * change.probability) for change in self.items]
        return CloudChanges(confidence * self.probability, self.labels, items)


def cloud_consensus(
    points: Float[np.ndarray, "n 3"],
    mixtures: GaussianMixture,
    votes: Float[np.ndarray, "r k"],
    significance: Float[np.ndarray, "r k"],
    reference: int,
    kind: Kind,
    threshold: float,
) -> CloudChanges:
    """Averages the votes point by point; the Gaussians of one restart, the reference, tell the changes apart.

    A Gaussian of the reference is a change when its points' mean probability reaches the threshold; the change consists
    of those of its points that reach it themselves.

    Args:
        points: all points of the cloud.
        mixtures: the cloud's mixtures, with a leading axis of r restarts.
        votes: for each restart and Gaussian the share of the other cloud's restarts by which it changed.
        significance: of each Gaussian, as of `Change`.
        reference: the restart with the shortest message length.
        kind: what a change of this cloud is.
        threshold: probability from which on a point or a Gaussian counts as changed.
    """
    components = component_labels(points, mixtures)
    probability = np.mean([vote[component] for vote, component in zip(votes, components, strict=True)], axis=0)
    own = components[reference]
    counts = np.bincount(own, minlength=votes.shape[1])
    mean_probability = np.bincount(own, probability, votes.shape[1]) / np.maximum(counts, 1)
    labels = np.full(len(points), -1)
    items: list[Change] = []
    for component in np.flatnonzero(mean_probability >= threshold):
        members = (own == component) & (probability >= threshold)
        if members.sum() < SMALLEST_CHANGE:
            continue
        labels[members] = len(items)
        vote = float(probability[members].mean())
        change = change_of(points[members], kind, vote, significance[reference, component])
        gaussian = mixtures.means[reference, component], mixtures.covariances[reference, component]
        items.append(dataclasses.replace(change, mean=np.asarray(gaussian[0]), covariance=np.asarray(gaussian[1])))
    return CloudChanges(probability, labels, items)


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
    items = changes.before.items + changes.after.items
    order = sorted(range(len(items)), key=lambda index: (-items[index].probability, -items[index].point_count))
    # One more entry, so that the label -1 stays -1.
    place = np.full(len(items) + 1, -1)
    place[order] = np.arange(len(items))
    after = changes.after.labels
    shifted = np.where(after >= 0, after + len(changes.before.items), -1)
    return tuple(items[index] for index in order), Pair(place[changes.before.labels], place[shifted])


def component_labels(points: Float[np.ndarray, "n 3"], mixtures: GaussianMixture) -> Int[np.ndarray, "r n"]:
    """The slot of the most probable Gaussian of each point, for each restart; in float64, chunk by chunk."""
    # Relative to one point of the cloud, which it also is padded with.
    origin = points[0]
    shifted = jax.vmap(lambda mixture: mixture.rescaled(1.0, -origin))
    padded = np.pad(points - origin, ((0, -len(points) % CHUNK), (0, 0)))
    with jax.enable_x64(True):
        local = shifted(jax.tree.map(jnp.asarray, mixtures))
        chunks = [np.asarray(_chunk_labels(local, chunk)) for chunk in np.split(padded, len(padded) // CHUNK)]
    return np.concatenate(chunks, axis=1)[:, : len(points)]


@kept_jit
def _chunk_labels(mixtures: GaussianMixture, chunk: Float[Array, "c 3"]) -> Int[Array, "r c"]:
    # One restart after the other: all at once would leave the caches.
    return jax.lax.map(lambda mixture: mixture.labels(chunk).astype(jnp.int32), mixtures)


def votes_of_pairs(
    changed: Bool[np.ndarray, "other own k"], valid: Bool[np.ndarray, "other own"]
) -> Float[np.ndarray, "own k"]:
    """The share of the other cloud's restarts by which each Gaussian changed, over the pairs that were solved."""
    solved = np.maximum(valid.sum(axis=0), 1)[:, None]
    return (changed & valid[..., None]).sum(axis=0) / solved
