"""Heights above a surface along one direction."""

import numpy as np
import pytest

from gmmjax.changes.objects.height_above import HeightAbove
from gmmjax.geometry import LocalSurface

UP = np.array([0, 0, 1.0])


def slope(random, steepness, count=800):
    """A plane that rises along x."""
    places = random.uniform(-2, 2, (count, 2))
    return np.column_stack([places, steepness * places[:, 0]])


@pytest.mark.parametrize("steepness", [0.0, 0.5, 2.0])
def test_above_a_slope_the_height_is_that_along_the_direction_however_the_points_lie(steepness):
    random = np.random.default_rng(0)
    surface = LocalSurface.of(slope(random, steepness))
    heights = random.uniform(-1, 1, 200)
    points = slope(random, steepness, 200) + heights[:, None] * UP
    np.testing.assert_allclose(HeightAbove(surface, UP, planes=4, steepest=0.3).of(points), heights, atol=1e-9)


def test_a_surface_that_is_too_steep_counts_as_level():
    random = np.random.default_rng(1)
    surface = LocalSurface.of(slope(random, 2.0))
    own = surface.points[:50]
    level = HeightAbove(surface, UP, planes=4, steepest=0.9).of(own + UP)
    assert np.abs(level - 1).max() > 0.01
    assert np.abs(level - 1).max() < 1
