import dataclasses

import numpy as np
import pytest

from gmmjax.clouds.cloud_file import Bounds
from gmmjax.clouds.las_coordinates import LARGEST, BoundsError, CoordinateEncoding
from gmmjax.clouds.las_header import read_header
from tests.clouds.las_files import las_bytes


@pytest.fixture
def header(write_file):
    """Of a file with millimetres, about (500000, 5400000, 100)."""
    path = write_file("scan.las", las_bytes(2, 3))
    with path.open("rb") as stream:
        return read_header(stream, path.stat().st_size, path)


def bounds_of(points):
    return Bounds(points.min(axis=0), points.max(axis=0))


def read_back(encoding, integers):
    return integers * encoding.scales + encoding.offsets


def test_points_near_the_file_s_keep_its_scale_and_offset(header):
    points = header.offsets + np.random.default_rng(0).uniform(-1e6, 1e6, (100, 3))
    encoding = CoordinateEncoding.for_bounds(header, bounds_of(points))
    assert encoding.kept
    np.testing.assert_array_equal(encoding[:2], CoordinateEncoding.of_file(header)[:2])
    integers = encoding.integers(points, np.zeros((100, 3), np.int32), np.zeros(100, bool))
    np.testing.assert_allclose(read_back(encoding, integers), points, atol=0.0005 + 1e-9, rtol=0)


def test_points_far_away_have_the_file_s_scale_about_another_offset(header):
    points = header.offsets + np.array([3e7, 0.0, 0.0]) + np.random.default_rng(0).uniform(-1e5, 1e5, (100, 3))
    encoding = CoordinateEncoding.for_bounds(header, bounds_of(points))
    assert not encoding.kept
    np.testing.assert_array_equal(encoding.scales, header.scales)
    integers = encoding.integers(points, np.zeros((100, 3), np.int32), np.zeros(100, bool))
    np.testing.assert_allclose(read_back(encoding, integers), points, atol=0.0005 + 1e-8, rtol=0)


def test_points_over_too_wide_a_range_have_the_next_coarser_power_of_ten(header):
    points = header.offsets + np.array([[-3e7, 0.0, 0.0], [3e7, 1.0, 1.0]])
    encoding = CoordinateEncoding.for_bounds(header, bounds_of(points))
    np.testing.assert_allclose(encoding.scales, [0.1, 0.001, 0.001])
    assert encoding.represents(bounds_of(points)).all()


def test_unmoved_points_keep_the_file_s_integers_bit_for_bit(header):
    # So far away float64 does not resolve millimetres: rounding gives other integers.
    far = dataclasses.replace(header, offsets=np.full(3, 1e14))
    of_file = np.array([[1, 2, 3], [LARGEST, 0, 5]], np.int32)
    points, encoding = far.coordinates(of_file), CoordinateEncoding.of_file(far)
    np.testing.assert_array_equal(encoding.integers(points, of_file, np.ones(2, bool)), of_file)
    assert (encoding.integers(points, of_file, np.zeros(2, bool)) != of_file).any()


def test_points_beyond_the_integers_are_refused(header):
    encoding, points = CoordinateEncoding.of_file(header), header.offsets + np.array([[3e7, 0.0, 0.0]])
    assert list(encoding.represents(bounds_of(points))) == [False, True, True]
    with pytest.raises(BoundsError, match="outside the bounds"):
        encoding.integers(points, np.zeros((1, 3), np.int32), np.zeros(1, bool))


def test_huge_scales_are_no_error(header):
    huge = dataclasses.replace(header, scales=np.full(3, 1e300))
    points = np.array([[1e308, 0.0, 0.0], [-1e308, 1.0, 1.0]])
    assert CoordinateEncoding.for_bounds(huge, bounds_of(points)).represents(bounds_of(points)).all()
