import dataclasses

import pytest

from gmmjax.changes import Contribution
from gmmjax.reporting.explanations import (
    Facts,
    confidence_text,
    displaced_text,
    rejected_text,
    signed,
    verdict_text,
)
from tests.changes.explained import displaced, explanation


def contributions(*log_odds):
    return explanation(contributions=tuple(Contribution(f"fact {one}", 1.0, one, f"fact {one}") for one in log_odds))


@pytest.mark.parametrize(("log_odds", "text"), [(3.14, "+3.1"), (-0.36, "−0.4"), (-0.01, "+0.0"), (12.0, "+12.0")])
def test_log_odds_have_a_sign(log_odds, text):
    assert signed(log_odds) == text


def test_the_verdict_has_all_three_probabilities():
    assert verdict_text(explanation(0.953, 0.036)) == "changed 95 %, unchanged 4 %, not observed 1 %"


def test_the_strongest_facts_are_listed_and_the_others_added_up():
    facts = Facts.of(contributions(0.05, -2.0, 0.5, 3.0), most=2)
    assert [one.log_odds for one in facts.listed] == [3.0, -2.0]
    assert facts.sum_of_others == ("+0.6", "2 more facts together")
    assert Facts.of(contributions(0.05, 2.0)).sum_of_others == ("+0.1", "1 more fact together")
    assert Facts.of(contributions(0.05, 0.05)).sum_of_others == ("+0.1", "2 facts together")
    assert Facts.of(contributions(2.0)).sum_of_others is None


def test_the_facts_that_decided_come_first_where_they_are_asked_for():
    facts = Facts.of(contributions(3.0, -0.01, -1.0, 2.0, -2.0), most=3, first="against")
    assert [one.log_odds for one in facts.listed] == [-2.0, -1.0, 3.0]
    assert Facts.of(contributions(-3.0, 1.0), most=1, first="for").listed[0].log_odds == 1.0


def test_rejected_candidates_are_counted(explained):
    assert rejected_text(explained) == "2 candidates were rejected"
    assert rejected_text(dataclasses.replace(explained, rejected=explained.rejected[:1])) == "1 candidate was rejected"
    assert rejected_text(dataclasses.replace(explained, rejected=())) is None


def test_surfaces_that_are_off_and_were_judged_unchanged_are_told(explained):
    assert displaced_text(explained) is None
    of_one = displaced_text(dataclasses.replace(explained, rejected=(*explained.rejected, displaced(0.64, 9000))))
    assert of_one.startswith("Most of the 9,000 points at ") and "lie surely off the other scan's surface" in of_one
    several = displaced(0.51, 70), displaced(0.9, 12_345)
    assert displaced_text(dataclasses.replace(explained, rejected=several)).startswith(
        "Most points of 2 candidates, the largest of 12,345 points at "
    )


@pytest.mark.parametrize("candidate", [displaced(0.5, 9000), displaced(0.9, 9000, "not observed")])
def test_half_of_a_surface_and_what_was_not_observed_are_no_displacement(explained, candidate):
    assert displaced_text(dataclasses.replace(explained, rejected=(candidate,))) is None


def test_a_doubtful_registration_is_said_to_lower_the_probabilities(explained):
    assert confidence_text(explained) is None
    registration = dataclasses.replace(explained.registration, confidence=0.6)
    assert "confidence of 60 %" in confidence_text(dataclasses.replace(explained, registration=registration))
