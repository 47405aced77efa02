import copy

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes.objects.match_facts import MatchFacts
from gmmjax.changes.objects.same_object import SameObjectModel, shipped_model

FITS = MatchFacts(
    covered_least=0.9,
    covered_most=0.95,
    explained=0.9,
    contradicted=0.0,
    bare=0.0,
    residual=1.0,
    overhang_least=0.02,
    overhang_most=0.05,
    height_difference=0.5,
    outline_difference=0.5,
    tops_known=1.0,
    tops_agree=0.95,
    observability=0.2,
    width=2.7,
    thickness=2.3,
    fewest_points=6.0,
    distance=0.0,
)


def test_what_fits_is_one_object_and_what_contradicts_is_not():
    contradicted = FITS._replace(
        covered_least=0.3,
        covered_most=0.5,
        explained=0.3,
        contradicted=0.7,
        bare=0.5,
        tops_agree=0.0,
        overhang_least=3.0,
        overhang_most=3.5,
    )
    for situation in ("standing", "free", "in place"):
        assert shipped_model().log_odds(FITS, situation) > 0 > shipped_model().log_odds(contradicted, situation)


@pytest.mark.parametrize("fact", ["contradicted", "bare", "residual", "overhang_most", "height_difference"])
def test_more_of_what_speaks_against_it_never_makes_it_more_probable(fact):
    values = [shipped_model().log_odds(FITS._replace(**{fact: value}), "standing") for value in (0.0, 0.5, 5.0)]
    assert values[0] >= values[1] >= values[2]


def test_a_fact_far_from_all_examples_counts_no_more_than_the_farthest():
    huge, larger = (FITS._replace(residual=value) for value in (1e3, 1e6))
    assert shipped_model().log_odds(huge, "free") == shipped_model().log_odds(larger, "free")


def test_the_model_survives_its_file():
    again = SameObjectModel.from_dict(shipped_model().to_dict(), "file")
    assert again.to_dict() == shipped_model().to_dict()


def changed(change):
    content = copy.deepcopy(shipped_model().to_dict())
    change(content)
    return content


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.update(schema_version=0), "is not of version 1"),
        (lambda content: content["facts"].pop(), "or of other facts"),
        (lambda content: content["situations"].pop("free"), "KeyError: 'free'"),
        (lambda content: content["situations"]["free"].update(intercept=float("nan")), "must be finite"),
        (lambda content: content["situations"]["free"].update(scales=[0.0] * len(FITS)), "scales must be positive"),
    ],
)
def test_damaged_files_are_refused_with_the_remedy(change, message):
    with pytest.raises(InputError, match=rf"^file: .*{message}.*python -m gmmjax.learning.same_object"):
        SameObjectModel.from_dict(changed(change), "file")


def test_the_parameters_are_finite():
    for own in shipped_model().situations.values():
        assert np.isfinite([*own.weights, *own.means, *own.scales, own.intercept]).all()
