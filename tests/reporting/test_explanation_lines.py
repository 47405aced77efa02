import dataclasses

import numpy as np
import pytest

from gmmjax.changes import Box, Contribution
from gmmjax.reporting.explanation_lines import explanation_lines
from tests.changes.explained import explanation


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
