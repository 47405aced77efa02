import dataclasses
from collections import Counter

import numpy as np
import pytest

from gmmjax.errors import ComputationError, InputError
from gmmjax.evaluation import Detection, LabelledCloud, LabelledPair, PairSource
from gmmjax.thesis.chapter4.accuracy import COUNTS, Group, confusion, count_groups, measures

# Before: things 0, 1 and 2 of four points each. After: 0 and 1 again, and thing 3, which appeared.
THINGS_BEFORE, THINGS_AFTER = np.repeat([0, 1, 2], 4), np.repeat([0, 1, 3], 4)
NOTHING, APPEARED = np.full(12, -1), np.repeat([-1, -1, 0], 4)
PAIR = LabelledPair(
    "a",
    LabelledCloud(np.zeros((12, 3)), NOTHING, things=THINGS_BEFORE),
    LabelledCloud(np.zeros((12, 3)), APPEARED, things=THINGS_AFTER),
)


def labels(*segments):
    """Labels with these slices as segments 0, 1, ..."""
    result = np.full(12, -1)
    for number, places in enumerate(segments):
        result[places] = number
    return result


def counted(pair, before, after, kind=""):
    """True and false positives, found and missed changes, true negatives."""
    counts = confusion(pair, Detection(before, after))
    return tuple(counts[kind + name] for name in COUNTS)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        pytest.param(NOTHING, APPEARED, (1, 0, 1, 0, 5), id="right"),
        pytest.param(NOTHING, NOTHING, (0, 0, 0, 1, 5), id="nothing found"),
        # In the things 0 and 2, one of them at the edge of thing 1 as well.
        pytest.param(labels(slice(0, 3), slice(7, 11)), APPEARED, (1, 2, 1, 0, 3), id="two false segments"),
        pytest.param(labels(slice(0, 2), slice(2, 4)), NOTHING, (0, 2, 0, 1, 4), id="two false in one thing"),
        pytest.param(NOTHING, labels(slice(6, 12)), (1, 0, 1, 0, 5), id="true segment reaching into a thing"),
    ],
)
def test_a_thing_without_a_false_segment_is_a_true_negative(before, after, expected):
    assert counted(PAIR, before, after) == expected


def test_to_find_nothing_is_accurate_and_useless():
    """As the thesis says: true negatives outnumber all else."""
    found = measures(confusion(PAIR, Detection(NOTHING, NOTHING)))
    assert found["accuracy"] == pytest.approx(5 / 6) and found["f1"] == 0
    assert set(measures(confusion(PAIR, Detection(NOTHING, APPEARED))).values()) == {1.0}


def test_points_of_no_thing_are_no_true_negatives():
    after = dataclasses.replace(PAIR.after, things=np.where(THINGS_AFTER == 1, -1, THINGS_AFTER))
    pair = dataclasses.replace(PAIR, after=after)
    assert counted(pair, NOTHING, NOTHING)[-1] == 4
    assert counted(pair, NOTHING, labels(slice(4, 8))) == (0, 1, 0, 1, 4)


@pytest.mark.parametrize(("changed", "expected"), [(1, 5), (2, 4), (3, 4)])
def test_a_thing_that_changed_in_part_is_what_most_of_it_is(changed, expected):
    """A voxel at the foot of an object holds points of the floor as well."""
    truth = APPEARED.copy()
    truth[:changed] = 0
    pair = dataclasses.replace(PAIR, after=dataclasses.replace(PAIR.after, truth=truth))
    assert counted(pair, NOTHING, NOTHING)[-1] == expected


def test_opposite_reports_are_those_of_the_cloud_in_which_nothing_changed():
    found = confusion(PAIR, Detection(labels(slice(0, 3)), labels(slice(0, 3))))
    assert (found["opposite false_positives"], found["opposite true_negatives"]) == (1, 2)
    assert measures(found, "opposite ")["accuracy"] == pytest.approx(2 / 3)
    mirrored = confusion(LabelledPair("b", PAIR.after, PAIR.before), Detection(APPEARED, labels(slice(0, 3))))
    assert mirrored["opposite false_positives"] == 1 and mirrored["opposite true_negatives"] == 2
    assert measures(confusion(PAIR, Detection(NOTHING, APPEARED)), "opposite ")["accuracy"] == 1


def test_counts_of_pairs_are_added_before_they_are_divided():
    total = Counter(dict(zip(COUNTS, (3, 1, 2, 0, 4), strict=True))) + Counter(false_positives=1, missed=2)
    found = measures(total)
    assert (found["accuracy"], found["precision"], found["recall"]) == (7 / 11, 3 / 5, 1 / 2)
    assert set(measures(Counter()).values()) == {1.0}


def test_pairs_without_things_are_refused():
    pair = dataclasses.replace(PAIR, before=dataclasses.replace(PAIR.before, things=None))
    with pytest.raises(InputError, match="a: has no things"):
        confusion(pair, Detection(NOTHING, NOTHING))


def test_what_fails_is_left_out_and_listed():
    def broken(pair):
        raise ValueError("no")

    def blind(pair):
        return Detection(NOTHING, NOTHING)

    sources, stages = [PairSource("a", "g", "c", lambda: PAIR)], []
    groups = [Group("one", {"blind": blind, "broken": broken}, sources)] * 2
    counts, failures = count_groups(groups, lambda stage, share: stages.append(share))
    assert counts["one", "blind"]["pairs"] == 2 and ("one", "broken") not in counts
    assert [str(failure) for failure in failures] == ["c, a, broken: ValueError: no"] * 2
    assert stages[0] == 0 and 0.5 in stages and max(stages) < 1
    with pytest.raises(ComputationError, match="nothing could be run: c, a, broken: ValueError: no"):
        count_groups([Group("one", {"broken": broken}, sources)], lambda stage, share: None)


def test_a_report_that_overlaps_a_change_is_right_by_the_thesiss_count():
    # A wall of 100 points of which 30 changed with 20 more beside them, and a report of which a fifth is true.
    truth = np.full(150, -1)
    truth[100:] = 4
    things = np.repeat([0, 4], [100, 50])
    labels = np.full(150, -1)
    labels[60:110] = 0
    labels[:20] = 1
    cloud = LabelledCloud(np.zeros((150, 3)), truth, things=things)
    empty = LabelledCloud(np.zeros((1, 3)), np.full(1, -1), things=np.zeros(1, int))
    pair = LabelledPair("pair", empty, cloud)
    nothing = np.full(1, -1)
    assert counted(pair, nothing, labels, "overlap ")[:4] == (1, 1, 1, 0)
    assert counted(pair, nothing, labels)[0] == 0
    uncounted = dataclasses.replace(cloud, not_counted=frozenset({4}))
    assert counted(LabelledPair("pair", empty, uncounted), nothing, labels, "overlap ")[:4] == (0, 1, 0, 0)
