"""What nobody saw of an object whose top is above the sensors, in cells that are 1 in area."""

import numpy as np
import pytest

from gmmjax.changes.objects.difference_cells import between_sides, with_sides

SHAPE = (12, 12)


def ring(gap=0):
    """The sides of an object of six by six cells, without some cells of the first one."""
    sides = np.zeros(SHAPE, bool)
    sides[3:9, 3:9], sides[4:8, 4:8] = True, False
    sides[3, 4 : 4 + gap] = False
    return sides


def test_upright_sides_have_half_of_their_height_beside_what_nobody_saw():
    """Their mean height is less: a cell has the floor before its side, and nothing of what is behind it."""
    sides = ring()
    crests = np.where(sides, 2.0, 0.0)
    inside = np.zeros(SHAPE, bool)
    inside[4:8, 4:8] = True
    thickness, error = with_sides(np.where(sides, 0.5, 0.0), crests, inside)
    np.testing.assert_array_equal(thickness, np.where(sides, 1.0, 0.0))
    # Four independent sides of five cells, each anywhere in its cells.
    assert error == pytest.approx(np.sqrt(4 * (5 * 2.0) ** 2 / 12))
    seen, none = with_sides(np.where(sides, 0.5, 0.0), crests, np.zeros(SHAPE, bool))
    np.testing.assert_array_equal(seen, np.where(sides, 0.5, 0.0))
    assert none == 0


def test_between_sides_there_is_all_and_less_where_their_outline_has_gaps():
    crests = np.full(SHAPE, 2.0)
    whole, cells = between_sides(crests, ring(), ~ring())
    assert cells.sum() == 16 and (whole.volume, whole.error) == (32.0, 0.0)
    part, cells = between_sides(crests, ring(gap=4), ~ring(gap=4))
    # The cells of the gap are between the sides, too.
    assert cells.sum() == 20 and 20 < part.volume < 40 and part.volume + 2 * part.error > 40


def test_one_wall_has_nothing_between_its_cells():
    wall = np.zeros(SHAPE, bool)
    wall[5, 2:10] = True
    hidden, cells = between_sides(np.full(SHAPE, 2.0), wall, ~wall)
    assert (hidden.volume, hidden.error) == (0.0, 0.0) and not cells.any()
