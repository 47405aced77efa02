"""How families that were left out are judged, as text: F1 and calibration over candidates."""

import itertools
from collections.abc import Mapping

import numpy as np

from gmmjax.evaluation import Reliability
from gmmjax.learning.candidate_rows import CHANGED, CandidateRows
from gmmjax.learning.training import LeftOut

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)


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
    lines += [_row(name, families[name], own[:, CHANGED]) for name, own in left_out.probabilities.items()]
    joined = {name: families[name] for name in left_out.probabilities}
    pooled = np.concatenate([own[:, CHANGED] for own in left_out.probabilities.values()])
    everything = CandidateRows(*(np.concatenate(own) for own in zip(*joined.values(), strict=True)))
    lines += [_row("all", everything, pooled), "", "| probability | candidates | mean | true |", "|---|---|---|---|"]
    changed = everything.kind == CHANGED
    for lower, upper in itertools.pairwise(EDGES):
        own = (pooled >= lower) & ((pooled < upper) | (upper == 1.0))
        if own.any():
            lines.append(f"| {lower} to {upper} | {own.sum()} | {pooled[own].mean():.3f} | {changed[own].mean():.3f} |")
    lines += ["", f"Expected calibration error {Reliability.of(pooled, changed).calibration_error:.4f}."]
    return "\n".join(lines)


def _row(name: str, rows: CandidateRows, probability: np.ndarray) -> str:
    changed, found = rows.kind == CHANGED, probability >= 0.5
    both, false, missed = (found & changed).sum(), (found & ~changed).sum(), (~found & changed).sum()
    f1 = 2 * both / max(2 * both + false + missed, 1)
    of_truth = np.clip(np.where(changed, probability, 1 - probability), 1e-300, 1)
    return (
        f"| {name} | {len(changed)} | {changed.sum()} | {f1:.3f} | {false} | {missed} | "
        f"{-np.log(of_truth).mean():.3f} | {probability.mean() - changed.mean():+.3f} |"
    )
