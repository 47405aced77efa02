import numpy as np

from gmmjax.changes.objects.cloud_changes import change_of
from gmmjax.changes.objects.match import MatchSettings
from gmmjax.changes.objects.moved import MovedSettings, with_moved
from gmmjax.changes.objects.rigid_match import RigidMatchSettings
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, placed

NOISE = 0.003


def changes(before, after):
    """The disappeared and appeared changes of clouds given as lists of objects."""
    items = [change_of(points, "disappeared", 1.0, 10.0) for points in before]
    items += [change_of(points, "appeared", 1.0, 10.0) for points in after]
    labels_before = np.repeat(np.arange(len(before)), [len(points) for points in before])
    labels_after = np.repeat(len(before) + np.arange(len(after)), [len(points) for points in after])
    surfaces = Pair(LocalSurface.of(np.concatenate(before)), LocalSurface.of(np.concatenate(after)))
    return tuple(items), surfaces, Pair(labels_before, labels_after)


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
    items, surfaces, labels = changes([box(0, (0.3, 0.3, 0.3))], [box(1, (0.3, 0.3, 0.3))])
    disappeared = Pair(labels.before, np.full_like(labels.after, -1))
    assert with_moved(items[:1], surfaces, disappeared, NOISE) == items[:1]


def test_settings_reach_the_match():
    extent, unrotated = (0.2, 0.16, 0.14), RigidMatchSettings(rotations=1)
    given = changes([box(0, extent)], [box(1, extent) + 1])
    settings = MovedSettings(match=MatchSettings(rigid=unrotated))
    assert [change.kind for change in with_moved(*given, NOISE, settings)] == ["moved", "moved"]
    strict = MovedSettings(match=MatchSettings(rigid=unrotated, most_misfit=0.0))
    # The extents of the two are equal up to noise.
    for settings in (strict, MovedSettings(most_extent_ratio=1.0)):
        assert [change.kind for change in with_moved(*given, NOISE, settings)] == ["disappeared", "appeared"]
