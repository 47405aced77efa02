"""The loss of one pair as a function of the tuned settings, with its gradient through the fit."""

import functools
from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PRNGKeyArray

from gmmjax._typing import Array
from gmmjax.changes import JointFitSettings
from gmmjax.comparison import (
    JointMixture,
    component_posterior,
    density_ratio,
    fit_joint_mixture_from_seeds,
    log_joint,
    point_posterior,
)
from gmmjax.mixtures import Prior
from gmmjax.tuning.parameters import with_free_values
from gmmjax.tuning.scan_pairs import ReadyPair
from gmmjax.tuning.scores import brier_score, expected_counts, log_score

Loss = Literal["f1", "brier", "log", "likelihood"]
LOSSES: tuple[Loss, ...] = get_args(Loss)
# Of labelled pairs, and of pairs without labels.
LABELLED, UNLABELLED = LOSSES[:3], LOSSES[3:]
DESCRIPTIONS: Mapping[Loss, str] = {
    "f1": "1 - expected F1 of the points",
    "brier": "Brier score of the points' probabilities",
    "log": "log score of the points' probabilities, nats",
    "likelihood": "negative log likelihood of held-out points, nats a point",
}
# The weight of all points of a pair together.
WEIGHT_OF_A_PAIR = 1000.0


class PairLoss(NamedTuple):
    """The part of one pair in the loss; parts are added over pairs before they are divided (`total_loss`).

    Attributes:
        sums: numerator and denominator.
        message_length: of the fit, nats; it says which of several random starts found the best mixture.
        gradients: of both sums, with respect to the free numbers; NaN where the fit did not come to rest. None where
            they were not asked for.
    """

    sums: Float[Array, " 2"]
    message_length: Float[Array, ""]
    gradients: Float[Array, "2 p"] | None = None


@functools.partial(jax.jit, static_argnames=("names", "loss"))
def pair_loss(
    free: Float[Array, " p"], pair: ReadyPair, key: PRNGKeyArray, names: tuple[str, ...], loss: Loss
) -> PairLoss:
    """The part of a pair in the loss, and its gradients.

    Args:
        free: the settings, see `with_free_values`.
        pair: made ready.
        key: of the fit's start.
        names: of the settings.
        loss: which.
    """

    def of(free: Array) -> tuple[Array, PairLoss]:
        part = _part(with_free_values(pair.prior, names, free), pair, key, loss)
        return part.sums, part

    gradients, part = jax.jacrev(of, has_aux=True)(free)
    return part._replace(gradients=gradients)


def pair_loss_alone(
    free: Float[Array, " p"], pair: ReadyPair, key: PRNGKeyArray, names: tuple[str, ...], loss: Loss
) -> PairLoss:
    """`pair_loss` without the gradients."""
    prior = with_free_values(pair.prior, names, jnp.asarray(free))
    # As arrays of one type, the settings have one program whichever of them are tuned, none of them too.
    return _compiled_part(jax.tree.map(lambda leaf: jnp.asarray(leaf, free.dtype), prior), pair, key, loss)


def total_loss(sums: Float[np.ndarray, "n 2"], loss: Loss) -> float:
    """The loss of some pairs."""
    numerator, denominator = sums.sum(axis=0)
    return float(1 - numerator / denominator if loss == "f1" else numerator / denominator)


def total_gradient(
    sums: Float[np.ndarray, "n 2"], gradients: Float[np.ndarray, "n 2 p"], loss: Loss
) -> Float[np.ndarray, " p"]:
    """The gradient of `total_loss`."""
    numerator, denominator = sums.sum(axis=0)
    of_numerator, of_denominator = gradients.sum(axis=0)
    quotient = (of_numerator - numerator / denominator * of_denominator) / denominator
    return np.asarray(-quotient if loss == "f1" else quotient)


def _part(prior: Prior, pair: ReadyPair, key: PRNGKeyArray, loss: Loss) -> PairLoss:
    framed = pair.frame.enter_prior(prior)
    end = fit_joint_mixture_from_seeds(pair.fitted, pair.max_components, framed, key, JointFitSettings().at_rest)
    return PairLoss(_sums(end.mixture, pair, loss), end.message_length)


_compiled_part = jax.jit(_part, static_argnames="loss")


def _sums(joint: JointMixture, pair: ReadyPair, loss: Loss) -> Float[Array, " 2"]:
    weight = jnp.concatenate([pair.before.weight, pair.after.weight])
    # Every pair counts the same, however many points it has.
    weight = WEIGHT_OF_A_PAIR * weight / jnp.sum(weight)
    if loss == "likelihood":
        rows = [log_joint(joint, pair.before.points, after=False), log_joint(joint, pair.after.points, after=True)]
        return jnp.stack([-weight @ jax.nn.logsumexp(jnp.concatenate(rows, axis=1), axis=0), jnp.sum(weight)])
    probability = _probabilities(joint, pair)
    changed = jnp.concatenate([pair.before.changed, pair.after.changed])
    if loss == "f1":
        found, both = expected_counts(probability, changed, weight)
        return jnp.stack([found, both])
    score = brier_score if loss == "brier" else log_score
    return jnp.stack([score(probability, changed, weight) * jnp.sum(weight), jnp.sum(weight)])


def _probabilities(joint: JointMixture, pair: ReadyPair) -> Float[Array, " n"]:
    """The posterior that each point changed, of both clouds; that its component did, where clouds fill volumes."""
    ratio = density_ratio(joint)
    clouds = ((pair.before.points, False), (pair.after.points, True))
    if pair.volumetric:
        return jnp.concatenate([component_posterior(joint, ratio, *cloud).sum(axis=0) for cloud in clouds])
    return jnp.concatenate([point_posterior(joint, ratio, *cloud) for cloud in clouds])
