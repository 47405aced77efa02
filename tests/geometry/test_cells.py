import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.geometry import occupied_cells


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.floats(0.01, 10.0))
def test_every_point_is_in_its_cell_and_cells_are_in_the_order_of_the_axes(seed, dimension, side):
    points = np.random.default_rng(seed).normal(size=(50, dimension))
    cells, cell = occupied_cells(points, side)
    expected, inverse = np.unique(np.floor(points / side), axis=0, return_inverse=True)
    np.testing.assert_array_equal(cells, expected)
    np.testing.assert_array_equal(cell, inverse.reshape(-1))


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((1, 3), -0.5), np.full((7, 2), 3.0)])
def test_no_points_and_equal_points(points):
    cells, cell = occupied_cells(points, 1.0)
    assert len(cells) == min(1, len(points))
    np.testing.assert_array_equal(cell, np.zeros(len(points)))
