from gmmjax.pair import Pair, each


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
