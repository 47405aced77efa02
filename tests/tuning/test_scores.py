import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sklearn import metrics

from gmmjax import GaussianMixture
from gmmjax.tuning import brier_score, expected_f1, held_out_log_likelihood, log_score

pytestmark = pytest.mark.usefixtures("float64")


@pytest.fixture
def answers():
    random = np.random.default_rng(0)
    return jnp.asarray(random.uniform(0.01, 0.99, 50)), jnp.asarray(random.integers(0, 2, 50).astype(float))


def test_proper_scores_are_those_of_scikit_learn(answers):
    probability, changed = answers
    assert brier_score(probability, changed) == pytest.approx(metrics.brier_score_loss(changed, probability))
    assert log_score(probability, changed) == pytest.approx(metrics.log_loss(changed, probability))


def test_expected_f1_of_certain_answers_is_f1(answers):
    # Of so many points the one that is added does not show.
    probability, changed = (jnp.tile(jnp.round(part), 10_000) for part in answers)
    assert expected_f1(probability, changed) == pytest.approx(metrics.f1_score(changed, probability), abs=1e-5)


@pytest.mark.parametrize("score", [brier_score, log_score, expected_f1])
def test_a_weight_stands_for_as_many_points(score, answers):
    probability, changed = answers
    weight = np.random.default_rng(1).integers(0, 4, 50)
    repeated = [jnp.asarray(np.repeat(np.asarray(part), weight)) for part in (probability, changed)]
    weighted = score(probability, changed, jnp.asarray(weight.astype(float)))
    assert float(weighted) == pytest.approx(float(score(*repeated)), rel=1e-12)


@pytest.mark.parametrize("score", [brier_score, log_score])
def test_proper_scores_are_best_at_the_true_share(score):
    changed = jnp.asarray([1.0] * 3 + [0.0] * 7)
    slope = jax.grad(lambda share: score(jnp.full(10, share), changed))
    assert slope(0.3) == pytest.approx(0, abs=1e-12)
    assert slope(0.2) < 0 < slope(0.4)


def test_certain_and_wrong_costs_much_and_stays_finite():
    assert 13 < log_score(jnp.array([1.0]), jnp.array([0.0])) < 14
    assert np.isfinite(jax.grad(lambda own: log_score(own, jnp.array([0.0])))(jnp.array([1.0]))).all()


@pytest.mark.slow
def test_held_out_likelihood_is_the_mean_log_density():
    mixture = GaussianMixture(jnp.ones(1), jnp.zeros((1, 2)), jnp.eye(2)[None], jnp.ones(1, bool))
    points = jnp.asarray([[0.0, 0.0], [3.0, 4.0]])
    constant = -np.log(2 * np.pi)
    assert held_out_log_likelihood(mixture, points) == pytest.approx(constant - 12.5 / 2)
    assert held_out_log_likelihood(mixture, points, jnp.array([3.0, 1.0])) == pytest.approx(constant - 12.5 / 4)
