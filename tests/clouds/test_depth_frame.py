"""Clouds that are a frame of a depth camera, and clouds that are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.clouds import DepthFrameSettings, is_depth_frame, read_cloud, voxel_grid
from tests.clouds.made_frames import frame


def grid(noise=0.0):
    """A level grid two metres above the origin, as the cells of an elevation model are."""
    x, y = np.meshgrid(0.1 * np.arange(60), 0.1 * np.arange(50))
    return np.c_[x.ravel(), y.ravel(), 2.0 + noise * np.random.default_rng(0).normal(size=x.size)]


@pytest.mark.parametrize("direction", [1, -1])
def test_a_frame_is_recognised_whichever_way_its_camera_looks(direction):
    assert is_depth_frame(frame() * [1, direction, direction])


def test_rounding_hides_no_frame():
    assert is_depth_frame(frame().astype(np.float32).astype(float))
    # As files with four decimals have it: a tenth of a millimetre.
    assert is_depth_frame(np.round(frame(), 4))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), missing=st.floats(0.0, 0.8))
def test_the_points_of_a_frame_may_come_in_any_order_and_any_of_them_may_be_missing(seed, missing):
    points = frame(seed, missing)
    shuffled = np.random.default_rng(seed).permutation(points)
    assert is_depth_frame(points) and is_depth_frame(shuffled)
    assert is_depth_frame(shuffled, DepthFrameSettings(most_points=2_000))


@pytest.mark.parametrize("offset", [[0.0, 0.0, 0.5], [0.3, 0.0, 0.0]])
def test_a_frame_that_was_moved_is_none(offset):
    assert not is_depth_frame(frame() + offset)
    turned = Rotation.from_euler("y", 2, degrees=True).apply(frame())
    assert not is_depth_frame(turned)


def test_a_frame_that_was_thinned_to_voxels_is_none():
    assert not is_depth_frame(voxel_grid(frame(), 0.05).points)


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, 1e-2])
def test_a_level_grid_is_no_frame(noise):
    assert not is_depth_frame(grid(noise))


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 300))
def test_points_anywhere_are_no_frame(seed, count):
    points = np.random.default_rng(seed).uniform([-1, -1, 1], [1, 1, 2], (count, 3))
    assert not is_depth_frame(points)


def test_points_on_both_sides_of_the_origin_are_no_frame():
    points = frame()
    points[0] *= -1
    assert not is_depth_frame(points)


def test_a_single_row_of_pixels_is_no_frame():
    points = frame(missing=0.0)
    row = points[:, 1] / points[:, 2]
    assert not is_depth_frame(points[row == row[0]])


def test_real_frames_are_recognised_until_they_are_thinned(scan_pairs):
    """All of these are single frames; some cameras look along z, others against it."""
    for pair in scan_pairs:
        for side in ("before", "after"):
            points = read_cloud(pair / f"{side}.ply").points
            assert is_depth_frame(points), pair.name
            assert not is_depth_frame(voxel_grid(points, 0.01).points), pair.name
