import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.errors import InputError
from gmmjax.surveys import Frame, Intrinsics

cameras = st.builds(
    Intrinsics,
    fx=st.floats(20, 600),
    fy=st.floats(20, 600),
    cx=st.floats(8, 30),
    cy=st.floats(6, 20),
    width=st.integers(31, 60),
    height=st.integers(21, 50),
)


@given(cameras)
def test_rays_are_seen_in_their_pixels(camera):
    u, v, one = camera.matrix() @ camera.rays().T
    rows, columns = np.divmod(np.arange(camera.width * camera.height), camera.width)
    np.testing.assert_allclose(u, columns, atol=1e-9)
    np.testing.assert_allclose(v, rows, atol=1e-9)
    np.testing.assert_array_equal(one, 1)


@given(cameras, st.integers(0, 1000))
def test_the_camera_of_a_frame_is_found_again(camera, seed):
    depth = np.random.default_rng(seed).uniform(0.5, 4, (camera.height, camera.width, 1))
    depth[::3, ::4] = np.nan
    frame = Frame.of_image(camera.rays().reshape(*depth.shape[:2], 3) * depth, 0.0)
    found = frame.intrinsics()
    np.testing.assert_allclose(found.matrix(), camera.matrix(), rtol=1e-9, atol=1e-9)
    assert (found.width, found.height) == (camera.width, camera.height)


@given(st.floats(10, 120), st.floats(10, 120))
def test_field_of_view(horizontal, vertical):
    camera = Intrinsics.of_field_of_view((horizontal, vertical), 224, 171)
    assert camera.field_of_view == pytest.approx((horizontal, vertical))


@given(cameras)
def test_the_field_of_view_holds_the_image(camera):
    horizontal, vertical = np.radians(camera.field_of_view) / 2
    x, y, _ = camera.rays().T
    assert (np.abs(np.arctan(x)) < horizontal).all() and (np.abs(np.arctan(y)) < vertical).all()


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ((0.0, 200.0, 10.0, 10.0, 20, 20), "must be positive"),
        ((200.0, np.inf, 10.0, 10.0, 20, 20), "must be positive"),
        ((200.0, 200.0, np.nan, 10.0, 20, 20), "must be positive"),
        ((200.0, 200.0, 10.0, 10.0, 0, 20), "must be positive"),
        ((200.0, 200.0, 20.0, 10.0, 20, 20), "outside of an image of 20 x 20"),
        ((200.0, 200.0, 10.0, -1.0, 20, 20), "outside of an image of 20 x 20"),
    ],
)
def test_what_no_camera_has(numbers, message):
    with pytest.raises(InputError, match=message):
        Intrinsics(*numbers)


def test_points_that_no_pinhole_camera_sees():
    image = np.random.default_rng(0).uniform(1, 2, (20, 30, 3))
    with pytest.raises(InputError, match="not what a pinhole camera sees"):
        Frame.of_image(image, 0.0).intrinsics()
    image[:, :, 2] = -1
    with pytest.raises(InputError, match="cannot be had"):
        Frame.of_image(image, 0.0).intrinsics()
