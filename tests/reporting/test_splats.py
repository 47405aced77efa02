import numpy as np
import pytest

from gmmjax.reporting.splats import Projected, depth_steps, enclosed, nearest_points


def projected(*points):
    """Points given as column, row, depth."""
    return Projected(*np.array(points, float).reshape(-1, 3).T)


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearest_point_is_seen_whatever_the_order(order):
    points = projected(*[(5, 4, 3.0), (6, 4, 2.0), (7, 4, 9.0)][::order])
    nearest = nearest_points(points, 3, 8, 12)
    assert points.depth[nearest[4, 4:7]].tolist() == [3.0, 2.0, 2.0]
    assert (nearest >= 0).sum() == 5 * 3


def test_squares_are_cut_at_the_edges_and_points_behind_the_eye_are_not_drawn():
    points = projected((0, 0, 1), (12, 8, 1), (-100, 4, 1), (6, 1e9, 1), (6, 4, -1), (6, 4, 0))
    nearest = nearest_points(points, 4, 8, 12)
    assert np.argwhere(nearest >= 0).tolist() == [[0, 0], [0, 1], [1, 0], [1, 1], [6, 10], [6, 11], [7, 10], [7, 11]]


def test_no_points_leave_all_pixels_empty():
    assert (nearest_points(projected(), 4, 8, 12) == -1).all()


def test_only_gaps_between_covered_pixels_are_enclosed():
    covered = np.zeros((5, 9), bool)
    covered[2, [1, 3, 8]] = True
    assert np.argwhere(enclosed(covered, 2)).tolist() == [[2, 2]]
    assert not enclosed(covered, 0).any()
    assert np.argwhere(enclosed(covered.T, 2)).tolist() == [[2, 2]]


def test_steps_of_depth_are_those_behind_neighbours():
    depth = np.full((4, 4), np.inf, np.float32)
    depth[:, 1], depth[:, 2] = 1.0, 2.0
    steps = depth_steps(depth, 0.4)
    assert (steps[:, [0, 1, 3]][:, 1:2] == 0).all()
    np.testing.assert_allclose(steps[:, 2], 0.4 / 4, rtol=1e-6)
    np.testing.assert_allclose(depth_steps(depth, 3.0)[:, 2], 1 / 4, rtol=1e-6)
    # Depths are compared by their ratio: a scene in millimetres looks like one in metres.
    np.testing.assert_allclose(depth_steps(1000 * depth, 0.4)[:, :3], steps[:, :3], atol=1e-5)
