import numpy as np
import pytest

from gmmjax.pair import Pair, each, parallel_map


def test_a_pair_is_mapped_and_swapped_side_by_side():
    pair = Pair("old", "later")
    assert pair.map(len) == Pair(before=3, after=5)
    assert pair.swapped == Pair(before="later", after="old")
    assert pair.swapped.swapped == pair
    before, after = pair
    assert (before, after) == (pair.before, pair.after)


def test_each_takes_the_same_side_of_every_pair():
    own = Pair(1, 2)
    told = each(lambda own, other, name: f"{name}: {own}, not {other}", own, own.swapped, Pair("before", "after"))
    assert told == Pair("before: 1, not 2", "after: 2, not 1")
    assert isinstance(each(abs, Pair(-1, 2)), Pair)


def test_each_asks_for_the_before_side_first():
    asked = []
    each(asked.append, Pair("before", "after"))
    assert asked == ["before", "after"]


def test_both_sides_at_once_are_what_they_are_one_after_the_other():
    sides = Pair(np.arange(5.0), np.arange(3.0))
    for pair in (sides, sides.swapped):
        np.testing.assert_equal(list(parallel_map(np.cumsum, pair)), list(each(np.cumsum, pair)))
    with pytest.raises(ZeroDivisionError):
        parallel_map(lambda own: 1 // own, Pair(1, 0))
