import numpy as np
import pytest

from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.surveys import Frame
from tests.surveys.seen_room import CAMERA, around, frame


def test_the_image_of_a_frame_is_what_it_was_made_of():
    image = frame(around()[0], 0.0).image()
    again = Frame.of_image(image, 3.0, "camera")
    np.testing.assert_array_equal(again.image(), image)
    np.testing.assert_array_equal(again.depth_image(), image[:, :, 2])
    assert (again.width, again.height, again.time, again.name) == (CAMERA.width, CAMERA.height, 3.0, "camera")
    lost = np.isnan(image[:, :, 0])
    assert again.cloud.rows_dropped == lost.sum() > 100 and len(again.cloud) == (~lost).sum()


def test_points_in_no_order_have_no_image():
    unordered = Frame(PointCloud.from_rows(np.ones((20, 3))), 0.0)
    for use in (unordered.image, unordered.depth_image, unordered.intrinsics):
        with pytest.raises(InputError, match="in no order"):
            use()


@pytest.mark.parametrize(
    ("width", "height", "time", "message"),
    [(4, 4, 0.0, "4 x 4 does not fit"), (20, None, 0.0, "20 x None does not fit"), (5, 4, np.nan, "must be seconds")],
)
def test_what_no_frame_has(width, height, time, message):
    with pytest.raises(InputError, match=message):
        Frame(PointCloud.from_rows(np.ones((20, 3))), time, "", width, height)


def test_an_image_of_another_shape():
    with pytest.raises(InputError, match=r"\[height, width, 3\], not \[20, 3\]"):
        Frame.of_image(np.ones((20, 3)), 0.0)
