import numpy as np
import pytest

from gmmjax.scenes import Ellipsoid, Revolved, Solid, small_motion

CUP = Revolved.standing([(0.0, 0.0), (0.04, 0.0), (0.05, 0.1), (0.045, 0.1), (0.035, 0.01), (0.0, 0.01)], label=3)
DOWN = np.array([[0.0, 0.0, -1.0]])


def rays(count, target):
    """From one place outside, to about a target."""
    origin = np.array([0.5, -0.4, 0.6])
    directions = target + np.random.default_rng(0).uniform(-0.2, 0.2, (count, 3)) - origin
    return origin, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_a_closed_cylinder_is_hit_where_the_round_solid_is():
    origin, directions = rays(2000, np.array([0.0, 0.0, 0.1]))
    round_solid = Solid(np.array([0.0, 0.0, 0.1]), np.array([0.24, 0.24, 0.2]), round=True)
    revolved = Revolved.standing([(0.0, 0.0), (0.12, 0.0), (0.12, 0.2), (0.0, 0.2)])
    expected = round_solid.ranges(origin, directions)
    assert 200 < np.isfinite(expected).sum() < 2000
    np.testing.assert_allclose(revolved.ranges(origin, directions), expected, atol=1e-9)


def test_many_cones_make_a_ball():
    origin, directions = rays(2000, np.array([0.0, 0.0, 0.1]))
    angles = np.linspace(0, np.pi, 200)
    ball = Revolved.standing([(0.1 * np.sin(angle), 0.1 - 0.1 * np.cos(angle)) for angle in angles])
    expected = Ellipsoid(np.array([0.0, 0.0, 0.1]), np.full(3, 0.2)).ranges(origin, directions)
    ranges = ball.ranges(origin, directions)
    both = np.isfinite(expected) & np.isfinite(ranges)
    assert both.sum() > 0.98 * np.isfinite(expected).sum() > 100
    assert np.median(np.abs(ranges[both] - expected[both])) < 1e-4


@pytest.mark.parametrize(("across", "level"), [(0.0, 0.01), (0.03, 0.01), (0.0475, 0.1)])
def test_one_looks_into_a_cup(across, level):
    np.testing.assert_allclose(CUP.ranges(np.array([across, 0.0, 1.0]), DOWN), 1.0 - level)


def test_beside_a_cup_nothing_is_hit():
    assert CUP.ranges(np.array([0.0501, 0.0, 1.0]), DOWN)[0] == np.inf


def test_it_moves_with_the_world():
    motion = small_motion(np.random.default_rng(1), 0.3, 50.0)
    origin, directions = rays(500, np.array([0.0, 0.0, 0.05]))
    moved = CUP.moved(motion)
    assert moved.label == 3
    there = moved.ranges(motion[:3, :3] @ origin + motion[:3, 3], directions @ motion[:3, :3].T)
    np.testing.assert_allclose(there, CUP.ranges(origin, directions), atol=1e-9)
