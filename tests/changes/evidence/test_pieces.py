import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax.changes.evidence.coverage_edge import ReferenceSurfaces
from gmmjax.changes.evidence.pieces import cut
from tests.changes.evidence.floors import LIMITS, SPACING, cube, plane

FLOOR = plane((3, 3), (4, 4), 0.0)
CUBE = cube((1.0, 1.0), 0.4)
HIGH = CUBE[:, 2] > 0.2


@pytest.fixture(scope="module")
def reference():
    """A floor far from the cube, in both clouds."""
    return ReferenceSurfaces(cKDTree(FLOOR), cKDTree(FLOOR), 0.01, LIMITS.spacing)


def pieces_of(points, reference, free=None):
    return cut(points, np.zeros(len(points), int), reference, free)[0]


def test_a_candidate_is_one_piece_where_the_views_are_not_known(reference):
    assert set(pieces_of(CUBE, reference)) == {0}


def test_it_is_cut_where_what_was_seen_through_ends(reference):
    pieces = pieces_of(CUBE, reference, HIGH)
    assert set(pieces) == {0, 1}
    # The neighbours of a point by whose most it goes are at most two spacings away.
    clear = np.abs(CUBE[:, 2] - 0.2) > 2 * SPACING
    assert len(set(pieces[clear & HIGH])) == len(set(pieces[clear & ~HIGH])) == 1
    assert pieces[clear & HIGH][0] != pieces[clear & ~HIGH][0]


@pytest.mark.parametrize("seen_through", [0.2, 0.8])
def test_single_lines_of_sight_do_not_cut_it(reference, seen_through):
    free = np.random.default_rng(0).random(len(CUBE)) < seen_through
    assert set(pieces_of(CUBE, reference, free)) == {0}


def test_permuting_the_points_permutes_the_pieces(reference):
    order = np.random.default_rng(1).permutation(len(CUBE))
    pieces = pieces_of(CUBE, reference, HIGH)
    there = pieces_of(CUBE[order], reference, HIGH[order])
    same = pieces[order] == there
    assert same.all() or not same.any()
