"""Candidates that are examined together are near each other, and each is examined once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.evidence.batches import Batch, batches_of
from gmmjax.pair import Pair

REACH = 2.0


def clouds(seed, count):
    """Points on a floor of 40 by 10 m, and candidates of ten points each on it."""
    random = np.random.default_rng(seed)

    def cloud():
        places = random.uniform(size=(count, 1, 3)) * [40, 10, 0]
        things = (places + random.normal(0, 0.1, (count, 10, 3))).reshape(-1, 3)
        points = np.concatenate([random.uniform(size=(2_000, 3)) * [40, 10, 0], things])
        return points, np.concatenate([np.full(2_000, -1), np.repeat(np.arange(count), 10)])

    return Pair(cloud(), cloud())


def candidates_in(made):
    return made.map(lambda own: Candidates(own[0], None, None, None, own[1], None))


def batches(made, numbers, most):
    return list(batches_of(numbers, candidates_in(made), made.map(lambda own: np.ones(len(own[0]))), REACH, most))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 12), st.sampled_from([50, 400, 1_500]))
def test_each_candidate_is_in_one_batch_and_each_batch_is_small(seed, count, most):
    made = clouds(seed, count)
    chosen = Pair(list(range(count)), list(range(0, count, 2)))
    found = batches(made, chosen, most)
    for side in ("before", "after"):
        assert sorted(n for batch in found for n in getattr(batch.numbers, side)) == getattr(chosen, side)
    for batch in found:
        near = made.map(lambda own: np.flatnonzero(batch.within(own[0])))  # noqa: B023
        for own, rows in zip(near, batch.rows, strict=True):
            np.testing.assert_array_equal(own, rows)
        assert max(near.map(len)) <= most or sum(batch.numbers.map(len)) == 1


def test_candidates_that_fit_are_one_batch():
    made, numbers = clouds(0, 8), Pair([0, 3], [5])
    (batch,) = batches(made, numbers, 4_200)
    assert batch.numbers == numbers
    whole = Batch.of(numbers, candidates_in(made), REACH)
    np.testing.assert_array_equal(batch.tree.data, whole.tree.data)


def test_the_points_of_a_candidate_are_within_reach_with_all_around_them():
    made = clouds(1, 10)
    for batch in batches(made, Pair(list(range(10)), []), 500):
        points, labels = made.before
        own = points[np.isin(labels, batch.numbers.before)]
        apart = np.linalg.norm(points[:, None] - own, axis=2).min(axis=1)
        # The places stand for points that are up to a voxel of an eighth of the reach away.
        assert batch.within(points)[apart < REACH * (1 - np.sqrt(3) / 8)].all()
        assert not batch.within(points)[apart > REACH * (1 + np.sqrt(3) / 8)].any()


@pytest.mark.parametrize("seed", [0, 1])
def test_the_order_of_the_points_makes_no_other_batches(seed):
    made, numbers = clouds(seed, 9), Pair(list(range(9)), [1, 4])
    order = np.random.default_rng(seed).permutation(len(made.before[0]))
    shuffled = made.map(lambda own: (own[0][order], own[1][order]))
    found, again = (batches(own, numbers, 600) for own in (made, shuffled))
    assert len(found) > 1
    assert [batch.numbers for batch in found] == [batch.numbers for batch in again]


def test_a_candidate_with_more_around_it_is_examined_alone():
    made = clouds(2, 3)
    found = batches(made, Pair([0, 1, 2], [0, 1, 2]), 1)
    assert [sum(batch.numbers.map(len)) for batch in found] == [1] * 6


def test_points_that_are_joined_before_they_are_examined_count_as_what_they_become():
    made, numbers = clouds(0, 8), Pair(list(range(8)), list(range(8)))
    quarters = made.map(lambda own: np.full(len(own[0]), 0.25))
    assert len(batches(made, numbers, 600)) > 1
    (batch,) = batches_of(numbers, candidates_in(made), quarters, REACH, 600)
    assert batch.numbers == numbers
