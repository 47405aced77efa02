"""The verdict's parameters with the greatest posterior: few candidates, and a prior about the shipped parameters."""

import dataclasses
from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize

from gmmjax._programs import kept_jit
from gmmjax._typing import Array
from gmmjax.changes import FACTS, Verdict
from gmmjax.errors import ComputationError
from gmmjax.learning import CHANGED, bounds_of, free_from, log_likelihood, signed

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


def tuned_verdict(start: Verdict, rows: WeightedRows, draw: float) -> Verdict:
    r"""The verdict with the greatest posterior, by gradient (L-BFGS-B, whose bounds are the signs of the facts).

    It maximises the log likelihood of the candidates less `draw` / 2 times the squared distance of weights and biases
    from the start's: each is drawn towards it as if by `draw` candidates. With changes among the candidates all
    parameters move, and the range of the facts that count as learned widens to theirs. Without, where every candidate
    is known to be no change, the probability of a change only falls, for whatever facts: nothing could tell by how much
    it may rise.

    Args:
        start: that the parameters are drawn towards.
        rows: the candidates.
        draw: towards the start; infinite: the result is the start.

    Raises:
        ComputationError: the optimiser found no finite parameters.
    """
    if np.isinf(draw) or not (rows.weight > 0).any():
        return start
    rows = rows.padded()
    used = rows.weight > 0
    with jax.enable_x64(True):
        if (rows.kind[used] == CHANGED).any():
            return _moved(_widened(start, rows.facts[used]), rows, draw)
        return _lowered(start, rows, draw)


def _widened(start: Verdict, facts: Float[np.ndarray, "n f"]) -> Verdict:
    """With a learned range that these candidates lie in."""
    lower, upper = np.minimum(start.lower, facts.min(axis=0)), np.maximum(start.upper, facts.max(axis=0))
    return dataclasses.replace(start, lower=lower, upper=upper)


def _moved(start: Verdict, rows: WeightedRows, draw: float) -> Verdict:
    """All parameters moved, within the signs of the facts."""
    signs = _signs(start)
    own = [start.weights, start.bias, standardised(start, rows.facts), rows.kind, rows.weight, signs, np.asarray(draw)]
    best, arguments = _best(_moved_gradient, free_from(start.weights, start.bias, signs), bounds_of(signs), own)
    weights, bias = signed(best, arguments[5])
    return dataclasses.replace(start, weights=np.asarray(weights), bias=np.asarray(bias))


def _lowered(start: Verdict, rows: WeightedRows, draw: float) -> Verdict:
    """The log odds of changed moved so that they rise nowhere within the learned range; the other ones stay."""
    edges = standardised(start, np.stack([start.lower, start.upper]))
    own = [start.weights, start.bias, standardised(start, rows.facts), rows.kind, rows.weight, edges, np.asarray(draw)]
    bounds: list[tuple[float | None, float | None]] = [(0.0, most) for most in (*_most_lowered(start), None)]
    best, arguments = _best(_lowered_gradient, np.zeros(len(bounds)), bounds, own)
    weights, bias = lowered(best, arguments[0], arguments[1], arguments[5])
    return dataclasses.replace(start, weights=np.asarray(weights), bias=np.asarray(bias))


def moved_loss(
    free: Float[Array, " p"],
    start_weights: Float[Array, "2 f"],
    start_bias: Float[Array, " 2"],
    facts: Float[Array, "n f"],
    kind: Int[Array, " n"],
    weight: Float[Array, " n"],
    signs: Float[Array, " f"],
    draw: Float[Array, ""],
) -> Float[Array, ""]:
    """The negative log posterior of all parameters, nats, but for a constant.

    Args:
        free: the parameters, see `signed`.
        start_weights: that the weights are drawn towards.
        start_bias: that the biases are drawn towards.
        facts: of the candidates, standardised.
        kind: of the candidates.
        weight: of the candidates.
        signs: of the facts.
        draw: how strongly.
    """
    weights, bias = signed(free, signs)
    apart = jnp.sum((weights - start_weights) ** 2) + jnp.sum((bias - start_bias) ** 2)
    return draw / 2 * apart - log_likelihood(weights, bias, facts, kind, weight)


def lowered(
    free: Float[Array, " p"],
    start_weights: Float[Array, "2 f"],
    start_bias: Float[Array, " 2"],
    edges: Float[Array, "2 f"],
) -> tuple[Float[Array, "2 f"], Float[Array, " 2"]]:
    """Weights and biases by which the log odds of changed are lower than the start's, wherever in the learned range.

    Args:
        free: at least 0: by how much they fall with each fact above its lower edge, below its upper edge, and
            everywhere.
        start_weights: of the start.
        start_bias: of the start.
        edges: of the learned range, standardised.
    """
    above, below = free[:-1].reshape(2, -1)
    steps = jnp.stack([below - above, jnp.zeros_like(below)])
    fall = jnp.sum(above * edges[0] - below * edges[1]) - free[-1]
    return start_weights + steps, start_bias + jnp.stack([fall, jnp.zeros_like(fall)])


def lowered_loss(
    free: Float[Array, " p"],
    start_weights: Float[Array, "2 f"],
    start_bias: Float[Array, " 2"],
    facts: Float[Array, "n f"],
    kind: Int[Array, " n"],
    weight: Float[Array, " n"],
    edges: Float[Array, "2 f"],
    draw: Float[Array, ""],
) -> Float[Array, ""]:
    """The negative log posterior of `lowered` parameters, nats, but for a constant; arguments as of `moved_loss`."""
    weights, bias = lowered(free, start_weights, start_bias, edges)
    return draw / 2 * jnp.sum(free**2) - log_likelihood(weights, bias, facts, kind, weight)


def standardised(verdict: Verdict, facts: Float[np.ndarray, "n f"]) -> Float[np.ndarray, "n f"]:
    """The facts as the weights multiply them."""
    return np.asarray((np.clip(facts, verdict.lower, verdict.upper) - verdict.centre) / verdict.spread)


def _signs(verdict: Verdict) -> Float[np.ndarray, " f"]:
    return np.array([float(FACTS[name].change) for name in verdict.names])


def _most_lowered(start: Verdict) -> list[float | None]:
    """By how much the weight of each fact for changed may fall, then rise, before its sign is wrong; None: by any."""
    changed, unobserved = np.asarray(start.weights)
    falls = np.maximum(changed - np.maximum(unobserved, 0), 0)
    rises = np.maximum(np.minimum(unobserved, 0) - changed, 0)
    signs = _signs(start)
    may_fall = [float(own) if sign > 0 else None for own, sign in zip(falls, signs, strict=True)]
    return may_fall + [float(own) if sign < 0 else None for own, sign in zip(rises, signs, strict=True)]


_moved_gradient = kept_jit(jax.value_and_grad(moved_loss))
_lowered_gradient = kept_jit(jax.value_and_grad(lowered_loss))


def _best(
    gradient: Callable[..., tuple[Array, Array]],
    first: Float[np.ndarray, " p"],
    bounds: list[tuple[float | None, float | None]],
    own: list[np.ndarray],
) -> tuple[Float[Array, " p"], list[Array]]:
    """The free numbers with the least loss, and the loss's other arguments as arrays of JAX."""
    arguments = [jnp.asarray(argument) for argument in own]

    def objective(free: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = gradient(jnp.asarray(free), *arguments)
        return float(value), np.asarray(slope)

    found = minimize(objective, first, jac=True, bounds=bounds, method="L-BFGS-B")
    if not (np.isfinite(found.x).all() and np.isfinite(found.fun)):
        raise ComputationError(f"tuning the verdict ended in numbers that are not finite: {found.message}")
    return jnp.asarray(found.x), arguments
