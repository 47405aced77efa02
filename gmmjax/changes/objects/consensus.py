"""From the votes of all pairs of restarts to the changes of a cloud."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax._host import padded_chunks
from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.changes.change import Kind
from gmmjax.changes.fit.restart_values import ALL, RestartValues, Rows
from gmmjax.changes.objects.cloud_changes import SMALLEST_CHANGE, CloudChanges, change_of
from gmmjax.mixtures import GaussianMixture

# Points that are labelled in one pass, padded to it: one compiled shape for clouds of every size.
CHUNK = 16384


def cloud_consensus(
    points: Float[np.ndarray, "n 3"],
    mixtures: GaussianMixture,
    votes: Float[np.ndarray, "r k"],
    significance: Float[np.ndarray, "r k"],
    reference: int,
    kind: Kind,
    threshold: float,
) -> CloudChanges:
    """Averages the votes point by point; the Gaussians of one restart, the reference, separate the changes.

    A Gaussian of the reference is a change when its points' mean probability reaches the threshold; the change consists
    of those of its points that reach it themselves.

    Args:
        points: all points of the cloud.
        mixtures: the cloud's mixtures, with a leading axis of r restarts.
        votes: for each restart and Gaussian the fraction of the other cloud's restarts by which it changed.
        significance: of each Gaussian, as of `Change`.
        reference: the restart with the shortest message length.
        kind: what a change of this cloud is.
        threshold: probability from which a point or a Gaussian is changed.

    Returns:
        The changes; the probability of a point is the mean vote for its Gaussian over all pairs of restarts.
    """
    components = component_labels(points, mixtures)
    probability = sum(vote[own] for vote, own in zip(votes, components.each(), strict=True)) / components.restarts
    own = components.of(reference, ALL)
    counts = np.bincount(own, minlength=votes.shape[1])
    mean_probability = np.bincount(own, probability, votes.shape[1]) / np.maximum(counts, 1)
    consensus = CloudChanges(probability, np.full(len(points), -1), [])
    for component in np.flatnonzero(mean_probability >= threshold):
        members = (own == component) & (probability >= threshold)
        if members.sum() < SMALLEST_CHANGE:
            continue
        consensus.labels[members] = len(consensus.items)
        vote = float(probability[members].mean())
        change = change_of(points[members], kind, vote, significance[reference, component])
        mean, covariance = mixtures.means[reference, component], mixtures.covariances[reference, component]
        consensus.items.append(dataclasses.replace(change, mean=np.asarray(mean), covariance=np.asarray(covariance)))
    return consensus


def component_labels(points: Float[np.ndarray, "n 3"], mixtures: GaussianMixture) -> RestartValues:
    """The slot of the most probable Gaussian of each point, for each restart; in float64, chunk by chunk.

    Args:
        points: of one cloud.
        mixtures: of the cloud, with a leading axis of restarts.
    """
    return RestartValues(len(mixtures.weights), functools.partial(_labels_at, points, mixtures))


def _labels_at(
    points: Float[np.ndarray, "n 3"], mixtures: GaussianMixture, restart: int, rows: Rows
) -> Int[np.ndarray, " m"]:
    # Relative to one point of the cloud, which it also is padded with.
    origin = points[0]
    chosen = points[rows] - origin
    with jax.enable_x64(True):
        mixture = jax.tree.map(lambda leaf: jnp.asarray(leaf[restart]), mixtures).rescaled(1.0, -origin)
        chunks = padded_chunks(chosen, CHUNK)
        labels = [np.asarray(_chunk_labels(mixture, chunk)) for chunk in chunks]
    return np.concatenate(labels)[: len(chosen)]


@lru_jit
def _chunk_labels(mixture: GaussianMixture, chunk: Float[Array, "c 3"]) -> Int[Array, " c"]:
    return mixture.labels(chunk).astype(jnp.int32)


def votes_of_pairs(
    changed: Bool[np.ndarray, "other own k"], valid: Bool[np.ndarray, "other own"]
) -> Float[np.ndarray, "own k"]:
    """The fraction of the other cloud's restarts by which each Gaussian changed, over the pairs that were solved."""
    solved = np.maximum(valid.sum(axis=0), 1)[:, None]
    return (changed & valid[..., None]).sum(axis=0) / solved
