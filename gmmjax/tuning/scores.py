"""Differentiable scores of answers: how good probabilities of change are, and how well a mixture foretells points."""

import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._host import float64_on_host
from gmmjax._typing import Array
from gmmjax.mixtures import GaussianMixture

# Probabilities are kept this far from 0 and 1, so that one wrong point costs no more than 14 nats.
MIN_PROBABILITY = 1e-6
# Points that are added to both sides of an expected F1, so that it is defined where nothing changed.
SMOOTHING = 1.0


def brier_score(
    probability: Float[Array, " n"], changed: Float[Array, " n"], weight: Float[Array, " n"] | None = None
) -> Float[Array, ""]:
    """Mean squared difference of probability and truth (Brier 1950): 0 is best. A proper score.

    Args:
        probability: of each point, that it changed.
        changed: 1 where it did, else 0.
        weight: of each point; default 1.
    """
    return _mean((probability - changed) ** 2, weight)


def log_score(
    probability: Float[Array, " n"], changed: Float[Array, " n"], weight: Float[Array, " n"] | None = None
) -> Float[Array, ""]:
    """Mean negative logarithm of the probability that was given to the truth, nats: 0 is best. A proper score.

    Arguments as in `brier_score`.
    """
    safe = jnp.clip(probability, MIN_PROBABILITY, 1 - MIN_PROBABILITY)
    return -_mean(changed * jnp.log(safe) + (1 - changed) * jnp.log1p(-safe), weight)


def expected_f1(
    probability: Float[Array, " n"], changed: Float[Array, " n"], weight: Float[Array, " n"] | None = None
) -> Float[Array, ""]:
    r"""F1 of points that are labelled with these probabilities: $2 \sum p y / (\sum p + \sum y)$; 1 is best.

    Arguments as in `brier_score`. One point more, found, is counted on both sides.
    """
    found, both = expected_counts(probability, changed, weight)
    return found / both


def expected_counts(
    probability: Float[Array, " n"], changed: Float[Array, " n"], weight: Float[Array, " n"] | None = None
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Numerator and denominator of `expected_f1`, to be added over scenes before they are divided."""
    weight = jnp.ones_like(probability) if weight is None else weight
    found = jnp.sum(weight * probability * changed)
    both = jnp.sum(weight * (probability + changed))
    return 2 * found + SMOOTHING, both + SMOOTHING


@float64_on_host
def held_out_log_likelihood(
    mixture: GaussianMixture, points: Float[Array, "n d"], mass: Float[Array, " n"] | None = None
) -> Float[Array, ""]:
    """Mean log density, nats an observation, of points that the mixture was not fitted to.

    Args:
        mixture: such as of `fit_mixture`, whose NumPy leaves are computed with in float64.
        points: in the unit of the mixture.
        mass: observations that each point stands for; default 1.
    """
    return _mean(mixture.log_density(points), mass)


def _mean(values: Float[Array, " n"], weight: Float[Array, " n"] | None) -> Float[Array, ""]:
    if weight is None:
        return jnp.mean(values)
    # Nothing to score is a score of 0.
    return jnp.sum(weight * values) / jnp.maximum(jnp.sum(weight), MIN_PROBABILITY)
