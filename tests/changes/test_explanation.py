import dataclasses
import json

import pytest

from gmmjax.changes import Contribution, Explanation
from tests.changes.explained import CONTRIBUTIONS, explanation


def test_an_explanation_survives_json():
    plain = json.loads(json.dumps(explanation().to_dict(), allow_nan=False))
    assert Explanation.from_dict(plain) == explanation()


@pytest.mark.parametrize("name", ["value", "log_odds"])
@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_contribution_is_finite(name, number):
    with pytest.raises(ValueError, match="the fact free_share is not finite"):
        dataclasses.replace(CONTRIBUTIONS[0], **{name: number})


@pytest.mark.parametrize("number", [float("nan"), -0.1, 1.1])
def test_a_verdict_is_of_probabilities(number):
    with pytest.raises(ValueError, match="unobserved must lie between 0 and 1"):
        Explanation(0.5, 0.5, number, ())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("value", "nan", "'nan' must be finite"),
        ("log_odds", None, "None must be finite"),
        ("log_odds", True, "True must be finite"),
        ("sentence", 3, "3 must be a text"),
        ("fact", None, "None must be a text"),
    ],
)
def test_a_damaged_contribution_is_refused(name, value, message):
    with pytest.raises(ValueError, match=message):
        Contribution.from_dict(CONTRIBUTIONS[0].to_dict() | {name: value})
