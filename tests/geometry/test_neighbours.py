import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gmmjax.geometry import points_within, within_box


@given(st.integers(0, 2**32 - 1))
def test_within_a_box_are_the_points_between_its_corners(seed):
    generator = np.random.default_rng(seed)
    points = generator.integers(0, 6, (100, 3)).astype(float)
    lower, upper = np.sort(generator.integers(0, 6, (2, 3)).astype(float), axis=0)
    inside = ((points >= lower) & (points <= upper)).all(axis=1)
    np.testing.assert_array_equal(within_box(points, lower, upper), np.flatnonzero(inside))


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.ones((4, 3))])
def test_nothing_is_in_a_box_beside_all_points(points):
    assert len(within_box(points, np.full(3, 2.0), np.full(3, 3.0))) == 0


@given(st.integers(0, 2**31 - 1), st.floats(0.01, 1.5))
def test_within_a_distance_are_the_points_that_have_one_of_the_others_so_near(seed, reach):
    random = np.random.default_rng(seed)
    points, others = random.uniform(-1, 1, size=(60, 3)), random.uniform(0, 1, size=(5, 3))
    distances = np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)
    np.testing.assert_array_equal(points_within(cKDTree(others), points, reach), points[distances < reach])
