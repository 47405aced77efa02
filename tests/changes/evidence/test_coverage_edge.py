import numpy as np
import pytest

from gmmjax.changes.evidence.coverage_edge import CoverageEdgeSettings, ReferenceSurfaces, at_coverage_edge
from tests.mixtures.examples import random_rotation

SPACING = 0.02
FLOOR = (np.array([0.0, 0, 0]), np.array([2.0, 0, 0]), np.array([0, 2.0, 0]))
# The wall at x = 0 that only one survey saw, the floor beside it, and a part of the wall that both saw.
WALL = (np.array([0.0, 0, 0.5]), np.array([0, 2.0, 0]), np.array([0, 0, 1.0]))
LOW_WALL = (np.array([0.0, 0, 0]), np.array([0, 2.0, 0]), np.array([0, 0, 0.5]))


def patch(corner, first, second, seed=0):
    """A flat grid of points over a parallelogram, a little noisy."""
    counts = [int(np.linalg.norm(side) / SPACING) for side in (first, second)]
    u, v = (grid.ravel()[:, None] for grid in np.meshgrid(*(np.arange(count) / count for count in counts)))
    points = corner + u * first + v * second
    return points + 0.001 * np.random.default_rng(seed).standard_normal(points.shape)


def share_at_edge(segment, unchanged, other, settings=CoverageEdgeSettings()):
    reference = ReferenceSurfaces.of(unchanged, other, 0.01, SPACING)
    found = at_coverage_edge(segment, reference, 0.01, settings)
    assert found.shape == (len(segment),) and found.dtype == bool
    return found.mean()


def room():
    """The wall, what both surveys saw of the room, and what the other one saw of that."""
    both = np.concatenate([patch(*FLOOR, seed=1), patch(*LOW_WALL, seed=2)])
    return patch(*WALL), both, both + 0.001


def test_a_wall_behind_which_the_other_survey_has_nothing_was_not_seen():
    assert share_at_edge(*room()) > 0.95


def test_the_motion_of_the_room_changes_nothing():
    rotation, shift = random_rotation(), np.array([3.0, -2, 1])
    moved = (points @ rotation.T + shift for points in room())
    assert share_at_edge(*moved) > 0.95


def test_a_wall_that_the_other_survey_looked_past_was_built():
    wall, both, other = room()
    beyond = patch(*FLOOR, seed=3) - [2.0, 0, 0]
    assert share_at_edge(wall, both, np.concatenate([other, beyond])) == 0


def test_a_few_stray_points_behind_a_wall_are_no_view_past_it():
    wall, both, other = room()
    stray = np.random.default_rng(4).uniform([-1, 0, 0], [-0.2, 2, 1], (len(other) // 200, 3))
    assert share_at_edge(wall, both, np.concatenate([other, stray])) > 0.95
    assert share_at_edge(wall, both, np.concatenate([other, np.repeat(stray, 4, axis=0)])) == 0


def test_a_wall_beside_which_the_other_survey_has_points_has_no_hole_there():
    """The other cloud has the wall, but for every third of its rows."""
    wall, both, other = room()
    seen = wall[np.floor(wall[:, 2] / SPACING) % 3 > 0]
    assert share_at_edge(wall, both, np.concatenate([other, seen])) == 0


def test_the_top_of_a_box_hides_the_floor():
    """Nothing is above it, as nothing is behind a wall, but the other cloud has the floor that it hides."""
    top = patch(np.array([0.5, 0.5, 0.3]), np.array([0.6, 0, 0]), np.array([0, 0.6, 0]))
    floor = patch(*FLOOR, seed=1)
    hidden = ((floor[:, :2] > 0.5) & (floor[:, :2] < 1.1)).all(axis=1)
    assert share_at_edge(top, floor[~hidden], floor) == 0
    # A table that was seen with the floor below: the other survey did not see its top.
    assert share_at_edge(top, floor, floor) > 0.95


@pytest.mark.parametrize("count", [1, 7])
def test_few_points_are_no_wall(count):
    wall, both, other = room()
    assert share_at_edge(wall[:count], both, other) == 0


def test_what_fills_a_volume_is_no_wall():
    _, both, other = room()
    cloud = np.random.default_rng(5).uniform([0, 0, 0.5], [0.6, 0.6, 1.1], (3000, 3))
    assert share_at_edge(cloud, both, other) < 0.2


def test_how_many_points_may_be_behind_a_wall_is_a_setting():
    wall, both, other = room()
    beyond = np.concatenate([other, patch(*FLOOR, seed=3) - [2.0, 0, 0]])
    assert share_at_edge(wall, both, beyond, CoverageEdgeSettings(max_behind=1.0)) > 0.95
