import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.consensus import change_of
from gmmjax.changes.objects.moved import MOST_MISFIT, best_match, with_moved
from gmmjax.geometry.local_surface import LocalSurface
from tests.changes.scanned_objects import box, motion, placed

NOISE = 0.003
EXTENT = (0.4, 0.28, 0.22)


def matched(gone, new):
    gone, new = LocalSurface.of(gone), LocalSurface.of(new)
    return best_match(gone, new, gone, new, NOISE)


def misfit(gone, new):
    return matched(gone, new).misfit


@pytest.mark.parametrize("faces", [(0, 1, 2, 3, 4), (0, 1, 2), (0, 2, 4)])
def test_one_object_is_known_again_from_other_sides(faces):
    new = placed(box(1, EXTENT, faces), motion(2.0, [0.8, -0.3, 0.1]))
    assert misfit(box(0, EXTENT, (0, 1, 2)), new) < MOST_MISFIT


@pytest.mark.parametrize("other", [(0.4, 0.28, 0.32), (0.3, 0.28, 0.22), (0.33, 0.33, 0.33)])
def test_another_object_is_not(other):
    assert misfit(box(0, EXTENT), box(1, other) + 0.5) > MOST_MISFIT


def test_of_the_motions_that_fit_the_least_turn_is_meant():
    new = placed(box(1, EXTENT), motion(0.3, [0.8, -0.3, 0]))
    transform = matched(box(0, EXTENT), new).transform
    assert Rotation.from_matrix(transform[:3, :3]).magnitude() == pytest.approx(0.3, abs=0.05)


def changes(before, after):
    """The disappeared and appeared changes of clouds given as lists of objects."""
    items = [change_of(points, "disappeared", 1.0, 10.0) for points in before]
    items += [change_of(points, "appeared", 1.0, 10.0) for points in after]
    labels_before = np.repeat(np.arange(len(before)), [len(points) for points in before])
    labels_after = np.repeat(len(before) + np.arange(len(after)), [len(points) for points in after])
    surveys = LocalSurface.of(np.concatenate(before)), LocalSurface.of(np.concatenate(after))
    return tuple(items), *surveys, labels_before, labels_after


def test_each_object_finds_its_partner():
    flat, tall = (0.45, 0.3, 0.2), (0.25, 0.25, 0.45)
    before = [box(0, flat), box(1, tall) + 1]
    after = [box(2, tall) + np.array([-1, 1, 0]), box(3, flat) + np.array([0, 2, 0])]
    moved = with_moved(*changes(before, after), NOISE)
    assert [change.kind for change in moved] == ["moved"] * 4
    assert [change.partner for change in moved] == [3, 2, 1, 0]
    np.testing.assert_array_equal(moved[0].transform, moved[3].transform)
    np.testing.assert_allclose(placed(before[0].mean(0), moved[0].transform), after[1].mean(0), atol=0.02)


def test_a_partner_is_not_given_away_for_two_that_are_none():
    """The sum of what fits badly must not outweigh what fits well."""
    flat, tall = (0.45, 0.3, 0.2), (0.25, 0.25, 0.45)
    moved = with_moved(
        *changes([box(0, flat), box(1, tall) + 2], [box(2, flat) + 4, box(3, (0.4, 0.3, 0.3)) + 6]), NOISE
    )
    assert [change.kind for change in moved] == ["moved", "disappeared", "moved", "appeared"]


def test_a_gone_and_a_new_object_of_other_size_stay_what_they_are():
    gone, new = box(0, (0.45, 0.3, 0.2)), box(1, (0.25, 0.25, 0.3)) + 1
    assert [change.kind for change in with_moved(*changes([gone], [new]), NOISE)] == ["disappeared", "appeared"]


def test_one_kind_alone_cannot_move():
    items, before, after, labels_before, labels_after = changes([box(0, (0.3, 0.3, 0.3))], [box(1, (0.3, 0.3, 0.3))])
    assert with_moved(items[:1], before, after, labels_before, np.full_like(labels_after, -1), NOISE) == items[:1]
