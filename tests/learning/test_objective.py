import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.learning import CHANGED, NOT_CHANGED, UNCHANGED, UNOBSERVED, bounds_of, log_likelihood, log_probabilities

WEIGHTS, BIAS = np.array([[1.0, -2.0], [0.5, 0.0]]), np.array([0.3, -0.2])
FACTS = np.array([[0.5, 1.0], [-1.0, 0.2], [2.0, 0.0]])


def probabilities():
    """Changed, not observed and unchanged, by the definition."""
    powers = np.exp(np.column_stack([FACTS @ WEIGHTS.T + BIAS, np.zeros(3)]))
    return powers / powers.sum(axis=1, keepdims=True)


def test_probabilities_are_those_of_the_log_odds(float64):
    np.testing.assert_allclose(np.exp(log_probabilities(*map(jnp.asarray, (WEIGHTS, BIAS, FACTS)))), probabilities())


@pytest.mark.parametrize("kind", [CHANGED, UNOBSERVED, UNCHANGED])
def test_the_likelihood_of_a_kind_is_its_probability(float64, kind):
    weight = np.array([1.0, 0.0, 2.0])
    found = log_likelihood(*map(jnp.asarray, (WEIGHTS, BIAS, FACTS, np.full(3, kind), weight)))
    assert float(found) == pytest.approx(weight @ np.log(probabilities()[:, kind]))


def test_not_changed_is_either_of_the_other_two(float64):
    found = log_likelihood(*map(jnp.asarray, (WEIGHTS, BIAS, FACTS, np.full(3, NOT_CHANGED), np.ones(3))))
    assert float(found) == pytest.approx(np.log(1 - probabilities()[:, CHANGED]).sum())


def test_only_facts_with_a_sign_are_bounded():
    assert bounds_of(np.array([1.0, 0.0])) == [(0.0, None), (None, None)] * 2 + [(None, None)] * 2
