"""Clouds of any size, thinned while they are read."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.clouds import CroppedCloud, thinned_cloud
from tests.clouds.made_clouds import ChunkedArray


def thinned(points, most, size=1_000_000):
    return thinned_cloud(ChunkedArray(points).chunks(size), most)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), most=st.integers(8, 400), place=st.sampled_from([0.0, 5e6]))
def test_the_voxels_stand_for_all_points(seed, most, place):
    points = np.random.default_rng(seed).normal(size=(1_000, 3)) * [5, 5, 0.1] + place
    found = thinned(points, most, size=137)
    assert len(found.points) == len(found.counts) <= most
    assert found.total == 1_000
    mean = (found.counts[:, None] * (found.points - place)).sum(axis=0) / 1_000
    np.testing.assert_allclose(mean, points.mean(axis=0) - place, atol=1e-6)
    np.testing.assert_array_equal(np.array(found.bounds), [points.min(axis=0), points.max(axis=0)])


def test_few_points_are_kept():
    points = np.random.default_rng(0).uniform(size=(200, 3))
    found = thinned(points, 1_000)
    np.testing.assert_allclose(np.sort(found.points, axis=0), np.sort(points, axis=0), atol=1e-9)


def test_a_surface_is_thinned_evenly():
    points = np.random.default_rng(0).uniform(size=(100_000, 3)) * [4, 4, 0]
    found = thinned(points, 3_000, size=10_000)
    assert len(found.points) > 1_000
    assert np.median(found.counts) > 20


def test_a_stray_point_far_away():
    points = np.concatenate([np.random.default_rng(0).uniform(size=(500, 3)), [[1e9, 0.0, 0.0]]])
    found = thinned(points, 10_000, size=100)
    assert found.total == 501
    assert found.bounds.upper[0] == 1e9


@pytest.mark.parametrize("place", [0, 250, 500])
@pytest.mark.parametrize("far", [1e9, 3.4028235e38])
def test_stray_points_do_not_enlarge_the_voxels(place, far):
    """Wherever they are in the file."""
    points = np.random.default_rng(0).uniform(size=(500, 3)) * [8, 6, 0]
    found = thinned(np.insert(points, place, [[far, 0, 0], [0, -far, 0]], axis=0), 1_000, size=100)
    clean = thinned(points, 1_000, size=100)
    assert found.size <= 1.1 * clean.size
    np.testing.assert_array_equal(
        np.sort(found.points[np.abs(found.points).max(axis=1) < 10, 0]), np.sort(clean.points[:, 0])
    )
    assert found.total == 502


def test_a_cloud_that_begins_with_a_small_part_of_it_is_thinned_as_a_whole():
    parts = [np.random.default_rng(0).uniform(size=(100, 3)), np.random.default_rng(1).uniform(0, 1e4, (3_000, 3))]
    found = thinned(np.concatenate(parts), 2_000, size=100)
    assert len(found.points) <= 2_000
    assert found.total == 3_100
    assert found.size > 100


def test_no_points():
    found = thinned(np.empty((0, 3)), 10)
    assert found.total == 0
    assert found.bounds is None


def test_a_cropped_cloud_keeps_the_rows_of_the_whole():
    points = np.random.default_rng(0).uniform(size=(1_000, 3))
    cropped = CroppedCloud(ChunkedArray(points), np.zeros(3), np.array([0.5, 1.0, 1.0]))
    chunks = list(cropped.chunks(100))
    rows = np.concatenate([chunk.rows for chunk in chunks])
    np.testing.assert_array_equal(rows, np.flatnonzero(points[:, 0] <= 0.5))
    np.testing.assert_array_equal(np.concatenate([chunk.points for chunk in chunks]), points[rows])
    assert cropped.count == 1_000
