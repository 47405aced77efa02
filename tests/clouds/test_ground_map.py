import numpy as np
import pytest

from gmmjax.clouds.ground_map import GroundMap, GroundSettings

PER_CELL = 16.0


def floor(count=4_000, seed=0):
    """A square of 10 x 10, noisy by a centimetre."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, 10, (count, 2)), rng.normal(0, 0.01, count)])


def map_of(points, settings=GroundSettings(), weights=None):
    weights = np.ones(len(points)) if weights is None else weights
    found = GroundMap.of(points, weights, PER_CELL, settings)
    assert found is not None
    return found


def test_all_points_of_a_floor_are_counted_where_they_are():
    points = floor()
    found = map_of(points)
    assert found.counts.sum() == len(points)
    np.testing.assert_allclose(found.cell, np.sqrt(100 * PER_CELL / len(points)), rtol=0.01)
    np.testing.assert_allclose(found.heights[np.isfinite(found.heights)], 0, atol=0.05)
    twice = map_of(points, weights=np.full(len(points), 2.0))
    np.testing.assert_array_equal(twice.counts, 2 * found.counts)


def test_what_stands_on_a_floor_or_hangs_above_it_is_not_counted():
    rng = np.random.default_rng(1)
    wall = np.column_stack([np.full(500, 5.0), rng.uniform(2, 8, 500), rng.uniform(0.5, 3, 500)])
    roof = np.column_stack([rng.uniform(0, 10, (500, 2)), np.full(500, 4.0)])
    found = map_of(np.concatenate([floor(), wall, roof]))
    assert found.counts.sum() == 4_000
    # Without the rise a roof is the ground of the cells below which nothing was seen.
    hole = floor()[(np.abs(floor()[:, :2] - 5) > 1.5).any(axis=1)]
    with_roof = np.concatenate([hole, roof])
    assert map_of(with_roof).counts.sum() == len(hole)
    assert map_of(with_roof, GroundSettings(rise=np.inf)).counts.sum() > len(hole)


def test_distances_are_those_of_the_cells():
    found = map_of(floor())
    distances = found.distances(np.array([3.0, 4.0]))
    assert distances.shape == found.counts.shape
    assert distances[3, 4] == 0 and distances[0, 0] == 5


@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
def test_points_without_area_have_no_map(axes):
    points = floor(100)
    points[:, axes] = 1.0
    assert GroundMap.of(points, np.ones(100), PER_CELL, GroundSettings()) is None
