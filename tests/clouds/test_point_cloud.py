import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError

ROWS = hnp.arrays(np.float64, st.tuples(st.integers(0, 30), st.just(3)), elements=st.floats(allow_nan=True))


@given(ROWS)
def test_from_rows_keeps_the_finite_rows_and_counts_the_others(rows):
    number = np.arange(len(rows))
    colors = (number[:, None] * [1, 2, 3] % 256).astype(np.uint8)
    cloud = PointCloud.from_rows(rows, colors, {"number": number})
    assert np.isfinite(cloud.points).all()
    np.testing.assert_array_equal(cloud.points, rows[cloud.rows])
    np.testing.assert_array_equal(cloud.colors, colors[cloud.rows])
    np.testing.assert_array_equal(cloud.fields["number"], cloud.rows)
    assert len(cloud) + cloud.rows_dropped == len(rows)
    assert not np.isfinite(np.delete(rows, cloud.rows, axis=0)).all(axis=1).any()


@pytest.mark.parametrize(
    "points", [[[1, 2, 3]], [(1.5, 2, 3)], np.ones((2, 3), np.float32), np.ones((2, 3), ">f8"), np.zeros((0, 3))]
)
def test_accepts_any_real_rows(points):
    cloud = PointCloud.from_rows(points)
    assert cloud.points.dtype == np.float64
    np.testing.assert_array_equal(cloud.points, points)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 7)), r"shape \[N, 3\], not \[3, 7\]; transpose"),
        (np.zeros(3), r"not \[3\]"),
        (np.zeros((2, 3), complex), "real numbers"),
        ([["a", "b", "c"]], "real numbers"),
        ([[1, 2, 3], [1, 2]], "array"),
        ([[None, 1, 2]], "real numbers"),
    ],
)
def test_rejects_other_shapes_and_types(points, message):
    with pytest.raises(InputError, match=message):
        PointCloud.from_rows(points)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ({"colors": np.zeros((4, 3), np.uint8)}, "colors must be uint8"),
        ({"colors": np.zeros((5, 3))}, "colors must be uint8"),
        ({"fields": {"label": np.zeros(4)}}, "'label' must be numbers"),
        ({"fields": {"label": np.array(["a"] * 5)}}, "'label' must be numbers"),
    ],
)
def test_rejects_attributes_that_do_not_fit(extra, message):
    with pytest.raises(InputError, match=message) as caught:
        PointCloud.from_rows(np.zeros((5, 3)), **extra, source="scan.ply")
    assert str(caught.value).startswith("scan.ply: ")


def test_the_record_itself_takes_only_finite_points():
    with pytest.raises(InputError, match="from_rows"):
        PointCloud(np.array([[np.nan, 0, 0]]), np.arange(1))
