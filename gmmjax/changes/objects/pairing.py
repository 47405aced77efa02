"""Which disappeared change is which appeared one, where several fit: the marginals over all pairings."""

import dataclasses

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class PairingSettings:
    """How the marginals are computed.

    Attributes:
        steps: of belief propagation, at most. 0: every change has all others as equal alternatives.
        converged: largest change of a message in the last step. 0: all steps are made.
        most_log_odds: of one pair by itself: among look-alikes that all fit well, a slightly better fit tells little.
            Empirical. Infinite: small differences of the facts decide among look-alikes.
    """

    steps: int = 200
    converged: float = 1e-9
    most_log_odds: float = 3.0


def pairing_probabilities(
    log_odds: Float[np.ndarray, "g n"], settings: PairingSettings = PairingSettings()
) -> Float[np.ndarray, "g n"]:
    r"""The probability of each pair when every change has at most one partner, or none.

    A pairing is a set of pairs without a common change; its weight is the product of the odds of its pairs. That is the
    monomer-dimer model, whose marginals belief propagation gives exactly on trees, and which always converges (Bayati
    and Nair 2006): with $m_{i \to j}$ the belief that i has no other partner than j,
    $m_{i \to j} = 1 / (1 + \sum_{k \ne j} o_{ik} m_{k \to i})$.

    Args:
        log_odds: of each disappeared (row) and appeared change (column) that they are one object, considered by
            themselves; minus infinity: they are not.
        settings: how the marginals are computed.
    """
    odds = np.exp(np.minimum(log_odds, settings.most_log_odds))
    # Messages of the rows and of the columns, each [g, n].
    rows = columns = np.ones_like(odds)
    for _ in range(settings.steps):
        previous = rows
        rows = _free(odds * columns, axis=1)
        columns = _free(odds * rows, axis=0)
        if np.abs(rows - previous).max(initial=0.0) <= settings.converged:
            break
    joint = odds * rows * columns
    return np.asarray(joint / (1 + joint))


def _free(incoming: Float[np.ndarray, "g n"], axis: int) -> Float[np.ndarray, "g n"]:
    """The belief that a change has none of its partners but, possibly, the one that the message goes to."""
    others = np.maximum(incoming.sum(axis=axis, keepdims=True) - incoming, 0)
    return np.asarray(1 / (1 + others))
