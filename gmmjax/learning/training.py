"""The parameters of the verdict, learned from candidates whose truth is known."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize, minimize_scalar

from gmmjax._typing import Array
from gmmjax.changes import Verdict, names_of
from gmmjax.errors import InputError
from gmmjax.evaluation import Reliability
from gmmjax.learning.candidate_rows import CHANGED, CandidateRows
from gmmjax.learning.objective import bounds_of, free_from, log_likelihood, signed

# Penalties of the squared weights, among which the one is chosen by which families that were left out are judged best.
# 0: what a few candidates have in common by chance is learned.
PENALTIES = (0.3, 1.0, 3.0, 10.0, 30.0)
MAX_STEPS = 2000
# Fraction of the candidates below the lower and above the upper end of the range of a fact that counts as learned.
# 0: one freak of a simulator widens it.
TRIMMED = 0.002
# Of the probabilities in the table of families left out.
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)


class LeftOut(NamedTuple):
    """Classification of each family by what was learned on all others.

    Attributes:
        probabilities: of changed, not observed and unchanged, for the candidates of each family.
        penalty: that was chosen.
        temperature: by which all log odds are divided, so that the probabilities are frequencies.
    """

    probabilities: Mapping[str, Float[np.ndarray, "_ 3"]]
    penalty: float
    temperature: float


@dataclasses.dataclass(frozen=True)
class _Rows:
    """All candidates of some families: their facts on the verdict's scales, what they are, and their weight."""

    facts: Float[np.ndarray, "n f"]
    kind: Int[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]


def learned(
    families: Mapping[str, CandidateRows], *, poses: bool, penalties: Sequence[float] = PENALTIES
) -> tuple[Verdict, LeftOut]:
    """The verdict, and how it judges families that it was not learned from.

    Args:
        families: the candidates of each.
        poses: whether the poses are given.
        penalties: among which one is chosen.

    Raises:
        InputError: fewer than two families, or none with a change.
    """
    names = names_of(poses=poses)
    left_out = _judged_left_out(families, names, penalties)
    verdict = _fitted(_rows(families, names), names, left_out.penalty)
    return _cooled(verdict, left_out.temperature), left_out


def _judged_left_out(
    families: Mapping[str, CandidateRows], names: Sequence[str], penalties: Sequence[float]
) -> LeftOut:
    """Every family, judged by what was learned on all others."""
    with_candidates = {name: rows for name, rows in families.items() if len(rows.kind)}
    if len(with_candidates) < 2 or not any((rows.kind == CHANGED).any() for rows in with_candidates.values()):
        raise InputError(
            f"families {', '.join(families) or 'none'}: at least two must have candidates, and one of them a change; "
            "give more families or seeds"
        )
    everything = _rows(with_candidates, names)
    odds = {penalty: _odds_left_out(with_candidates, names, penalty) for penalty in penalties}
    losses = {
        penalty: minimize_scalar(
            lambda log, own=own: _loss(np.concatenate([*own.values()]) / np.exp(log), everything),
            bounds=(-1.0, 2.0),
            method="bounded",
        )
        for penalty, own in odds.items()
    }
    penalty = min(losses, key=lambda own: float(losses[own].fun))
    temperature = float(np.exp(losses[penalty].x))
    return LeftOut({name: _softmax(own / temperature) for name, own in odds[penalty].items()}, penalty, temperature)


def _odds_left_out(
    families: Mapping[str, CandidateRows], names: Sequence[str], penalty: float
) -> dict[str, Float[np.ndarray, "_ 2"]]:
    """The log odds of each family's candidates by what was learned on all others."""
    odds = {}
    for name, rows in families.items():
        others = {other: own for other, own in families.items() if other != name}
        verdict = _fitted(_rows(others, names), names, penalty)
        with jax.enable_x64(True):
            odds[name] = np.asarray(jax.vmap(verdict.log_odds)(jnp.asarray(rows.scaled(names))))
    return odds


def _rows(families: Mapping[str, CandidateRows], names: Sequence[str]) -> _Rows:
    """All candidates; those of a family together weigh the root of their number."""
    weights = [np.full(len(rows.kind), max(len(rows.kind), 1) ** -0.5) for rows in families.values()]
    weight = np.concatenate(weights)
    return _Rows(
        np.concatenate([rows.scaled(names) for rows in families.values()]),
        np.concatenate([rows.kind for rows in families.values()]),
        weight * len(weight) / weight.sum(),
    )


def _fitted(rows: _Rows, names: Sequence[str], penalty: float) -> Verdict:
    """The weights with the greatest posterior: L-BFGS-B, whose bounds are the signs."""
    lower, upper = np.quantile(rows.facts, [TRIMMED, 1 - TRIMMED], axis=0)
    inside = np.clip(rows.facts, lower, upper)
    centre, spread = inside.mean(axis=0), np.maximum(inside.std(axis=0), 1e-6)
    nothing = np.zeros((2, 2 * len(names)))
    start = Verdict(tuple(names), nothing, nothing[:, 0], _bends(inside, rows.kind), centre, spread, lower, upper)
    signs = start.signs
    free = free_from(start.weights, start.bias, signs)
    with jax.enable_x64(True):
        columns = jax.vmap(start.columns)(jnp.asarray(rows.facts))
        arguments = [columns, *(jnp.asarray(own) for own in (rows.kind, rows.weight, signs))]
        options, bounds = {"maxiter": MAX_STEPS}, bounds_of(signs)
        best = minimize(
            _objective, free, (arguments, penalty), jac=True, bounds=bounds, method="L-BFGS-B", options=options
        )
        weights, bias = signed(jnp.asarray(best.x), arguments[-1])
    return dataclasses.replace(start, weights=np.asarray(weights), bias=np.asarray(bias))


def _objective(free: np.ndarray, arguments: Sequence[jax.Array], penalty: float) -> tuple[float, np.ndarray]:
    value, gradient = _penalised(jnp.asarray(free), *arguments, penalty)
    return float(value), np.asarray(gradient)


def _bends(facts: Float[np.ndarray, "n f"], kind: Int[np.ndarray, " n"]) -> Float[np.ndarray, " f"]:
    """Values at which the slope of each fact may change: midway between the medians of changes and of all others."""
    changed = kind == CHANGED
    return np.asarray((np.median(facts[changed], axis=0) + np.median(facts[~changed], axis=0)) / 2)


@jax.jit
@jax.value_and_grad
def _penalised(
    free: Float[Array, " p"],
    columns: Float[Array, "n c"],
    kind: Int[Array, " n"],
    weight: Float[Array, " n"],
    signs: Float[Array, " c"],
    penalty: float | Float[Array, ""],
) -> Float[Array, ""]:
    """The weighted negative log likelihood with the penalty of the weights."""
    weights, bias = signed(free, signs)
    return -log_likelihood(weights, bias, columns, kind, weight) + penalty * jnp.sum(weights**2)


def _cooled(verdict: Verdict, temperature: float) -> Verdict:
    """With all log odds divided by the temperature."""
    return dataclasses.replace(verdict, weights=verdict.weights / temperature, bias=verdict.bias / temperature)


def _softmax(odds: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    full = np.concatenate([odds, np.zeros((len(odds), 1))], axis=1)
    powers = np.exp(full - full.max(axis=1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))


def _loss(odds: Float[np.ndarray, "n 2"], rows: _Rows) -> float:
    """The weighted mean negative log likelihood of what the candidates are."""
    probabilities = _softmax(odds)
    # The last column is of candidates that did not change, by whatever reason.
    of_kinds = np.concatenate([probabilities, probabilities[:, 1:].sum(axis=1, keepdims=True)], axis=1)
    of_truth = of_kinds[np.arange(len(odds)), rows.kind]
    return float(-(rows.weight @ np.log(np.maximum(of_truth, 1e-300))) / rows.weight.sum())


def left_out_table(families: Mapping[str, CandidateRows], left_out: LeftOut, heading: str = "family left out") -> str:
    """A Markdown table with a row for each family, and one for each range of the probability.

    Args:
        families: the candidates of each.
        left_out: what was made of each by what was learned on all others.
        heading: of the first column.
    """
    lines = [
        f"| {heading} | candidates | changes | F1 | false | missed | log score | mean - true |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [_table_row(name, families[name], own[:, CHANGED]) for name, own in left_out.probabilities.items()]
    joined = {name: families[name] for name in left_out.probabilities}
    pooled = np.concatenate([own[:, CHANGED] for own in left_out.probabilities.values()])
    everything = CandidateRows(*(np.concatenate(own) for own in zip(*joined.values(), strict=True)))
    lines += [
        _table_row("all", everything, pooled),
        "",
        "| probability | candidates | mean | true |",
        "|---|---|---|---|",
    ]
    changed = everything.kind == CHANGED
    for lower, upper in itertools.pairwise(EDGES):
        own = (pooled >= lower) & ((pooled < upper) | (upper == 1.0))
        if own.any():
            lines.append(f"| {lower} to {upper} | {own.sum()} | {pooled[own].mean():.3f} | {changed[own].mean():.3f} |")
    lines += ["", f"Expected calibration error {Reliability.of(pooled, changed).calibration_error:.4f}."]
    return "\n".join(lines)


def _table_row(name: str, rows: CandidateRows, probability: np.ndarray) -> str:
    changed, found = rows.kind == CHANGED, probability >= 0.5
    both, false, missed = (found & changed).sum(), (found & ~changed).sum(), (~found & changed).sum()
    f1 = 2 * both / max(2 * both + false + missed, 1)
    of_truth = np.clip(np.where(changed, probability, 1 - probability), 1e-300, 1)
    return (
        f"| {name} | {len(changed)} | {changed.sum()} | {f1:.3f} | {false} | {missed} | "
        f"{-np.log(of_truth).mean():.3f} | {probability.mean() - changed.mean():+.3f} |"
    )
