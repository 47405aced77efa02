import dataclasses

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.evaluation import LabelledCloud, LabelledPair
from gmmjax.thesis.chapter4.accuracy import Confusion, confusion, opposite_confusion, overlap_confusion

# Before: things 0, 1 and 2 of four points each. After: 0 and 1 again, and thing 3, which appeared.
THINGS_BEFORE, THINGS_AFTER = np.repeat([0, 1, 2], 4), np.repeat([0, 1, 3], 4)
UNCHANGED, APPEARED = np.full(12, -1), np.repeat([-1, -1, 0], 4)
PAIR = LabelledPair(
    "a",
    LabelledCloud(np.zeros((12, 3)), UNCHANGED, things=THINGS_BEFORE),
    LabelledCloud(np.zeros((12, 3)), APPEARED, things=THINGS_AFTER),
)
NOTHING = UNCHANGED


def labels(**segments):
    """Labels with these slices as segments 0, 1, ..."""
    result = np.full(12, -1)
    for number, places in enumerate(segments.values()):
        result[places] = number
    return result


def test_what_is_right_has_an_accuracy_of_one():
    counts = confusion(PAIR, NOTHING, APPEARED)
    assert counts == Confusion(true_positives=1, false_positives=0, found=1, missed=0, true_negatives=5)
    assert (counts.accuracy, counts.precision, counts.recall, counts.f1) == (1, 1, 1, 1)


def test_to_find_nothing_is_accurate_and_useless():
    """As the thesis says: true negatives outnumber all else."""
    counts = confusion(PAIR, NOTHING, NOTHING)
    assert counts == Confusion(missed=1, true_negatives=5)
    assert counts.accuracy == pytest.approx(5 / 6) and counts.f1 == 0


def test_a_thing_with_a_false_segment_is_no_true_negative():
    """Two segments in the things 0 and 2 of the before cloud, one of them at the edge of thing 1 as well."""
    counts = confusion(PAIR, labels(first=slice(0, 3), second=slice(7, 11)), APPEARED)
    assert counts == Confusion(true_positives=1, false_positives=2, found=1, missed=0, true_negatives=3)
    assert counts.accuracy == pytest.approx(4 / 6) and counts.precision == pytest.approx(1 / 3)


def test_two_false_segments_in_one_thing_take_one_true_negative():
    counts = confusion(PAIR, labels(first=slice(0, 2), second=slice(2, 4)), APPEARED)
    assert (counts.false_positives, counts.true_negatives) == (2, 4)


def test_a_true_segment_that_reaches_into_an_unchanged_thing_leaves_it_a_true_negative():
    counts = confusion(PAIR, NOTHING, labels(found=slice(6, 12)))
    assert counts == Confusion(true_positives=1, found=1, true_negatives=5)


def test_points_of_no_thing_are_no_true_negatives():
    after = dataclasses.replace(PAIR.after, things=np.where(THINGS_AFTER == 1, -1, THINGS_AFTER))
    pair = dataclasses.replace(PAIR, after=after)
    assert confusion(pair, NOTHING, NOTHING).true_negatives == 4
    stray = confusion(pair, NOTHING, labels(stray=slice(4, 8)))
    assert (stray.false_positives, stray.true_negatives) == (1, 4)


def test_a_thing_that_changed_in_part_is_what_most_of_it_is():
    """A voxel at the foot of an object holds points of the floor as well."""
    for changed, expected in ((1, 5), (2, 4), (3, 4)):
        truth = APPEARED.copy()
        truth[:changed] = 0
        pair = dataclasses.replace(PAIR, after=dataclasses.replace(PAIR.after, truth=truth))
        assert confusion(pair, NOTHING, NOTHING).true_negatives == expected


def test_opposite_reports_are_those_of_the_type_that_did_not_happen():
    counts = opposite_confusion(PAIR, labels(gone=slice(0, 3)), labels(false=slice(0, 3)), "disappeared")
    assert counts == Confusion(false_positives=1, true_negatives=2)
    assert counts.accuracy == pytest.approx(2 / 3)
    assert opposite_confusion(PAIR, NOTHING, APPEARED, "disappeared").accuracy == 1
    mirrored = LabelledPair("b", PAIR.after, PAIR.before)
    assert opposite_confusion(mirrored, APPEARED, labels(new=slice(0, 3)), "appeared") == counts


def test_opposite_reports_need_a_pair_with_one_type_alone():
    with pytest.raises(InputError, match="a: something appeared in it"):
        opposite_confusion(PAIR, NOTHING, NOTHING, "appeared")


def test_counts_of_pairs_are_added_before_they_are_divided():
    total = Confusion(3, 1, 2, 0, 4) + Confusion(0, 1, 0, 2, 1)
    assert total == Confusion(3, 2, 2, 2, 5)
    assert (total.accuracy, total.precision, total.recall) == (8 / 12, 3 / 5, 1 / 2)
    assert Confusion().accuracy == Confusion().f1 == 1


def test_pairs_without_things_are_refused():
    pair = dataclasses.replace(PAIR, before=dataclasses.replace(PAIR.before, things=None))
    with pytest.raises(InputError, match="a: has no things"):
        confusion(pair, NOTHING, NOTHING)


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
    counts = overlap_confusion(pair, nothing, labels)
    assert (counts.true_positives, counts.false_positives, counts.found, counts.missed) == (1, 1, 1, 0)
    # The wall holds the false report; the other cloud's thing holds none.
    assert counts.true_negatives == 1
    assert confusion(pair, nothing, labels).true_positives == 0
    uncounted = dataclasses.replace(cloud, not_counted=frozenset({4}))
    counts = overlap_confusion(LabelledPair("pair", empty, uncounted), nothing, labels)
    assert (counts.true_positives, counts.false_positives, counts.found, counts.missed) == (0, 1, 0, 0)
