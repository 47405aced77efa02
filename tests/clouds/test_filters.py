import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.clouds import crop_box, statistical_outliers
from gmmjax.errors import InputError


def cloud(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_t(3, size=(count, 3))


def brute_force(points: np.ndarray, neighbours: int, ratio: float) -> np.ndarray:
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distances, np.inf)
    mean_distances = np.sort(distances, axis=1)[:, : min(neighbours, len(points) - 1)].mean(axis=1)
    return mean_distances > mean_distances.mean() + ratio * mean_distances.std(ddof=1)


@given(st.integers(0, 2**32), st.integers(2, 60), st.integers(1, 80), st.sampled_from([0.0, 0.5, 1.0, 2.0]))
def test_equals_brute_force(seed, count, neighbours, ratio):
    points = cloud(seed, count)
    outliers = statistical_outliers(points, neighbours=neighbours, ratio=ratio)
    if count == 2:  # equal distances: rounding decides
        assert not outliers.any()
    else:
        np.testing.assert_array_equal(outliers, brute_force(points, neighbours, ratio))


@pytest.mark.parametrize(("neighbours", "ratio"), [(20, 2.0), (5, 1.0), (40, 0.5)])
def test_equals_open3d(open3d, neighbours, ratio):
    points = cloud(1, 3000)
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    # Open3D counts the point itself among its neighbours.
    _, kept = theirs.remove_statistical_outlier(nb_neighbors=neighbours + 1, std_ratio=ratio)
    outliers = statistical_outliers(points, neighbours=neighbours, ratio=ratio)
    np.testing.assert_array_equal(np.flatnonzero(~outliers), np.sort(kept))
    assert outliers.any()


def test_finds_the_stray_point_far_from_the_origin():
    points = np.vstack([np.random.default_rng(0).uniform(size=(500, 3)), [[30, 0, 0]]]) + 1e6
    assert statistical_outliers(points)[-1]


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.ones((1, 3)), np.ones((30, 3))])
def test_no_outliers_where_nothing_differs(points):
    assert statistical_outliers(points).tolist() == [False] * len(points)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"neighbours": 0}, "neighbours"), ({"ratio": -1.0}, "ratio"), ({"ratio": np.nan}, "ratio")],
)
def test_wrong_settings(settings, message):
    with pytest.raises(InputError, match=message):
        statistical_outliers(np.ones((3, 3)), **settings)
    with pytest.raises(InputError, match="first: row 1"):
        statistical_outliers([[0, 0, 0], [np.nan, 0, 0]])


def test_crop_box_includes_its_faces():
    points = [[0, 0, 0], [1, 2, 3], [0.5, 1, 1], [1.1, 1, 1], [0.5, -0.1, 1], [0.5, 1, 3.1]]
    assert crop_box(points, [0, 0, 0], [1, 2, 3]).tolist() == [True, True, True, False, False, False]
    assert crop_box(points, [-np.inf, 0, 0], [np.inf, np.inf, 3]).tolist() == [True, True, True, True, False, False]


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        ([0, 0], [1, 1, 1], "lower must be three numbers"),
        ([0, 0, 0], [1, np.nan, 1], "upper must be three numbers"),
        ([0, 2, 0], [1, 1, 1], "lower .* is above upper"),
        (["a", 0, 0], [1, 1, 1], "lower must be three numbers"),
    ],
)
def test_wrong_boxes(lower, upper, message):
    with pytest.raises(InputError, match=message):
        crop_box(np.zeros((2, 3)), lower, upper)
