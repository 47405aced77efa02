import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.changes.evidence.facts import FACTS, names_of
from gmmjax.changes.evidence.verdict import BLOCK, judged
from gmmjax.changes.evidence.verdict_file import shipped_verdicts
from tests.changes.evidence.verdicts import values, verdict


def test_the_log_odds_are_the_weighted_facts():
    model = verdict({"excess": 3.0}, {"continued": 2.0}, bias=(-1.0, -2.0))
    (explanation,) = judged(model, [values(excess=0.5, continued=1.0)]).explanations
    odds = np.exp([-1.0 + 1.5, -2.0 + 2.0, 0.0])
    shares = (explanation.changed, explanation.unobserved, explanation.unchanged)
    np.testing.assert_allclose(shares, odds / odds.sum(), rtol=1e-6)


def test_contributions_are_in_log_odds_against_the_likelier_alternative_and_in_words():
    model = verdict({"continued": -4.0, "excess": 1.0}, {"continued": 2.0})
    (explanation,) = judged(model, [values(excess=0.25, continued=0.92)]).explanations
    first, second = explanation.contributions[:2]
    assert (first.fact, first.value) == ("continued", 0.92)
    assert first.log_odds == pytest.approx(-6 * 0.92)
    assert first.sentence == "92% of it continues surfaces that did not change"
    assert (second.fact, second.log_odds) == ("excess", pytest.approx(0.25))
    assert [abs(own.log_odds) for own in explanation.contributions[2:]] == [0.0] * (len(model.names) - 2)


def test_the_contributions_and_the_bias_add_up_to_the_log_odds():
    model = verdict({"excess": 1.0, "count": 0.5}, bias=(0.3, -9.0))
    (explanation,) = judged(model, [values(excess=0.7, count=100.0)]).explanations
    total = 0.3 + sum(own.log_odds for own in explanation.contributions)
    assert np.log(explanation.changed / explanation.unchanged) == pytest.approx(total, rel=1e-6)


def test_far_from_all_that_was_learned_the_probability_of_a_change_tends_to_a_half():
    model = verdict({"excess": 8.0}, lower=0.0, upper=1.0)
    near, far, farther = judged(model, [values(excess=own) for own in (1.0, 3.0, 1e6)]).explanations
    assert near.changed > 0.99
    assert near.changed > far.changed > farther.changed > 0.5
    assert farther.changed == pytest.approx(0.5, abs=1e-4)
    for explanation in (near, far, farther):
        assert explanation.changed + explanation.unchanged + explanation.unobserved == pytest.approx(1)


def test_what_is_unlike_all_that_was_learned_is_named():
    judgement = judged(verdict({}, lower=0.0, upper=1.0), [values(), values(thickness=np.expm1(4.0))])
    assert judgement.unlike[0][1] == 0.0
    assert judgement.unlike[1] == ("thickness", pytest.approx(3.0))


def test_the_number_of_candidates_changes_no_verdict():
    model = verdict({"excess": 2.0})
    facts = [values(excess=own) for own in np.linspace(0, 1, BLOCK + 3)]
    together = [own.changed for own in judged(model, facts).explanations]
    alone = [judged(model, [own]).explanations[0].changed for own in facts[:: BLOCK // 2]]
    np.testing.assert_allclose(together[:: BLOCK // 2], alone, rtol=1e-12)
    assert judged(model, []).explanations == ()


@pytest.mark.slow
@pytest.mark.parametrize("poses", [False, True])
@given(data=st.data())
@settings(max_examples=20, deadline=None)
def test_facts_that_can_only_speak_for_a_change_do_so_in_the_shipped_verdict(poses, data):
    model = shipped_verdicts().poses_given if poses else shipped_verdicts().poses_unknown
    name = data.draw(st.sampled_from([name for name in names_of(poses=poses) if FACTS[name].change]))
    facts = np.array(data.draw(st.lists(st.floats(-2, 2), min_size=len(model.names), max_size=len(model.names))))
    facts = model.centre + facts * model.spread
    column, more = model.names.index(name), facts.copy()
    more[column] += FACTS[name].change * data.draw(st.floats(0, 2)) * model.spread[column]
    with jax.enable_x64(True):
        less_changed, more_changed = (float(jnp.exp(model.log_probabilities(own))[0]) for own in (facts, more))
    assert more_changed >= less_changed - 1e-12


@pytest.mark.slow
def test_the_gradient_of_the_probability_is_that_of_central_differences():
    model = verdict({"excess": 1.0}, {"continued": 0.5}, bias=(0.2, -0.4))
    facts = np.array([FACTS[name].scaled(values(excess=0.3, continued=0.6)[name]) for name in model.names])

    def changed(weights):
        return dataclasses.replace(model, weights=weights).probabilities(facts)[0]

    with jax.enable_x64(True):
        facts = jnp.asarray(facts)
        gradient = np.asarray(jax.grad(changed)(jnp.asarray(model.weights)))
        for row, column in ((0, model.names.index("excess")), (1, model.names.index("continued"))):
            step = np.zeros_like(model.weights)
            step[row, column] = 1e-6
            difference = (changed(model.weights + step) - changed(model.weights - step)) / 2e-6
            assert gradient[row, column] == pytest.approx(float(difference), rel=1e-6, abs=1e-9)


def test_a_fact_is_a_line_that_bends_once():
    """0.6 of a fact whose slopes are 2 below 0.5 and 1 above adds 1.1, compared with none of it."""
    model = verdict({"excess": 2.0})
    column = model.names.index("excess")
    weights, bend = model.weights.copy(), model.bend.copy()
    weights[0, len(model.names) + column], bend[column] = 1.0, 0.5
    model = dataclasses.replace(model, weights=weights, bend=bend)
    facts = np.zeros((5, len(model.names)))
    facts[:, column] = [-1.0, 0.0, 0.5, 0.6, 2.5]
    with jax.enable_x64(True):
        terms = np.asarray([model.terms(jnp.asarray(own)) for own in facts])
    np.testing.assert_allclose(terms[:, 0, column], [-2.0, 0.0, 1.0, 1.1, 3.0], atol=1e-12)
    assert np.count_nonzero(np.delete(terms, column, axis=2)) == 0


def test_the_shipped_verdicts_have_at_most_a_few_hundred_parameters():
    shipped = shipped_verdicts()
    assert sum(own.weights.size + own.bias.size for own in (shipped.poses_unknown, shipped.poses_given)) <= 400
