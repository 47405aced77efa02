"""The verdict on a candidate: changed, unchanged or not observed, from its facts.

A multinomial logistic model on about thirty facts. It is linear in them, so that what each adds to the log odds can be
told, and where physics says that a fact can only speak for a change, or only against one, its weight has that sign.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._programs import kept_jit
from gmmjax._typing import Array
from gmmjax.changes.evidence.facts import FACTS
from gmmjax.changes.explanation import Contribution, Explanation

# Candidates are judged in blocks of this number, so that few shapes are compiled. Results do not depend on it.
BLOCK = 64


class Verdict(eqx.Module):
    """The parameters of the model. Facts are those of `FACTS`, on their scales.

    Attributes:
        names: of the facts, in the order of the columns.
        weights: of each fact in the log odds of changed, and of not observed, each against unchanged.
        bias: of both log odds.
        centre: of each fact, the mean over the candidates that the weights were learned from.
        spread: their standard deviation, positive.
        lower: the least value of each fact among them.
        upper: the greatest one.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    weights: Float[Array, "2 f"]
    bias: Float[Array, " 2"]
    centre: Float[Array, " f"]
    spread: Float[Array, " f"]
    lower: Float[Array, " f"]
    upper: Float[Array, " f"]

    def terms(self, facts: Float[Array, " f"]) -> Float[Array, "2 f"]:
        """What each fact adds to both log odds, compared with its mean; beyond what was learned as at its edge."""
        inside = jnp.clip(facts, self.lower, self.upper)
        return self.weights * ((inside - self.centre) / self.spread)[None]

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


@kept_jit
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
