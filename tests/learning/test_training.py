import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.errors import InputError
from gmmjax.evaluation import Reliability
from gmmjax.learning import CandidateRows, learned, left_out_table
from tests.learning.candidates import NAMES, rows

PENALTIES = (0.1, 1.0)
# Of each family: what the facts that say nothing add to the error falls with it.
NUMBER = 250


@pytest.fixture(scope="module")
def families():
    return {name: rows(seed, NUMBER)[0] for seed, name in enumerate(("rooms", "halls", "streets"))}


@pytest.fixture(scope="module")
def trained(families):
    return learned(families, poses=False, penalties=PENALTIES)


@pytest.mark.slow
def test_the_facts_that_decide_have_the_greatest_weights(trained):
    slopes = trained[0].weights.reshape(2, 2, -1).sum(axis=1)
    assert NAMES[int(np.argmax(slopes[0]))] == "excess"
    assert NAMES[int(np.argmax(slopes[1]))] == "continued"


@pytest.mark.slow
def test_a_fact_that_tells_no_more_beyond_a_value_is_bent_there():
    """Whether the first half of a fact is there decides; how much of the second is, says nothing."""
    families, column = {}, NAMES.index("excess")
    for seed, name in enumerate(("rooms", "halls")):
        random = np.random.default_rng(seed)
        own, excess = rows(seed)[0], random.uniform(0, 1, 400)
        values = np.repeat(own.values[:1], 400, axis=0)
        values[:, column] = excess
        changed = random.uniform(size=400) < np.minimum(excess, 0.5) * 1.8
        families[name] = own._replace(
            values=values, kind=np.where(changed, 0, 2), points=np.ones(400, int), changed_points=changed.astype(int)
        )
    below, above = learned(families, poses=False, penalties=PENALTIES)[0].weights[0].reshape(2, -1)[:, column]
    assert below > 3 * above >= 0


def test_weights_have_the_signs_of_their_facts(trained):
    verdict, _ = trained
    signs = verdict.signs
    assert (signs * verdict.weights[0] >= 0).all()
    # What can only speak for a change never speaks more for not observed.
    assert (signs * (verdict.weights[0] - verdict.weights[1]) >= -1e-12).all()


def test_probabilities_of_families_left_out_are_frequencies(families, trained):
    left_out = trained[1]
    truth = np.concatenate([rows(seed, NUMBER)[1] for seed in range(3)])
    probability = np.concatenate([*left_out.probabilities.values()])
    assert np.abs(probability - truth).mean() < 0.12
    changed = np.concatenate([own.kind == 0 for own in families.values()])
    assert Reliability.of(probability[:, 0], changed).calibration_error < 0.06


@pytest.mark.slow
def test_a_family_is_judged_without_its_own_truth(families, trained):
    """With the truth of one family turned round its own log odds stay, but for the temperature; the others' do not."""
    turned = families["rooms"]._replace(kind=2 - families["rooms"].kind)
    _, again = learned({**families, "rooms": turned}, poses=False, penalties=(1.0,))
    _, before = learned(families, poses=False, penalties=(1.0,))
    for family, same in (("rooms", True), ("halls", False)):
        odds = [np.log(own.probabilities[family][:, 0] / own.probabilities[family][:, 2]) for own in (before, again)]
        ratio = before.temperature / again.temperature
        assert np.allclose(odds[1], ratio * odds[0], rtol=1e-6, atol=1e-9) == same


@pytest.mark.slow
def test_the_same_candidates_give_the_same_verdict(families, trained):
    again, _ = learned(families, poses=False, penalties=PENALTIES)
    np.testing.assert_array_equal(again.weights, trained[0].weights)


@pytest.mark.slow
def test_the_order_of_the_families_hardly_matters(families, trained):
    turned, _ = learned(dict(reversed(families.items())), poses=False, penalties=PENALTIES)
    with jax.enable_x64(True):
        facts = jnp.asarray(trained[0].centre)
        here, there = (np.asarray(own.probabilities(facts)) for own in (trained[0], turned))
    np.testing.assert_allclose(here, there, atol=1e-3)


def test_too_little_to_learn_from_is_refused(families):
    with pytest.raises(InputError, match="at least two"):
        learned({"rooms": families["rooms"]}, poses=False, penalties=PENALTIES)
    unchanged = families["halls"]._replace(kind=np.full(200, 2))
    with pytest.raises(InputError, match="one of them a change"):
        learned({"rooms": unchanged, "halls": unchanged}, poses=False, penalties=PENALTIES)


def test_the_table_counts_what_is_false_and_missed(families, trained):
    lines = left_out_table(families, trained[1]).splitlines()
    assert lines[2].startswith(f"| rooms | {NUMBER} | ")
    found = trained[1].probabilities["rooms"][:, 0] >= 0.5
    changed = families["rooms"].kind == 0
    assert lines[2].split(" | ")[4:6] == [str((found & ~changed).sum()), str((~found & changed).sum())]
    assert lines[5].startswith(f"| all | {3 * NUMBER} | ")


def test_a_family_without_candidates_is_passed_over(families):
    nothing = CandidateRows.none(poses=False)
    _, left_out = learned({**families, "deserts": nothing}, poses=False, penalties=(1.0,))
    assert "deserts" not in left_out.probabilities
