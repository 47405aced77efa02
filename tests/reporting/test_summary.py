import dataclasses

import numpy as np
import pytest

from gmmjax.reporting.summary import answer, change_rows, dropped_rows, percent


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
    ("unit", "size"), [(1, "2.00 × 1.00 × 0.50"), (0.01, "0.0200 × 0.0100 × 0.0050"), (1000, "2000 × 1000 × 500")]
)
def test_sizes_have_three_digits_in_any_unit(pair, unit, size):
    box = dataclasses.replace(pair[2].items[0].box, extent=np.array([2, 1, 0.5]) * unit)
    item = dataclasses.replace(pair[2].items[0], box=box)
    assert change_rows(dataclasses.replace(pair[2], items=(item,)))[0].cells[-1] == size


def test_dropped_rows_are_those_of_the_diagnostics(pair):
    assert dropped_rows(pair[2]) == {"before": 1}
    assert dropped_rows(dataclasses.replace(pair[2], diagnostics={})) == {}
