import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.evaluation import LabelledCloud, LabelledPair, Scores, score_pair
from gmmjax.evaluation.scores import FALSE, NEITHER, counted_points, false_segments, score_labelled_pair, segment_truth

NOTHING = np.full(4, -1)


def labels(*values):
    return np.array(values)


def scored(found, truth, moved=(), unseen=None, not_counted=((), ())):
    """The scores of labels of both clouds; `unseen` is of the before cloud."""
    clouds = [
        LabelledCloud(np.zeros((len(own), 3)), own, unseen if side == 0 else None, None, frozenset(not_counted[side]))
        for side, own in enumerate(truth)
    ]
    return score_labelled_pair(LabelledPair("a", *clouds), *found, moved)


def test_a_perfect_detection_scores_one():
    truth = labels(-1, -1, 0, 0)
    scores = score_pair(truth, NOTHING, truth, NOTHING)
    assert (scores.precision, scores.recall, scores.f1) == (1, 1, 1)
    assert (scores.point_precision, scores.point_recall, scores.point_f1) == (1, 1, 1)


def test_a_segment_is_true_when_more_than_half_of_it_changed():
    """Two of four points are a half: a false positive; three are a true one."""
    assert score_pair(labels(5, 5, 5, 5), NOTHING, labels(-1, -1, 0, 0), NOTHING).precision == 0
    assert score_pair(labels(5, 5, 5, 5), NOTHING, labels(-1, 0, 0, 0), NOTHING).precision == 1


def test_a_change_is_found_when_half_of_it_lies_in_true_segments():
    truth = labels(-1, -1, 0, 0, 0, 0)
    none = np.full(6, -1)
    assert score_pair(labels(-1, -1, 7, 7, -1, -1), none, truth, none).recall == 1
    assert score_pair(labels(-1, -1, 7, -1, -1, -1), none, truth, none).recall == 0


def test_points_are_counted_one_by_one():
    scores = score_pair(labels(3, 3, 3, -1, -1), NOTHING, labels(-1, 0, 0, 0, 0), NOTHING)
    assert scores.point_precision == pytest.approx(2 / 3) and scores.point_recall == 0.5
    assert scores.point_f1 == pytest.approx(4 / 7)


def test_both_clouds_count():
    truth = labels(-1, -1, 0, 0)
    scores = score_pair(NOTHING, truth, truth, truth)
    assert scores.precision == 1 and scores.recall == 0.5
    assert scores.f1 == pytest.approx(2 / 3)


def test_nothing_changed():
    scores = score_pair(NOTHING, NOTHING, NOTHING, NOTHING)
    assert scores.f1 == 1 and scores.false_segments == 0
    scores = score_pair(labels(3, 3, 4, -1), NOTHING, NOTHING, NOTHING)
    assert scores.false_segments == scores.false_in_unchanged == 2 and scores.unchanged_pairs == 1


def test_false_segments_of_changed_pairs_are_not_those_of_unchanged_ones():
    scores = score_pair(labels(3, 3, -1, -1), NOTHING, labels(-1, -1, 0, 0), NOTHING)
    assert scores.false_segments == 1 and scores.false_in_unchanged == scores.unchanged_pairs == 0


@pytest.mark.parametrize("found", [[-1, -1, -1, -1], [-1, -1, 5, 5]], ids=["missed", "found"])
def test_changes_that_are_not_counted_neither_help_nor_hurt(found):
    truth = labels(-1, -1, 0, 0, 1, 1)
    scores = scored((labels(*found, 6, 6), NOTHING), (truth, NOTHING), not_counted=([0], ()))
    assert scores == score_pair(labels(-1, -1, -1, -1, 6, 6), NOTHING, labels(-1, -1, -1, -1, 1, 1), NOTHING)


def test_a_segment_is_judged_by_what_is_most_of_its_changed_points():
    """Three of not-counted changes with one neighbour are neither; with three of a counted one it is true."""
    truth = labels(0, 0, 0, -1, 1, 1, 1)
    cloud = LabelledCloud(np.zeros((7, 3)), truth, not_counted=frozenset({0}))
    assert segment_truth(labels(9, 9, 9, 9, -1, -1, -1), cloud) == {9: NEITHER}
    assert segment_truth(labels(9, 9, -1, 9, 9, 9, 9), cloud) == {9: 1}
    assert segment_truth(labels(9, -1, -1, 9, -1, -1, -1), cloud) == {9: FALSE}
    assert false_segments(labels(9, 7, 7, 9, 8, 8, -1), cloud) == [9]
    np.testing.assert_array_equal(counted_points(cloud), truth != 0)


def test_the_fringe_of_a_segment_that_is_neither_does_not_hurt():
    scores = scored((labels(9, 9, 9, 9), NOTHING), (labels(0, 0, 0, -1), NOTHING), not_counted=([0], ()))
    assert scores.labelled_points == scores.segments == 0


def test_a_shadow_that_is_labelled_as_a_change_is_false_and_named():
    unseen = np.array([True, True, True, False])
    scores = scored((labels(2, 2, 5, 5), NOTHING), (labels(-1, -1, 0, 0), NOTHING), unseen=unseen)
    assert scores.false_segments == 1 and scores.shadow_points == 2
    assert scores.true_points == 2


MOVED = labels(-1, -1, 0, 0), labels(0, 0, -1, -1)


def test_a_moved_object_is_a_change_of_either_cloud():
    scores = score_pair(*MOVED, *MOVED)
    assert scores.changes == scores.found == 2
    assert (scores.moved, scores.moved_found, scores.moved_false) == (1, 0, 0)


def test_a_moved_object_is_recognised_from_the_one_place_to_the_other():
    before, after = labels(-1, -1, 4, 4), labels(7, 7, -1, -1)
    assert scored((before, after), MOVED, [(4, 7)]).moved_found == 1
    elsewhere = scored((before, labels(-1, -1, 7, 7)), MOVED, [(4, 7)])
    assert (elsewhere.moved_found, elsewhere.moved_false) == (0, 1)


def test_two_objects_taken_for_one_that_moved_are_false():
    truth = labels(-1, -1, 0, 0), labels(1, 1, -1, -1)
    scores = scored(truth, truth, [(0, 1)])
    assert (scores.moved, scores.moved_found, scores.moved_false) == (0, 0, 1)


def test_an_object_whose_other_place_was_out_of_sight_need_not_be_recognised():
    scores = scored(MOVED, MOVED, [(0, 0)], not_counted=((), [0]))
    assert (scores.moved, scores.moved_found, scores.moved_false) == (0, 0, 0)


@given(st.lists(st.tuples(*[st.integers(0, 9)] * 12), min_size=2, max_size=4))
def test_scores_add_up_before_they_are_divided(rows):
    together = sum((Scores(*row) for row in rows), Scores())
    assert together.segments == sum(row[1] for row in rows)
    assert together.found == sum(row[2] for row in rows)
    assert together.moved_found == sum(row[11] for row in rows)
