import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.match import Match, MatchSettings, best_match
from gmmjax.changes.objects.overlap import Overlap
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, motion, placed

NOISE = 0.003
EXTENT = (0.4, 0.28, 0.22)
MOST_MISFIT = MatchSettings().most_misfit


def matched(gone, new):
    parts = Pair(LocalSurface.of(gone), LocalSurface.of(new))
    return best_match(parts, parts, NOISE)


def misfit(gone, new):
    return matched(gone, new).misfit


@pytest.mark.parametrize("faces", [(0, 1, 2, 3, 4), (0, 1, 2), (0, 2, 4)])
def test_one_object_is_known_again_from_other_sides(faces):
    new = placed(box(1, EXTENT, faces), motion(2.0, [0.8, -0.3, 0.1]))
    assert misfit(box(0, EXTENT, (0, 1, 2)), new) < MOST_MISFIT


@pytest.mark.parametrize("other", [(0.4, 0.28, 0.32), (0.3, 0.28, 0.22), (0.33, 0.33, 0.33)])
def test_another_object_is_not(other):
    assert misfit(box(0, EXTENT), box(1, other) + 0.5) > MOST_MISFIT


def test_of_the_transforms_that_fit_the_smallest_rotation_is_taken():
    new = placed(box(1, EXTENT), motion(0.3, [0.8, -0.3, 0]))
    transform = matched(box(0, EXTENT), new).transform
    assert Rotation.from_matrix(transform[:3, :3]).magnitude() == pytest.approx(0.3, abs=0.05)


def test_objects_that_hardly_overlap_are_not_one():
    partly, hardly = Overlap(covered=0.4, contradicted=0.0), Overlap(covered=0.25, contradicted=0.0)
    # With the support planes known less overlap is needed, and still less where the tops are equal.
    assert not Match(np.eye(4), partly, partly).one_object
    assert Match(np.eye(4), partly, partly, upright=True).one_object
    assert not Match(np.eye(4), partly, hardly, upright=True).one_object
    assert Match(np.eye(4), partly, hardly, upright=True, same_top=True).one_object
    assert Match(np.eye(4), partly, hardly, settings=MatchSettings(least_covered=0.2)).one_object


def test_contradictions_in_both_directions_add_up():
    fit = Overlap(covered=0.9, contradicted=0.05)
    match = Match(np.eye(4), fit, fit)
    assert match.misfit == pytest.approx(2 * (0.05 + 0.02 * 0.1))
    assert not match.one_object
    assert Match(np.eye(4), fit, Overlap(0.9, 0.0)).one_object
