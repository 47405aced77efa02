import dataclasses

import numpy as np
import pytest

from gmmjax.changes.registration import Registration
from gmmjax.geometry.rigid import rigid_transform
from gmmjax.reporting.summary import (
    HEADINGS,
    answer,
    change_rows,
    dropped_rows,
    percent,
    registration_text,
    unobserved_text,
)


def test_answer_counts_each_kind(pair):
    assert answer(pair[2]) == "3 changes: 1 appeared, 1 disappeared, 1 moved"


def test_a_moved_object_counts_once(pair):
    before, after = (dataclasses.replace(pair[2].items[1], partner=partner) for partner in (1, 0))
    assert answer(dataclasses.replace(pair[2], items=(before, after))) == "1 change: 1 moved"
    assert change_rows(dataclasses.replace(pair[2], items=(before, after)))[0].cells[1] == "moved (with 1)"


def test_no_change(pair):
    assert answer(dataclasses.replace(pair[2], items=())) == "No change found"


@pytest.mark.parametrize(
    ("probability", "text"), [(1.0, "100 %"), (0.9999, "99 %"), (0.995, "99 %"), (0.505, "50 %"), (0.75, "75 %")]
)
def test_only_certainty_is_a_hundred_percent(probability, text):
    assert percent(probability) == text


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (0, None),
        (1, "Not observed by the other survey: under 1 % of the before cloud."),
        (3, "Not observed by the other survey: under 1 % of the before cloud."),
        (4, "Not observed by the other survey: 1 % of the before cloud."),
        (399, "Not observed by the other survey: 99 % of the before cloud."),
    ],
)
def test_what_was_not_observed_is_never_none_where_there_is_some(pair, rows, text):
    unobserved = {"unobserved_before": np.arange(400) < rows, "unobserved_after": np.zeros(500, bool)}
    assert unobserved_text(dataclasses.replace(pair[2], **unobserved)) == text


def test_headings_name_no_unit():
    assert not any("(" in heading for heading in HEADINGS)


@pytest.mark.parametrize(
    ("unit", "size"), [(1, "2.00 × 1.00 × 0.50"), (0.01, "0.0200 × 0.0100 × 0.0050"), (1000, "2000 × 1000 × 500")]
)
def test_sizes_have_three_digits_in_any_unit(pair, unit, size):
    box = dataclasses.replace(pair[2].items[0].box, extent=np.array([2, 1, 0.5]) * unit)
    item = dataclasses.replace(pair[2].items[0], box=box)
    assert change_rows(dataclasses.replace(pair[2], items=(item,)))[0].cells[-1] == size


def test_dropped_rows_are_those_of_the_diagnostics(pair):
    assert dropped_rows(pair[2]) == {"before": 1}
    assert dropped_rows(dataclasses.replace(pair[2], diagnostics={})) == {}


def test_the_registration_is_told_in_a_sentence(pair):
    transform = rigid_transform(translation=np.array([0.3, 0, 0]))
    record = Registration(transform, True, 0.3, 0.0013, 0.0033, 0.96)
    assert registration_text(pair[2]) is None
    assert registration_text(dataclasses.replace(pair[2], registration=record)) == (
        "Registration: the after cloud was moved by 0.3 and rotated by 0° onto the before cloud; "
        "residual 0.0033 → 0.0013; overlap 96 %."
    )
    doubtful = dataclasses.replace(record, applied=False, transform=np.eye(4), confidence=0.4)
    assert registration_text(dataclasses.replace(pair[2], registration=doubtful)) == (
        "Registration: none was needed; residual 0.0013; overlap 96 %; confidence 40 %."
    )
