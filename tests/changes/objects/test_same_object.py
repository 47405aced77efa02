import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.changes.objects.same_object import (
    MAX_LOG_ODDS,
    MatchFacts,
    SameObjectModel,
    pairing_probabilities,
    shipped_model,
)

FITS = MatchFacts(
    covered=0.95,
    explained=0.9,
    contradicted=0.0,
    observability=0.2,
    thickness=2.3,
    distance=0.0,
)
SITUATIONS = ("standing", "free", "in place")


@pytest.mark.parametrize("situation", SITUATIONS)
def test_what_fits_is_one_object_and_what_contradicts_is_not(situation):
    contradicted = FITS._replace(covered=0.5, explained=0.3, contradicted=0.7)
    assert shipped_model()[situation].log_odds(FITS) > 0 > shipped_model()[situation].log_odds(contradicted)


@pytest.mark.parametrize("fact", ["contradicted", "distance"])
def test_more_of_what_speaks_against_it_never_makes_it_more_probable(fact):
    values = [shipped_model()["standing"].log_odds(FITS._replace(**{fact: value})) for value in (0.0, 0.5, 5.0)]
    assert values[0] >= values[1] >= values[2]


def test_a_fact_far_from_all_examples_counts_no_more_than_the_farthest():
    huge, larger = (FITS._replace(contradicted=value) for value in (1e3, 1e6))
    assert shipped_model()["free"].log_odds(huge) == shipped_model()["free"].log_odds(larger)


def test_the_model_survives_its_file_and_one_of_other_facts_is_refused():
    text = shipped_model().to_json()
    assert SameObjectModel.from_json(text).to_json() == text
    with pytest.raises(ValueError, match=r"python -m gmmjax\.learning\.same_object"):
        SameObjectModel.from_json(json.dumps({**json.loads(text), "facts": ["covered"]}))


def test_the_parameters_are_finite():
    for situation in SITUATIONS:
        values = [np.ravel(value) for value in dataclasses.asdict(shipped_model()[situation]).values()]
        assert np.isfinite(np.concatenate(values)).all()


@given(seed=st.integers(0, 10**6), rows=st.integers(1, 4), columns=st.integers(1, 4))
def test_no_change_has_more_than_one_partner(seed, rows, columns):
    log_odds = np.random.default_rng(seed).normal(0, 3, (rows, columns))
    probabilities = pairing_probabilities(log_odds)
    assert probabilities.sum(axis=0).max() < 1 and probabilities.sum(axis=1).max() < 1
    alone = 1 / (1 + np.exp(-np.minimum(log_odds, MAX_LOG_ODDS)))
    assert (probabilities <= alone + 1e-12).all()


def test_one_pair_by_itself_has_its_own_probability_and_look_alikes_share_it():
    assert pairing_probabilities(np.array([[2.0]])) == pytest.approx(1 / (1 + np.exp(-2)))
    assert pairing_probabilities(np.full((2, 2), 6.0)).max() < 0.5
    assert pairing_probabilities(np.full((1, 2), 6.0)).max() < 0.5
    # One that fits a little better than the others is not much more probable.
    assert pairing_probabilities(np.array([[8.0, 6.0], [6.0, 8.0]])).max() < 0.5


def test_what_was_not_compared_is_no_alternative():
    probabilities = pairing_probabilities(np.array([[2.0, -np.inf], [-np.inf, -np.inf]]))
    assert probabilities[0, 0] == pytest.approx(1 / (1 + np.exp(-2)))
    assert (probabilities.ravel()[1:] == 0).all()
    assert pairing_probabilities(np.zeros((0, 3))).shape == (0, 3)
