"""The objective of learning and tuning the verdict: the log likelihood of candidates whose truth is known."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from gmmjax._typing import Array


def log_probabilities(
    weights: Float[Array, "2 c"], bias: Float[Array, " 2"], columns: Float[Array, "n c"]
) -> Float[Array, "n 3"]:
    """Log probabilities of changed, not observed and unchanged; arguments as of `log_likelihood`."""
    odds = columns @ weights.T + bias[None]
    return jax.nn.log_softmax(jnp.concatenate([odds, jnp.zeros_like(odds[:, :1])], axis=1), axis=1)


def log_likelihood(
    weights: Float[Array, "2 c"],
    bias: Float[Array, " 2"],
    columns: Float[Array, "n c"],
    kind: Int[Array, " n"],
    weight: Float[Array, " n"],
) -> Float[Array, ""]:
    """The weighted log likelihood of what the candidates are, nats.

    Args:
        weights: of each column in the log odds of changed, and of not observed, each against unchanged.
        bias: of both log odds.
        columns: of each candidate what the weights multiply, see `Verdict.columns`.
        kind: `CHANGED`, `UNOBSERVED`, `UNCHANGED` or `NOT_CHANGED`.
        weight: how many candidates each stands for; 0 is one that is not looked at.
    """
    logs = log_probabilities(weights, bias, columns)
    not_changed = jnp.logaddexp(logs[:, 1], logs[:, 2])
    kinds = jnp.concatenate([logs, not_changed[:, None]], axis=1)
    return weight @ jnp.take_along_axis(kinds, kind[:, None], axis=1)[:, 0]


def signed(free: Float[Array, " p"], signs: Float[Array, " c"]) -> tuple[Float[Array, "2 c"], Float[Array, " 2"]]:
    """The weights and the bias: where a column has a sign, it never speaks more for unobserved than for changed.

    Args:
        free: for each column two numbers, which `bounds_of` bounds where it has a sign, and both biases.
        signs: of the columns: 1 where more can only speak for a change, -1 only against one, 0 where it depends.
    """
    changed, second = free[:-2].reshape(2, -1)
    with_sign = jnp.stack([signs * changed, signs * (changed - second)])
    return jnp.where(signs[None] == 0, jnp.stack([changed, second]), with_sign), free[-2:]


def free_from(
    weights: Float[np.ndarray, "2 c"], bias: Float[np.ndarray, " 2"], signs: Float[np.ndarray, " c"]
) -> Float[np.ndarray, " p"]:
    """The inverse of `signed`; weights against their sign, by the rounding of a file, are 0."""
    first, second = weights
    with_sign = np.maximum(np.stack([signs * first, signs * (first - second)]), 0.0)
    return np.concatenate([np.where(signs == 0, weights, with_sign).ravel(), bias])


def bounds_of(signs: Float[np.ndarray, " c"]) -> list[tuple[float | None, float | None]]:
    """The bounds of the numbers that `signed` takes, by which the signs hold."""
    # Of a column with a sign the changed side is bounded, and so is what it has beyond the unobserved side.
    least = [*(0.0 if sign else None for sign in np.tile(signs, 2)), None, None]
    return [(own, None) for own in least]
