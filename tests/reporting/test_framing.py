import numpy as np

from gmmjax.reporting.framing import shown_range, stretched


def test_one_stray_point_does_not_shrink_the_view(pair):
    before, _, changes = pair
    points = np.concatenate([np.repeat(before.points, 5, axis=0), [[1e4, 0, 0]]])
    lower, upper = shown_range(points, changes)
    assert (upper - lower).max() < 20
    assert (lower < before.points.min(axis=0)).all()


def test_values_without_a_range_are_in_the_middle_of_the_scale():
    np.testing.assert_array_equal(stretched(np.full(3, 7.0)), 0.5)
    assert stretched(np.arange(101.0))[[0, 100]].tolist() == [0.0, 1.0]
