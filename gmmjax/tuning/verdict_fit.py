"""The verdict's parameters with the greatest posterior: few candidates, and a prior about the shipped parameters.

The prior is about what the verdict says, not only about its numbers: a change of the bias by 1 turns many verdicts,
a change of most weights by 1 few. It remembers candidates like those that the shipped parameters were learned from.
"""

import dataclasses
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize

from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.changes import Verdict
from gmmjax.errors import ComputationError
from gmmjax.learning import bounds_of, free_from, log_likelihood, log_probabilities, signed

# Candidates are padded to multiples of this number. Results do not depend on it.
BLOCK = 64


class WeightedRows(NamedTuple):
    """Candidates whose truth is known.

    Attributes:
        facts: of each, as the verdict sees them.
        kind: what each is: `CHANGED`, `UNOBSERVED`, `UNCHANGED` or `NOT_CHANGED`.
        weight: how many candidates each stands for; 0 is one that is not looked at.
    """

    facts: Float[np.ndarray, "n f"]
    kind: Int[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]

    def without(self, which: Bool[np.ndarray, " n"]) -> "WeightedRows":
        """Without some of the candidates: they have no weight."""
        return self._replace(weight=np.where(which, 0.0, self.weight))

    def padded(self) -> "WeightedRows":
        """With candidates of no weight up to a multiple of `BLOCK`, so that few shapes are compiled."""
        return WeightedRows(padded_rows(self.facts), padded_rows(self.kind), padded_rows(self.weight, "constant"))


def padded_rows(values: np.ndarray, mode: Literal["edge", "constant"] = "edge") -> np.ndarray:
    """Rows up to a multiple of `BLOCK`: the last one again, or zeros."""
    return np.pad(values, [(0, -len(values) % BLOCK)] + [(0, 0)] * (values.ndim - 1), mode=mode)


def tuned_verdict(start: Verdict, rows: WeightedRows, draw: float, remembered: int = 512) -> Verdict:
    """The verdict with the greatest posterior, by gradient (L-BFGS-B, whose bounds are the signs of the facts).

    See `negative_log_posterior`. The range of the facts that count as learned widens to those of the candidates.

    Args:
        start: that the parameters are drawn towards.
        rows: the candidates.
        draw: how strongly, in candidates; infinite: the result is the start.
        remembered: number of candidates that the draw is averaged over.

    Raises:
        ComputationError: the optimiser found no finite parameters.
    """
    used = rows.weight > 0
    if np.isinf(draw) or not used.any():
        return start
    widened = _widened(start, rows.facts[used])
    signs = start.signs
    padded = rows.padded()
    with jax.enable_x64(True):
        own = [start.weights, start.bias, jax.vmap(widened.columns)(padded.facts), padded.kind, padded.weight, signs]
        arguments = [
            jnp.asarray(part) for part in (*own, jax.vmap(start.columns)(remembered_facts(start, remembered)), draw)
        ]

        def objective(free: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradient = _gradient(jnp.asarray(free), *arguments)
            return float(value), np.asarray(gradient)

        first = free_from(start.weights, start.bias, signs)
        found = minimize(objective, first, jac=True, bounds=bounds_of(signs), method="L-BFGS-B")
        if not (np.isfinite(found.x).all() and np.isfinite(found.fun)):
            raise ComputationError(f"tuning the verdict ended in numbers that are not finite: {found.message}")
        weights, bias = signed(jnp.asarray(found.x), jnp.asarray(signs))
    return dataclasses.replace(widened, weights=np.asarray(weights), bias=np.asarray(bias))


def negative_log_posterior(
    free: Float[Array, " p"],
    start_weights: Float[Array, "2 c"],
    start_bias: Float[Array, " 2"],
    columns: Float[Array, "n c"],
    kind: Int[Array, " n"],
    weight: Float[Array, " n"],
    signs: Float[Array, " c"],
    remembered: Float[Array, "m c"],
    draw: Float[Array, ""],
) -> Float[Array, ""]:
    """The negative log posterior of the parameters, nats, but for a constant.

    It is less the log likelihood of the candidates, plus two terms that draw towards the start: `draw` times the mean
    relative entropy of the start's probabilities for the remembered candidates, as if so many of them had been judged
    by it; and half the squared distance from its weights and biases, a Gaussian prior of unit standard deviation.

    Args:
        free: the parameters, see `signed`.
        start_weights: of the start.
        start_bias: of the start.
        columns: of the candidates, what the weights multiply.
        kind: of the candidates.
        weight: of the candidates.
        signs: of the columns.
        remembered: the same of the remembered candidates.
        draw: how strong the draw is, in candidates.
    """
    weights, bias = signed(free, signs)
    before = log_probabilities(start_weights, start_bias, remembered)
    after = log_probabilities(weights, bias, remembered)
    forgotten = jnp.mean(jnp.sum(jnp.exp(before) * (before - after), axis=1))
    apart = jnp.sum((weights - start_weights) ** 2) + jnp.sum((bias - start_bias) ** 2)
    return draw * forgotten + apart / 2 - log_likelihood(weights, bias, columns, kind, weight)


_gradient = lru_jit(jax.value_and_grad(negative_log_posterior))


def remembered_facts(start: Verdict, number: int) -> Float[np.ndarray, "m f"]:
    """Facts like those that the verdict was learned from, by their mean and spread."""
    normal = np.random.default_rng(0).standard_normal((number, len(start.names)))
    return np.asarray(start.centre + start.spread * normal)


def _widened(start: Verdict, facts: Float[np.ndarray, "n f"]) -> Verdict:
    """With a learned range that these candidates lie in."""
    lower, upper = np.minimum(start.lower, facts.min(axis=0)), np.maximum(start.upper, facts.max(axis=0))
    return dataclasses.replace(start, lower=lower, upper=upper)
