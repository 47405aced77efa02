import numpy as np

from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.changes.objects.height_maps import HeightMapSettings, height_maps
from gmmjax.changes.objects.plane_grid import PlaneGrid
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

UP, ACROSS = np.array([0.0, 0.0, 1.0]), np.eye(3)[:2]
CELL = 0.2
GRID = PlaneGrid(np.array([-1.0, -1.0]), CELL, (10, 10))
NOTHING = np.empty((0, 3))


def sheet(height, half=1.0):
    steps = np.arange(-half + 0.01, half, 0.02)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    return np.stack([x, y, np.full_like(x, height)], axis=1)


GROUND, DEPOSIT = sheet(0.0), sheet(0.1, 0.5)
OPEN = GROUND[np.abs(GROUND[:, :2]).max(axis=1) > 0.5]


def maps(after, labelled=DEPOSIT, settings=HeightMapSettings()):
    change = ChangeSurface(Pair(NOTHING, labelled), Pair(GROUND, after), NOTHING, LocalSurface.of(GROUND), UP)
    return height_maps(change, ACROSS, GRID, settings)


def test_a_deposit_is_as_high_as_it_lies_above_the_ground():
    found = maps(np.concatenate([OPEN, DEPOSIT]))
    np.testing.assert_allclose(found.before.heights, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.after.heights[4:6, 4:6], 0.1, atol=1e-9)
    np.testing.assert_allclose(found.after.heights[[0, -1]], 0.0, atol=1e-9)
    assert not found.after.partly[4:6, 4:6].any()


def test_a_cell_without_points_has_no_height():
    found = maps(np.concatenate([OPEN[OPEN[:, 0] > -0.8], DEPOSIT]))
    assert np.isnan(found.after.heights[0]).all() and np.isfinite(found.after.heights[1:]).all()


def test_what_is_far_above_the_change_is_not_its_surface():
    branches = sheet(1.0)
    after = np.concatenate([OPEN, DEPOSIT, branches])
    np.testing.assert_allclose(maps(after).after.heights[[0, -1]], 0.0, atol=1e-9)
    assert (maps(after, settings=HeightMapSettings(beyond=np.inf)).after.heights[[0, -1]] > 0.4).all()


def test_a_cell_that_is_seen_in_one_part_only_is_known_as_such():
    corner = DEPOSIT[~((np.abs(DEPOSIT[:, :2] - 0.1) < 0.1).all(axis=1) & (DEPOSIT[:, :2].max(axis=1) > 0.09))]
    found = maps(np.concatenate([OPEN, corner]), corner)
    assert found.after.partly[5, 5] and not found.after.partly[4, 4]
    assert not maps(np.concatenate([OPEN, corner]), corner, HeightMapSettings(parts=1)).after.partly.any()


def test_an_upright_side_rises_above_its_mean_and_a_slope_does_not():
    heights = np.arange(0.0, 1.0, 0.02)
    y, z = (grid.ravel() for grid in np.meshgrid(np.arange(-0.49, 0.5, 0.02), heights))
    wall = np.stack([np.full_like(y, 0.09), y, z], axis=1)
    slope = np.stack([*DEPOSIT[:, :2].T, 0.2 * DEPOSIT[:, 0]], axis=1)
    # The floor before it is in the cell, too.
    rise = maps(np.concatenate([GROUND, wall]), wall).after.rise(CELL, 0.3)
    assert (rise[5, 3:7] > 0.4).all() and not rise[:4].any()
    assert not maps(np.concatenate([OPEN, slope]), slope).after.rise(CELL, 0.3).any()
