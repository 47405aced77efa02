import numpy as np
import pytest

from gmmjax.surveys import Intrinsics
from gmmjax.surveys.volumetric_map import interpolated, lone_pixels

CAMERA = Intrinsics.of_field_of_view((60.0, 45.0), 20, 15)


def slope(camera):
    """Depths of the plane z + 0.2 x - 0.1 y = 2."""
    return (2 / (camera.rays() @ [0.2, -0.1, 1.0])).reshape(camera.height, camera.width)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_a_plane_is_what_a_finer_camera_sees(factor):
    finer = Intrinsics.of_field_of_view((60.0, 45.0), 20 * factor, 15 * factor)
    np.testing.assert_allclose(interpolated(slope(CAMERA), factor), slope(finer))


def test_nothing_is_put_between_two_surfaces_or_beside_what_is_lost():
    depth = slope(CAMERA)
    depth[:, 10:] += 1.0
    depth[7, 4] = np.nan
    fine = interpolated(depth, 2)
    np.testing.assert_array_equal(fine[:, 19], depth[:, 9].repeat(2))
    np.testing.assert_array_equal(fine[:, 20], depth[:, 10].repeat(2))
    assert np.isnan(fine).sum() == 4 and np.isnan(fine[14:16, 8:10]).all()
    assert np.nanmin(fine) >= np.nanmin(depth) * 0.95


def test_what_falls_between_two_surfaces_stands_alone_and_a_rod_does_not():
    depth = slope(CAMERA)
    depth[:, 10:] += 1.0
    assert not lone_pixels(depth).any()
    depth[3, 9] = depth[3, 9] + 0.5
    depth[12, 0] = 0.4
    depth[:, 5] = 1.0
    depth[6] = np.nan
    rows, columns = np.nonzero(lone_pixels(depth))
    # The ends of a rod stand alone as well.
    found = set(zip(rows.tolist(), columns.tolist(), strict=True))
    assert found == {(3, 9), (12, 0), (0, 5), (5, 5), (7, 5), (14, 5)}
