import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.clouds.canonical import canonical_order, first_of_equals, morton_order


@st.composite
def clouds(draw):
    """Small clouds, some of them on a grid, where many coordinates and whole points are equal."""
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    points = random.normal(size=(draw(st.integers(1, 60)), 3))
    return np.round(points, draw(st.sampled_from([0, 1, 12])))


@given(clouds(), st.integers(0, 10**6))
def test_the_order_does_not_depend_on_the_rows(points, seed):
    shuffled = np.random.default_rng(seed).permutation(points)
    np.testing.assert_array_equal(points[canonical_order(points)], shuffled[canonical_order(shuffled)])


@given(clouds())
def test_a_mirrored_cloud_has_the_mirrored_order(points):
    centred = np.sort(points[:, 0])
    middle = centred[0] / 2 + centred[-1] / 2
    mirrored = points * np.array([-1.0, 1.0, 1.0])
    there, here = mirrored[canonical_order(mirrored)], points[canonical_order(points)]
    # Where the median is in the middle, nothing tells the two senses of the axis apart.
    if np.median(points[:, 0]) != middle:
        np.testing.assert_array_equal(there, here * np.array([-1.0, 1.0, 1.0]))


@given(clouds())
def test_each_place_is_counted_once(points):
    ordered = points[canonical_order(points)]
    np.testing.assert_array_equal(np.unique(ordered[first_of_equals(ordered)], axis=0), np.unique(points, axis=0))
    assert first_of_equals(ordered).sum() == len(np.unique(points, axis=0))


def test_neighbours_along_the_curve_are_neighbours_in_space():
    points = np.random.default_rng(0).uniform(size=(5000, 3))
    order = morton_order(points)
    np.testing.assert_array_equal(np.sort(order), np.arange(5000))
    steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    # By x alone they would be 0.5 apart.
    assert steps.mean() < 0.1


def test_the_curve_takes_the_octants_one_by_one():
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    np.testing.assert_array_equal(corners[morton_order(corners)], sorted(corners.tolist()))
