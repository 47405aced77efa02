import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.changes.objects.pairing import PairingSettings, pairing_probabilities

ALL = PairingSettings(most_log_odds=20.0)


def enumerated(log_odds):
    """The marginals by all pairings, one after the other."""
    rows, columns = log_odds.shape
    odds, total, marginals = np.exp(log_odds), 0.0, np.zeros(log_odds.shape)

    def extend(row, taken, weight, pairs):
        nonlocal total
        if row == rows:
            total += weight
            for pair in pairs:
                marginals[pair] += weight
            return
        extend(row + 1, taken, weight, pairs)
        for column in set(range(columns)) - taken:
            extend(row + 1, taken | {column}, weight * odds[row, column], [*pairs, (row, column)])

    extend(0, set(), 1.0, [])
    return marginals / total


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (3, 1)])
def test_the_marginals_are_exact_where_one_change_has_all_the_alternatives(shape):
    log_odds = np.random.default_rng(0).normal(0, 3, shape)
    np.testing.assert_allclose(pairing_probabilities(log_odds, ALL), enumerated(log_odds), atol=1e-8)


@given(seed=st.integers(0, 10**6), rows=st.integers(1, 4), columns=st.integers(1, 4))
def test_the_marginals_are_close_and_never_more_than_one_partner(seed, rows, columns):
    log_odds = np.random.default_rng(seed).normal(0, 3, (rows, columns))
    marginals = pairing_probabilities(log_odds, ALL)
    np.testing.assert_allclose(marginals, enumerated(log_odds), atol=0.12)
    assert marginals.sum(axis=0).max() <= 1 + 1e-9 and marginals.sum(axis=1).max() <= 1 + 1e-9


def test_look_alikes_share_the_probability():
    assert pairing_probabilities(np.full((2, 2), 6.0)).max() < 0.5
    assert pairing_probabilities(np.full((1, 2), 6.0)).max() < 0.5
    assert pairing_probabilities(np.array([[6.0]]), ALL).max() > 0.99
    # One that fits a little better than the others is not much more probable.
    assert pairing_probabilities(np.array([[8.0, 6.0], [6.0, 8.0]])).max() < 0.5


def test_what_was_not_compared_is_no_alternative():
    probabilities = pairing_probabilities(np.array([[2.0, -np.inf], [-np.inf, -np.inf]]))
    assert probabilities[0, 0] == pytest.approx(1 / (1 + np.exp(-2)))
    assert (probabilities.ravel()[1:] == 0).all()
    assert pairing_probabilities(np.zeros((0, 3))).shape == (0, 3)
