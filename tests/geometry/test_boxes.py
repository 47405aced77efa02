import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.geometry import hull_corners, hull_volume, smallest_box, upright_box


def on_box(random, extent, count=400):
    """Points on the sides of a box about the origin."""
    points = random.uniform(-0.5, 0.5, (count, 3))
    rows, axis = np.arange(count), random.integers(0, 3, count)
    points[rows, axis] = random.choice([-0.5, 0.5], count)
    corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    return np.concatenate([points, corners]) * extent


def inside(box, points):
    return np.abs((points - box.centre) @ box.rotation) <= box.extent / 2 + 1e-9


@given(st.integers(0, 2**32 - 1), st.tuples(*[st.floats(0.05, 3.0)] * 3))
def test_the_smallest_box_is_the_box_that_points_lie_on_in_any_orientation(seed, extent):
    random = np.random.default_rng(seed)
    rotation, shift = Rotation.random(rng=random).as_matrix(), random.normal(size=3)
    points = on_box(random, extent) @ rotation.T + shift
    box = smallest_box(points, 24)
    np.testing.assert_allclose(np.sort(box.extent), np.sort(extent), rtol=1e-6)
    np.testing.assert_allclose(box.centre, shift, atol=1e-6)
    assert inside(box, points).all()
    assert np.linalg.det(box.rotation) == pytest.approx(1)


@given(st.integers(0, 2**32 - 1))
def test_an_upright_box_has_the_smallest_footprint(seed):
    random = np.random.default_rng(seed)
    up = random.normal(size=3)
    up /= np.linalg.norm(up)
    points = random.normal(size=(60, 3)) * [3, 1, 0.5]
    box = upright_box(points, up)
    np.testing.assert_allclose(box.rotation[:, 2], up, atol=1e-12)
    np.testing.assert_allclose(box.rotation @ box.rotation.T, np.eye(3), atol=1e-12)
    assert inside(box, points).all()
    for angle in np.linspace(0, np.pi / 2, 30):
        first = Rotation.from_rotvec(angle * up).apply(box.rotation[:, 0])
        sides = np.ptp(points @ np.stack([first, np.cross(up, first)], axis=1), axis=0)
        assert box.extent[0] * box.extent[1] <= np.prod(sides) + 1e-9


@pytest.mark.parametrize("axes", [1, 2])
def test_flat_points_have_a_box_and_no_volume(axes):
    points = np.zeros((50, 3))
    points[:, :axes] = np.random.default_rng(0).uniform(size=(50, axes))
    box = smallest_box(points, 8)
    assert inside(box, points).all()
    assert (np.sort(box.extent)[: 3 - axes] < 1e-9).all()
    assert hull_volume(points) == 0
    assert len(hull_corners(points)) == 50


def test_one_point_has_a_box_without_extent():
    box = smallest_box(np.ones((1, 3)), 8)
    np.testing.assert_array_equal(box.extent, 0)
    np.testing.assert_allclose(box.centre, 1)


def test_the_volume_of_a_hull_is_that_of_the_box_and_its_corners_are_the_boxs():
    points = on_box(np.random.default_rng(1), [2.0, 3.0, 0.5])
    assert hull_volume(points) == pytest.approx(3.0)
    assert hull_volume(hull_corners(points)) == pytest.approx(3.0)
