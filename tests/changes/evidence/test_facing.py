import numpy as np
import pytest

from gmmjax.changes.evidence.facing import Facing
from gmmjax.changes.evidence.free_space import sightlines
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.clouds import SensorViews

HEIGHT = 0.03
SIDES = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]])


def sheet(height):
    """A level sheet of 2 m."""
    steps = np.arange(-1.0, 1.0, 0.02)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    return np.stack([x, y, np.full_like(x, height)], axis=1)


def survey(points, *positions):
    return ScanVisibility.of(points, SensorViews.from_positions(points, np.array(positions)) if positions else None)


def faced_away(points, own, other):
    """Whether a sensor is on the other side of the surface at each point."""
    facing = Facing.of(survey(points, *own), np.arange(len(points)))
    return facing.away(points, np.array(other))


def test_a_surface_faces_the_side_that_it_was_seen_from():
    above, below = SIDES
    assert not faced_away(sheet(0.0), [above], np.add(above, [1.0, 0.0, 0.0])).any()
    assert faced_away(sheet(0.0), [above], below).all()
    assert faced_away(sheet(0.0), [below], above).all()


def test_of_views_on_either_side_the_nearest_one_measured_it():
    above, below = SIDES
    assert faced_away(sheet(0.0), [above, 4 * below], below).all()
    assert faced_away(sheet(0.0), [4 * above, below], above).all()


@pytest.mark.parametrize("own", [[], [[9.0, 0.0, 0.0]]], ids=["no views", "a view in its plane"])
def test_where_its_side_is_not_known_it_faces_every_sensor(own):
    for other in SIDES:
        assert not faced_away(sheet(0.0), own, other).any()


def test_what_is_not_flat_faces_every_sensor():
    """But for a few points that lie in a plane by chance."""
    clutter = np.random.default_rng(0).uniform(-1, 1, (4000, 3))
    assert faced_away(clutter, [[0.0, 0.0, 30.0]], [0.0, 0.0, -30.0]).mean() < 0.1


def test_the_back_of_a_thin_thing_is_not_reached_from_its_front():
    """A board that is thinner than the margin: the lines of sight end on its other side."""
    top, bottom = sheet(HEIGHT), sheet(0.0)
    facing = Facing.of(survey(top, SIDES[0]), np.arange(len(top)))
    other = survey(bottom, SIDES[1])
    assert sightlines(top, other, 0.1, 0.05).reached.all()
    assert not sightlines(top, other, 0.1, 0.05, facing).reached.any()


def test_what_was_seen_past_was_reached_from_either_side():
    """The board is gone: the view from below sees the ceiling above where it was."""
    board = sheet(0.0)
    board = board[np.abs(board).max(axis=1) < 0.4]
    facing = Facing.of(survey(board, SIDES[0]), np.arange(len(board)))
    lines = sightlines(board, survey(sheet(2.0), SIDES[1]), 0.1, 0.05, facing)
    assert lines.reached.all() and lines.through.all()
