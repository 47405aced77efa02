"""Which points of a cloud are stray, and which are not, however far away they are."""

import numpy as np
import pytest

from gmmjax.clouds import scan_bounds, within, without_stray_points

RANDOM = np.random.default_rng(0)
FLT_MAX = float(np.finfo(np.float32).max)
ROOM = np.concatenate(
    [
        np.c_[RANDOM.uniform(-6, 6, (3000, 2)), RANDOM.normal(0, 0.004, 3000)],
        np.c_[RANDOM.uniform(-6, 6, 1000), RANDOM.normal(5, 0.004, 1000), RANDOM.uniform(0, 3, 1000)],
    ]
)
MAPPED = ROOM + np.array([5e5, 5e6, 100.0])

STRAY = {
    "one": [[1e6, 0, 0]],
    "one not so far": [[150.0, 0, 0]],
    "the largest of float32": [[FLT_MAX, 0, 0]],
    "on both sides": [[FLT_MAX, 0, 0], [-FLT_MAX, FLT_MAX, 0], [1e6, 0, 0], [0, -1e3, 0]],
    "the largest of float64 on both sides": [[1.7e308, 0, 0], [-1.7e308, 0, 0]],
    "near each other, beyond all sensors": RANDOM.normal(1e6, 1, (20, 3)),
    "scattered": RANDOM.uniform(-1e4, 1e4, (40, 3)),
    "in a row": np.c_[np.arange(1e3, 11e3, 1e3), np.zeros((10, 2))],
    "ever farther": np.c_[10.0 ** np.arange(3, 30), np.zeros((27, 2))],
    "no data in all coordinates": np.full((10_000, 3), -9999.0),
    "no data in heights": np.c_[RANDOM.uniform(-6, 6, (3000, 2)), np.full(3000, -9999.0)],
    "no data as float32": np.c_[RANDOM.uniform(-6, 6, (3000, 2)), np.full(3000, -FLT_MAX)],
}
REAL = {
    "none": np.empty((0, 3)),
    "an island of a few points": RANDOM.normal([500, 0, 0], 1, (6, 3)),
    "a sparse wall": np.c_[np.full(20, 90.0), RANDOM.uniform(-20, 20, 20), RANDOM.uniform(0, 5, 20)],
    "single points not far away": RANDOM.uniform(-50, 50, (20, 3)),
    "a whole part": ROOM + np.array([1e5, 0, 0]),
    "the value for no data within the heights": np.c_[np.zeros((300, 2)), np.linspace(-10_000, 0, 300)],
}


def count(points):
    return int((~within(points, scan_bounds(points))).sum())


@pytest.mark.parametrize("name", STRAY)
def test_stray_points_are_found_and_nothing_else(name):
    points = np.concatenate([np.asarray(STRAY[name], float), ROOM])
    np.testing.assert_array_equal(without_stray_points(points), ROOM)
    np.testing.assert_array_equal(scan_bounds(points), [ROOM.min(axis=0), ROOM.max(axis=0)])


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_what_is_real_is_none(name, scale):
    assert scan_bounds(np.concatenate([ROOM, REAL[name]]) * scale) is None


@pytest.mark.parametrize("rows", [1, 1_000, 20_000])
def test_placeholders_at_the_origin_are_stray_where_the_scene_is_far_from_it(rows):
    assert count(np.concatenate([MAPPED, np.zeros((rows, 3))])) == rows
    assert count(np.concatenate([ROOM[:, [0, 2, 1]] / 10 + [0, 0, 2], np.zeros((rows, 3))])) == 0


def test_stray_points_beyond_an_island():
    island = RANDOM.normal([500, 0, 0], 1, (30, 3))
    assert count(np.concatenate([ROOM, island, [[1e7, 0, 0], [0, 0, -1e7]]])) == 2


def test_scans_whose_points_get_ever_sparser_are_whole():
    directions = RANDOM.normal(size=(20_000, 3))
    ranges = np.exp(RANDOM.normal(0, 1.5, 20_000))
    points = directions / np.linalg.norm(directions, axis=1)[:, None] * ranges[:, None]
    assert np.ptp(points, axis=0).max() > 100 * np.median(ranges)
    assert scan_bounds(points) is None


@pytest.mark.parametrize(
    "points", [np.empty((0, 3)), np.zeros((5, 3)), np.eye(3), np.array([[0, 0, 0], [1e9, 0, 0.0]])]
)
def test_of_a_few_points_none_is_stray(points):
    assert scan_bounds(points) is None
