import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.evaluation import Scores, score_pair

NOTHING = np.full(4, -1)


def labels(*values):
    return np.array(values)


def test_a_perfect_detection_scores_one():
    truth = labels(-1, -1, 0, 0)
    scores = score_pair(truth, NOTHING, truth, NOTHING)
    assert (scores.precision, scores.recall, scores.f1, scores.point_f1) == (1, 1, 1, 1)


def test_a_segment_is_true_when_more_than_half_of_it_changed():
    """Two of four points are a half: a false positive; three are a true one."""
    assert score_pair(labels(5, 5, 5, 5), NOTHING, labels(-1, -1, 0, 0), NOTHING).precision == 0
    assert score_pair(labels(5, 5, 5, 5), NOTHING, labels(-1, 0, 0, 0), NOTHING).precision == 1


def test_a_change_is_found_when_half_of_it_lies_in_true_segments():
    truth = labels(-1, -1, 0, 0, 0, 0)
    none = np.full(6, -1)
    assert score_pair(labels(-1, -1, 7, 7, -1, -1), none, truth, none).recall == 1
    assert score_pair(labels(-1, -1, 7, -1, -1, -1), none, truth, none).recall == 0


def test_both_clouds_count():
    truth = labels(-1, -1, 0, 0)
    scores = score_pair(NOTHING, truth, truth, truth)
    assert scores.precision == 1 and scores.recall == 0.5
    assert scores.f1 == pytest.approx(2 / 3)


def test_nothing_changed():
    scores = score_pair(NOTHING, NOTHING, NOTHING, NOTHING)
    assert scores.f1 == 1 and scores.false_segments == 0
    assert score_pair(labels(3, 3, 4, -1), NOTHING, NOTHING, NOTHING).false_segments == 2


@given(st.lists(st.tuples(*[st.integers(0, 9)] * 7), min_size=2, max_size=4))
def test_scores_add_up_before_they_are_divided(rows):
    together = sum((Scores(*row) for row in rows), Scores())
    assert together.segments == sum(row[1] for row in rows)
    assert together.found == sum(row[2] for row in rows)
