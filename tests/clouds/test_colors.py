import numpy as np
import pytest

from gmmjax.clouds.colors import color_bytes
from gmmjax.errors import InputError


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        (np.array([[0, 128, 255]], np.uint8), [0, 128, 255]),
        (np.array([[0, 128, 255]], np.uint16), [0, 128, 255]),
        (np.array([[0, 32896, 65535]], np.uint16), [0, 128, 255]),
        (np.array([[0, 0.5, 1.0]], np.float32), [0, 128, 255]),
        (np.array([[0, 128.0, 255.0]]), [0, 128, 255]),
        (np.array([[np.nan, 0.2, 1.0]]), [0, 51, 255]),
        (np.array([[7, 128, 255]], np.int32), [7, 128, 255]),
        (np.array([[0, 32896.0, 65535.0]]), [0, 128, 255]),
    ],
)
def test_kinds_of_colors(channels, expected):
    assert color_bytes(channels, "file").tolist() == [expected]


@pytest.mark.parametrize(
    "channels",
    [np.array([[-1, 0, 0]]), np.array([[0, 0, 70000]]), np.array([[0, 0, 260.5]]), np.array([[0, 0, np.inf]])],
)
def test_colors_out_of_range(channels):
    with pytest.raises(InputError, match="file: colours run from"):
        color_bytes(channels, "file")
