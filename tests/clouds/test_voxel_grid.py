import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmmjax.clouds import voxel_grid, voxel_size_for
from gmmjax.errors import InputError

COORDINATES = st.floats(-1e3, 1e3, allow_nan=False)
CLOUDS = hnp.arrays(np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=COORDINATES)
# Multiples of 1/1024 stay exact when they are moved by 1e6.
EXACT_CLOUDS = hnp.arrays(
    np.int64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.integers(-(2**20), 2**20)
).map(lambda array: array / 1024)
SIZES = st.sampled_from([0.01, 0.3, 1.0, 25.0, 5e3])


@given(CLOUDS, SIZES)
def test_mass_and_centre_of_mass_are_conserved(points, size):
    grid = voxel_grid(points, size)
    assert grid.mass.sum() == len(points)
    np.testing.assert_allclose(grid.mass @ grid.points, points.sum(axis=0), atol=1e-8)


@given(CLOUDS, SIZES)
def test_each_voxel_is_the_mean_of_its_points_and_no_larger_than_its_size(points, size):
    grid = voxel_grid(points, size)
    assert (grid.mass > 0).all()
    for voxel, centre in enumerate(grid.points):
        members = points[grid.voxel_of_point == voxel]
        assert len(members) == grid.mass[voxel]
        np.testing.assert_allclose(members.mean(axis=0), centre, atol=1e-9)
        assert np.ptp(members, axis=0).max() <= size * (1 + 1e-9)


@given(CLOUDS, SIZES)
def test_same_voxels_as_rows_of_integers(points, size):
    indices = np.floor((points - points.min(axis=0)) / size).astype(int)
    rows, voxel_of_point, counts = np.unique(indices, axis=0, return_inverse=True, return_counts=True)
    grid = voxel_grid(points, size)
    assert len(rows) == len(grid.mass)
    np.testing.assert_array_equal(grid.voxel_of_point, voxel_of_point.reshape(-1))
    np.testing.assert_array_equal(grid.mass, counts)


@given(CLOUDS, SIZES, st.randoms(use_true_random=False))
def test_the_order_of_the_points_does_not_matter(points, size, random):
    order = random.sample(range(len(points)), len(points))
    grid, shuffled = voxel_grid(points, size), voxel_grid(points[order], size)
    np.testing.assert_array_equal(grid.mass, shuffled.mass)
    np.testing.assert_array_equal(grid.voxel_of_point[order], shuffled.voxel_of_point)
    np.testing.assert_allclose(grid.points, shuffled.points, atol=1e-9)


@given(EXACT_CLOUDS, SIZES)
def test_far_from_the_origin(points, size):
    shift = np.array([1e6, -1e6, 3e6])
    grid, moved = voxel_grid(points, size), voxel_grid(points + shift, size)
    np.testing.assert_array_equal(grid.mass, moved.mass)
    np.testing.assert_array_equal(grid.voxel_of_point, moved.voxel_of_point)
    np.testing.assert_allclose(grid.points + shift, moved.points, rtol=0, atol=2e-9)


def test_empty_cloud():
    grid = voxel_grid(np.zeros((0, 3)), 1.0)
    assert (grid.points.shape, grid.mass.shape, grid.voxel_of_point.shape) == ((0, 3), (0,), (0,))


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf])
def test_sizes_that_are_none(size):
    with pytest.raises(InputError, match="must be positive"):
        voxel_grid(np.zeros((2, 3)), size)


def test_sizes_too_small_for_the_key():
    points = np.array([[0, 0, 0], [0, 100.0, 0]])
    with pytest.raises(InputError, match=r"too small for a cloud 100\.0 m long; give at least") as caught:
        voxel_grid(points, 1e-5)
    smallest = float(str(caught.value).split()[-2])
    assert voxel_grid(points, smallest).mass.tolist() == [1, 1]
    with pytest.raises(InputError, match="larger than a float64"):
        voxel_grid([[-1.7e308, 0, 0], [1.7e308, 0, 0]], 1.0)


@given(st.integers(0, 2**32), st.integers(1, 200), st.sampled_from([0.0, 1e6]))
def test_size_for_a_number_of_voxels(seed, max_voxels, shift):
    points = np.random.default_rng(seed).uniform(size=(4000, 3)) * [3, 2, 0.01] + shift
    size = voxel_size_for(points, max_voxels)
    assert len(voxel_grid(points, size).mass) <= max_voxels
    # A little smaller is too small; by more than 2 %, because the number of voxels has ripples.
    assert len(voxel_grid(points, size / 1.15).mass) > max_voxels


@given(CLOUDS, st.integers(1, 70))
def test_size_for_any_cloud(points, max_voxels):
    assume(np.ptp(points, axis=0).max() > 1e-200)
    assert len(voxel_grid(points, voxel_size_for(points, max_voxels)).mass) <= max_voxels


@pytest.mark.parametrize(
    ("points", "max_voxels", "message"),
    [(np.ones((5, 3)), 3, "same place"), (np.zeros((0, 3)), 3, "there are none"), (np.eye(3), 0, "max_voxels")],
)
def test_no_size_follows(points, max_voxels, message):
    with pytest.raises(InputError, match=message):
        voxel_size_for(points, max_voxels)


def test_scatter_is_the_covariance_within_each_voxel():
    points = np.random.default_rng(3).normal(size=(400, 3))
    grid = voxel_grid(points, 1.0)
    scatter = grid.scatter(points)
    for voxel in range(len(grid.mass)):
        own = points[grid.voxel_of_point == voxel]
        np.testing.assert_allclose(scatter[voxel], np.cov(own.T, bias=True) if len(own) > 1 else 0, atol=1e-12)
