import dataclasses

import numpy as np
import pytest

from gmmjax.changes import Box, Contribution
from gmmjax.reporting.explanations import (
    Facts,
    confidence_text,
    displaced_text,
    explanation_lines,
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
    facts = Facts.of(contributions(3.0, -0.01, -1.0, 2.0, -2.0), most=3, against_first=True)
    assert [one.log_odds for one in facts.listed] == [-2.0, -1.0, 3.0]


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


def lines(changes, width=80):
    return [line for line, _ in explanation_lines(changes, width)]


def test_each_change_has_its_verdict_and_its_facts(explained):
    shown = lines(explained)
    assert shown[1] == "0  ● disappeared  changed 90 %, unchanged 8 %, not observed 2 %"
    assert shown[2:5] == [
        "   +3.1  92 % of it lies where the other survey looked through",
        "   −1.3  40 % of it continues planes of the other cloud",
        "   +0.0  1 more fact together",
    ]
    assert [line[:5] for line in shown if "●" in line] == ["0  ● ", "1  ● ", "2  ● ", "● dis", "● app"]


def test_rejected_candidates_follow_with_what_speaks_against_them(explained):
    shown = lines(explained)
    start = shown.index("2 candidates were rejected:")
    assert shown[start + 1].startswith("● disappeared   31 %  unchanged     40 points at ")
    assert shown[start + 2].startswith("   −1.3  40 % of it continues")
    assert shown[start + 5].startswith("● appeared      10 %  not observed  40 points at ")


def test_only_the_likeliest_of_many_rejected_candidates_are_listed(explained):
    shown = lines(dataclasses.replace(explained, rejected=explained.rejected[:1] * 25))
    assert sum(line.startswith("● ") for line in shown) == 10
    assert "25 candidates were rejected, the likeliest 10:" in shown
    assert shown[-1] == "15 more are in report.html and changes.json."


@pytest.mark.parametrize("width", [80, 60])
def test_no_line_is_wider_than_the_terminal(explained, width):
    """Whatever the length of the sentences, and with survey coordinates."""
    sentence = "its offset is 3 times the level of detection there, where surfaces are rough and seen at a slant"
    own = explanation(contributions=(Contribution("offset", 3.0, -12.5, sentence),))
    box = Box(np.full(3, 5e6), np.array([0.4, 0.3, 0.2]), np.eye(3))
    far = dataclasses.replace(explained.rejected[0], mean=np.array([431234.5, 5812345.1, 102.3]), box=box)
    items = tuple(dataclasses.replace(item, explanation=own) for item in explained.items)
    items = (*items[:2], dataclasses.replace(items[2], kind="moved", partner=1))
    registration = dataclasses.replace(explained.registration, confidence=0.6)
    changes = dataclasses.replace(
        explained, items=items, rejected=(far, dataclasses.replace(far, explanation=own)), registration=registration
    )
    shown = lines(changes, width)
    assert max(map(len, shown)) <= width
    # What follows is below the beginning of the sentence, which is there in full.
    first = next(number for number, line in enumerate(shown) if line.startswith("  −12.5  its offset"))
    assert shown[first + 1].startswith(" " * 9) and shown[first + 1][9] != " "
    assert sentence in " ".join(line.strip() for line in shown)
    assert "431234.500, 5812345.100, 102.300" in " ".join(line.strip() for line in shown)


def test_it_is_said_where_there_is_nothing_to_explain(pair, explained):
    (text,) = lines(pair[2])
    assert text.startswith("No explanations: facts are measured on scans only")
    (text,) = lines(dataclasses.replace(pair[2], items=()))
    assert text == "Nothing to explain: nothing looked changed."
    only_rejected = lines(dataclasses.replace(explained, items=()))
    assert "2 candidates were rejected:" in only_rejected
