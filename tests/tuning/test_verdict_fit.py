import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.changes import FACTS
from gmmjax.learning import CHANGED, NOT_CHANGED, UNCHANGED, UNOBSERVED, free_from, signed
from gmmjax.tuning import check_gradient
from gmmjax.tuning.verdict_fit import lowered_loss, moved_loss, standardised, tuned_verdict
from tests.changes.evidence.verdicts import verdict
from tests.tuning.candidates import DISTANT, NAMES, measured, weighted

SIGNS = np.array([float(FACTS[name].change) for name in NAMES])
UNCHANGED_ROWS = weighted(measured(40, changes=0.0, seed=3))
LOWERED = tuned_verdict(DISTANT, UNCHANGED_ROWS, 1.0)


def changed(own, facts):
    with jax.enable_x64(True):
        return np.asarray(jax.vmap(own.probabilities)(jnp.asarray(facts, jnp.float64)))[:, 0]


def found(own, rows):
    """Which candidates are rightly judged."""
    return (changed(own, rows.facts) >= 0.5) == (rows.kind == CHANGED)


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
    assert apart[0] < 1e-4 and apart[0] < apart[1] < apart[2]


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


@given(st.integers(0, 10**6))
def test_unchanged_pairs_lower_the_probability_of_a_change_for_whatever_facts(seed):
    # A third of them beyond what was learned.
    facts = np.random.default_rng(seed).uniform(-15, 15, (50, len(NAMES)))
    before, after = changed(DISTANT, facts), changed(LOWERED, facts)
    assert (after <= before + 1e-12).all()
    np.testing.assert_array_equal(LOWERED.weights[1], DISTANT.weights[1])


def test_unchanged_pairs_stop_their_false_alarms():
    assert (changed(DISTANT, UNCHANGED_ROWS.facts) >= 0.5).mean() > 0.9
    assert (changed(LOWERED, UNCHANGED_ROWS.facts) >= 0.5).mean() < 0.1


def test_lowered_weights_keep_their_signs():
    tuned = tuned_verdict(verdict({"distance": 0.2}, bias=(3.0, 0.0)), UNCHANGED_ROWS, 0.01)
    assert (SIGNS * tuned.weights[0] >= 0).all()


@pytest.mark.parametrize("kinds", [(CHANGED, NOT_CHANGED), (CHANGED, UNOBSERVED, UNCHANGED, NOT_CHANGED)])
def test_the_gradient_is_that_of_the_loss(kinds):
    random = np.random.default_rng(0)
    rows = weighted(measured(20))
    kind, weight = random.choice(kinds, 20), random.uniform(0, 2, 20)
    own = (DISTANT.weights, DISTANT.bias, standardised(DISTANT, rows.facts))
    signed_free = np.abs(random.normal(size=2 * len(NAMES) + 2))

    def moved(free):
        return moved_loss(free, *map(jnp.asarray, own), jnp.asarray(kind), *map(jnp.asarray, (weight, SIGNS, 3.0)))

    def lowered(free):
        edges = standardised(DISTANT, np.stack([DISTANT.lower, DISTANT.upper]))
        return lowered_loss(free, *map(jnp.asarray, own), jnp.asarray(kind), *map(jnp.asarray, (weight, edges, 3.0)))

    assert check_gradient(moved, signed_free).largest_error < 1e-7
    assert check_gradient(lowered, signed_free[: 2 * len(NAMES) + 1] / 10).largest_error < 1e-7


def test_the_parameters_are_those_of_their_free_numbers(float64):
    random = np.random.default_rng(0)
    weights = np.where(
        SIGNS == 0, random.normal(size=(2, len(NAMES))), SIGNS * np.sort(random.random((2, len(SIGNS))), 0)[::-1]
    )
    bias = random.normal(size=2)
    again, of_both = signed(jnp.asarray(free_from(weights, bias, SIGNS)), jnp.asarray(SIGNS))
    np.testing.assert_allclose(again, weights, atol=1e-12)
    np.testing.assert_allclose(of_both, bias)
