"""The verdict on a candidate: changed, unchanged or not observed, from its facts.

A multinomial logistic model, additive in about forty facts, so that what each adds to the log odds can be told. Of each
fact it is a line that may bend once: the first points in free space tell more than the last. Where physics says that a
fact can only speak for a change, or only against one, both slopes have that sign.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.changes.evidence.facts import FACTS
from gmmjax.changes.explanation import Contribution, Explanation

# Candidates are judged in blocks of this number, so that few shapes are compiled. Results do not depend on it.
BLOCK = 64


class Verdict(eqx.Module):
    """The parameters of the model. Facts are those of `FACTS`, on their scales.

    Attributes:
        names: of the facts, in their order.
        weights: slopes in the log odds of changed, and of not observed, each against unchanged: first those of each
            fact below its bend, then those of each above it.
        bias: of both log odds.
        bend: of each fact, where its slope may change.
        centre: of each fact, the mean over the candidates that the weights were learned from.
        spread: their standard deviation, positive.
        lower: the least value of each fact among them.
        upper: the greatest one.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    weights: Float[Array, "2 c"]
    bias: Float[Array, " 2"]
    bend: Float[Array, " f"]
    centre: Float[Array, " f"]
    spread: Float[Array, " f"]
    lower: Float[Array, " f"]
    upper: Float[Array, " f"]

    @property
    def signs(self) -> Float[np.ndarray, " c"]:
        """Of each weight: 1 where its fact can only speak for a change, -1 only against one, 0 where it depends."""
        return np.tile([float(FACTS[name].change) for name in self.names], 2)

    def columns(self, facts: Float[Array, " f"]) -> Float[Array, " c"]:
        """What the weights multiply: how far each fact is from its mean, below its bend and above it, by its spread.

        Beyond what was learned a fact counts as at the edge of that.
        """
        inside = jnp.clip(facts, self.lower, self.upper)
        below = jnp.minimum(inside, self.bend) - jnp.minimum(self.centre, self.bend)
        above = jnp.maximum(inside, self.bend) - jnp.maximum(self.centre, self.bend)
        return jnp.concatenate([below / self.spread, above / self.spread])

    def terms(self, facts: Float[Array, " f"]) -> Float[Array, "2 f"]:
        """What each fact adds to both log odds, compared with its mean."""
        return (self.weights * self.columns(facts)[None]).reshape(2, 2, -1).sum(axis=1)

    def beyond(self, facts: Float[Array, " f"]) -> Float[Array, " f"]:
        """How far each fact is beyond those that the weights were learned from, in widths of their range."""
        outside = jnp.maximum(facts - self.upper, self.lower - facts)
        return jnp.maximum(outside, 0.0) / jnp.maximum(self.upper - self.lower, self.spread)

    def log_odds(self, facts: Float[Array, " f"]) -> Float[Array, " 2"]:
        """The log odds of changed, and of not observed, each against unchanged."""
        return self.bias + self.terms(facts).sum(axis=1)

    def log_probabilities(self, facts: Float[Array, " f"]) -> Float[Array, " 3"]:
        """Log probabilities of changed, not observed and unchanged, for candidates like those learned from."""
        return jax.nn.log_softmax(jnp.append(self.log_odds(facts), 0.0))

    def probabilities(self, facts: Float[Array, " f"]) -> Float[Array, " 3"]:
        """Probabilities of changed, not observed and unchanged.

        The further a fact is beyond all that was learned, the nearer that of a change is to one half; the others keep
        their ratio.
        """
        learned = jnp.exp(self.log_probabilities(facts))
        trust = 1 / (1 + self.beyond(facts).max())
        changed = 0.5 + trust * (learned[0] - 0.5)
        others = learned[1:] / jnp.maximum(learned[1:].sum(), jnp.finfo(learned.dtype).tiny)
        return jnp.concatenate([changed[None], others * (1 - changed)])


@dataclasses.dataclass(frozen=True)
class Judgement:
    """The verdict on the candidates of one cloud.

    Attributes:
        explanations: of each candidate.
        unlike: name of the fact in which a candidate is furthest beyond what was learned, and how far, in widths of the
            learned range; of each candidate.
    """

    explanations: tuple[Explanation, ...]
    unlike: tuple[tuple[str, float], ...]


def judged(verdict: Verdict, measured: Sequence[Mapping[str, float]]) -> Judgement:
    """The verdict on some candidates.

    Args:
        verdict: the model.
        measured: the facts of each candidate, by name.
    """
    if not measured:
        return Judgement((), ())
    facts = np.array([[FACTS[name].scaled(own[name]) for name in verdict.names] for own in measured])
    padded = np.pad(facts, ((0, -len(facts) % BLOCK), (0, 0)), mode="edge")
    with jax.enable_x64(True):
        results = [_judge(verdict, block) for block in np.split(padded, len(padded) // BLOCK)]
    probabilities, terms, beyond = (np.concatenate(own)[: len(facts)] for own in zip(*results, strict=True))
    explanations = tuple(
        _explanation(verdict.names, own, *parts) for own, *parts in zip(measured, probabilities, terms, strict=True)
    )
    unlike = tuple((verdict.names[int(own.argmax())], float(own.max())) for own in beyond)
    return Judgement(explanations, unlike)


@lru_jit
def _judge(
    verdict: Verdict, facts: Float[Array, "b f"]
) -> tuple[Float[Array, "b 3"], Float[Array, "b 2 f"], Float[Array, "b f"]]:
    return jax.vmap(lambda own: (verdict.probabilities(own), verdict.terms(own), verdict.beyond(own)))(facts)


def _explanation(
    names: Sequence[str],
    values: Mapping[str, float],
    probabilities: Float[np.ndarray, "3"],
    terms: Float[np.ndarray, "2 f"],
) -> Explanation:
    changed, unobserved, unchanged = (float(probability) for probability in probabilities)
    against = terms[0] - terms[1] if unobserved > unchanged else terms[0]
    order = np.argsort(-np.abs(against), kind="stable")
    contributions = tuple(
        Contribution(
            names[index],
            float(values[names[index]]),
            float(against[index]),
            FACTS[names[index]].in_words(values[names[index]]),
        )
        for index in order
    )
    return Explanation(changed, unchanged, unobserved, contributions)
