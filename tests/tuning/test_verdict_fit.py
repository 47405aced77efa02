import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.learning import CHANGED, NOT_CHANGED, UNCHANGED, UNOBSERVED, free_from, signed
from gmmjax.tuning import check_gradient
from gmmjax.tuning.verdict_fit import negative_log_posterior, remembered_facts, tuned_verdict
from tests.changes.evidence.verdicts import verdict
from tests.tuning.candidates import DISTANT, measured, weighted

SIGNS = DISTANT.signs
UNCHANGED_ROWS = weighted(measured(40, changes=0.0, seed=3))


def changed(own, facts):
    with jax.enable_x64(True):
        return np.asarray(jax.vmap(own.probabilities)(jnp.asarray(facts, jnp.float64)))[:, 0]


def found(own, rows):
    """Which candidates are rightly judged."""
    return (changed(own, rows.facts) >= 0.5) == (rows.kind == CHANGED)


@pytest.mark.slow
def test_a_few_labelled_candidates_teach_the_flying_pixels_of_a_sensor():
    unseen = weighted(measured(200, seed=1))
    tuned = tuned_verdict(DISTANT, weighted(measured(40)), 3.0)
    assert found(DISTANT, unseen).mean() < 0.6
    assert found(tuned, unseen).mean() > 0.95


def test_an_infinite_draw_gives_the_verdict_as_it_was():
    assert tuned_verdict(DISTANT, weighted(measured(40)), np.inf) is DISTANT


def test_the_stronger_the_draw_the_nearer_to_the_start():
    rows = weighted(measured(40))
    apart = [np.linalg.norm(tuned_verdict(DISTANT, rows, draw).weights - DISTANT.weights) for draw in (1e6, 30.0, 1.0)]
    assert apart[0] < 1e-2 and apart[0] < apart[1] < apart[2]


def test_candidates_without_weight_teach_nothing():
    rows = weighted(measured(40))
    some = np.arange(40) < 25
    kept = type(rows)(rows.facts[~some], rows.kind[~some], rows.weight[~some])
    of_kept = tuned_verdict(DISTANT, kept, 3.0)
    np.testing.assert_allclose(tuned_verdict(DISTANT, rows.without(some), 3.0).weights, of_kept.weights, atol=1e-4)
    assert tuned_verdict(DISTANT, rows.without(some | ~some), 3.0) is DISTANT


def test_the_signs_of_the_facts_hold_against_the_candidates():
    rows = weighted(measured(40))
    # Things are near and small, stray points far and many.
    against = rows._replace(kind=np.where(rows.kind == CHANGED, NOT_CHANGED, CHANGED))
    tuned = tuned_verdict(DISTANT, against, 0.01)
    assert (SIGNS * tuned.weights[0] >= 0).all()
    assert (SIGNS * (tuned.weights[0] - tuned.weights[1]) >= -1e-12).all()


def test_what_was_tuned_on_is_no_extrapolation():
    narrow = verdict({"distance": 2.0}, lower=-0.1, upper=0.5)
    rows = weighted(measured(40))
    with jax.enable_x64(True):
        assert max(float(narrow.beyond(own).max()) for own in rows.facts) > 1
        tuned = tuned_verdict(narrow, rows, 3.0)
        assert max(float(tuned.beyond(own).max()) for own in rows.facts) == 0


@pytest.mark.slow
def test_unchanged_pairs_lower_the_probability_of_candidates_like_theirs():
    unseen = weighted(measured(200, changes=0.0, seed=1))
    tuned = tuned_verdict(DISTANT, UNCHANGED_ROWS, 100.0)
    fallen = changed(DISTANT, unseen.facts) - changed(tuned, unseen.facts)
    others = remembered_facts(DISTANT, 500)
    assert (fallen > 0).all()
    # Of candidates like those learned from, which nothing was said about, much less.
    assert fallen.mean() > 2.5 * np.abs(changed(DISTANT, others) - changed(tuned, others)).mean()


@pytest.mark.slow
def test_what_was_known_is_not_forgotten():
    facts = remembered_facts(DISTANT, 100)
    tuned = [changed(tuned_verdict(DISTANT, weighted(measured(40)), draw), facts) for draw in (1000.0, 10.0)]
    forgotten = [np.abs(own - changed(DISTANT, facts)).mean() for own in tuned]
    assert forgotten[0] < 0.05 < forgotten[1]


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [(CHANGED, NOT_CHANGED), (CHANGED, UNOBSERVED, UNCHANGED, NOT_CHANGED)])
def test_the_gradient_is_that_of_the_loss(kinds):
    random = np.random.default_rng(0)
    rows = weighted(measured(20))
    kind, weight = random.choice(kinds, 20), random.uniform(0, 2, 20)
    with jax.enable_x64(True):
        columns, remembered = (jax.vmap(DISTANT.columns)(own) for own in (rows.facts, remembered_facts(DISTANT, 20)))
    own = (DISTANT.weights, DISTANT.bias, columns, kind, weight, SIGNS, remembered, 3.0)

    def loss(free):
        return negative_log_posterior(free, *map(jnp.asarray, own))

    assert check_gradient(loss, np.abs(random.normal(size=2 * len(SIGNS) + 2))).largest_error < 1e-7


def test_the_parameters_are_those_of_their_free_numbers(float64):
    random = np.random.default_rng(0)
    weights = np.where(
        SIGNS == 0, random.normal(size=(2, len(SIGNS))), SIGNS * np.sort(random.random((2, len(SIGNS))), 0)[::-1]
    )
    bias = random.normal(size=2)
    again, of_both = signed(jnp.asarray(free_from(weights, bias, SIGNS)), jnp.asarray(SIGNS))
    np.testing.assert_allclose(again, weights, atol=1e-12)
    np.testing.assert_allclose(of_both, bias)
