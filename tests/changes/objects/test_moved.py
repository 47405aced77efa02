import numpy as np
import pytest

from gmmjax.changes.objects import moved as moved_objects
from gmmjax.changes.objects.cloud_changes import change_of
from gmmjax.changes.objects.in_place import _hinged as hinged_motions
from gmmjax.changes.objects.moved import match_moved_objects
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, level, motion, placed, registered, standing

NOISE = 0.003
FLAT, TALL = (0.45, 0.3, 0.2), (0.25, 0.25, 0.45)


def changes(before, after):
    """The disappeared and appeared changes of clouds given as lists of objects."""
    items = [change_of(points, "disappeared", 1.0, 10.0) for points in before]
    items += [change_of(points, "appeared", 1.0, 10.0) for points in after]
    labels_before = np.repeat(np.arange(len(before)), [len(points) for points in before])
    labels_after = np.repeat(len(before) + np.arange(len(after)), [len(points) for points in after])
    return tuple(items), Pair(labels_before, labels_after), registered(np.concatenate(before), np.concatenate(after))


def hypotheses_of(before, after):
    items, labels, pair = changes(before, after)
    return items, labels, pair.surfaces, NOISE


def kinds_and_places(items):
    """Kind, middle and the partner's middle of each change, in an order that does not depend on the labels."""
    partners = [None if item.partner is None else items[item.partner].mean.round(1).tolist() for item in items]
    return sorted(
        (item.kind, item.mean.round(1).tolist(), partner) for item, partner in zip(items, partners, strict=True)
    )


def test_each_object_finds_its_partner():
    before = [box(0, FLAT), box(1, TALL) + 3]
    after = [box(2, TALL) + np.array([-1, 1, 0]), box(3, FLAT) + np.array([0, 2, 0])]
    moved, labels = match_moved_objects(*changes(before, after), NOISE)
    assert [change.kind for change in moved] == ["moved"] * 4
    for index, change in enumerate(moved):
        partner = moved[change.partner]
        assert partner.partner == index and partner.moved_probability == change.moved_probability > 0.5
        np.testing.assert_array_equal(partner.transform, change.transform)
    first = moved[labels.before[0]]
    assert first.partner == labels.after[-1]
    np.testing.assert_allclose(placed(before[0].mean(0), first.transform), after[1].mean(0), atol=0.02)


def test_a_partner_is_not_given_away_for_two_that_are_none():
    before, after = [box(0, FLAT), box(1, TALL) + 2], [box(2, FLAT) + 4, box(3, (0.4, 0.3, 0.3)) + 6]
    moved, labels = match_moved_objects(*changes(before, after), NOISE)
    assert moved[labels.before[0]].partner == labels.after[0]
    assert sorted(change.kind for change in moved) == ["appeared", "disappeared", "moved", "moved"]


@pytest.mark.slow
def test_look_alikes_are_not_paired():
    """Two equal bags are gone and two are new: which is which cannot be known."""
    before, after = [box(0, FLAT), box(1, FLAT) + 2], [box(2, FLAT) + 4, box(3, FLAT) + 6]
    moved, _ = match_moved_objects(*changes(before, after), NOISE)
    assert all(change.kind != "moved" and change.partner is None for change in moved)


def test_strips_and_patches_of_walls_are_not_paired():
    strip, patch = box(0, (1.0, 0.03, 0.02)), box(1, (0.5, 0.4, 0.02), faces=(2,))
    before, after = [strip, patch + 3], [box(2, (1.0, 0.03, 0.02)) + 6, box(3, (0.5, 0.4, 0.02), faces=(2,)) + 9]
    assert all(change.partner is None for change in match_moved_objects(*changes(before, after), NOISE)[0])


def test_a_gone_and_a_new_object_of_other_size_stay_what_they_are():
    gone, new = box(0, FLAT), box(1, (0.25, 0.25, 0.3)) + 1
    items, labels, pair = changes([gone], [new])
    moved, followed = match_moved_objects(items, labels, pair, NOISE)
    assert kinds_and_places(moved) == kinds_and_places(items)
    assert moved[followed.before[0]].kind == "disappeared" and moved[followed.after[0]].kind == "appeared"


def test_one_kind_alone_cannot_move():
    items, labels, pair = changes([box(0, (0.3, 0.3, 0.3))], [box(1, (0.3, 0.3, 0.3)) + 1])
    unchanged = np.full_like(labels.after, -1)
    moved, _ = match_moved_objects(items[:1], Pair(labels.before, unchanged), pair, NOISE)
    assert [change.kind for change in moved] == ["disappeared"]
    assert match_moved_objects((), Pair(unchanged, unchanged), pair, NOISE)[0] == ()


def test_only_the_most_similar_pairs_are_registered(monkeypatch):
    monkeypatch.setattr(moved_objects, "MAX_PAIRS", 1)
    before, after = [box(0, FLAT), box(1, TALL) + 2], [box(2, (0.42, 0.3, 0.2)) + 4, box(3, TALL) + 6]
    assert [pair for pair in moved_objects.pair_hypotheses(*hypotheses_of(before, after))] == [(1, 3)]


def kinds(gone, new, floors):
    """What becomes of two changes in a scene."""
    before, after = np.concatenate([gone, floors[0]]), np.concatenate([new, floors[1]])
    items = change_of(gone, "disappeared", 1.0, 10.0), change_of(new, "appeared", 1.0, 10.0)
    labels = [np.where(np.arange(len(cloud)) < own, index, -1) for index, (cloud, own) in
              enumerate([(before, len(gone)), (after, len(new))])]  # fmt: skip
    moved, _ = match_moved_objects(items, Pair(*labels), registered(before, after), NOISE)
    return [change.kind for change in moved]


@pytest.mark.slow
def test_a_lower_box_of_the_same_outline_is_another_one():
    """Top on top it would be sunk into the floor, and where it would stand its top is too low."""
    gone, other = standing(0), standing(1, (0.4, 0.28, 0.19), middle=(0.3, 0.5), yaw=0.4)
    floors = level(2, 0.0, hole=gone), level(3, 0.0, hole=other)
    assert kinds(gone, other, floors) == ["disappeared", "appeared"]
    assert kinds(gone, standing(1, middle=(0.3, 0.5), yaw=0.4), floors) == ["moved", "moved"]


def test_one_object_is_recognised_by_its_top():
    """Seen from opposite corners, its sides have nothing in common."""
    gone, new = standing(0, faces=(0, 1, 2)), standing(1, middle=(0.4, 0.4), yaw=2.0, faces=(2, 3, 4))
    floors = level(2, 0.0, hole=gone), level(3, 0.0, hole=new)
    assert kinds(gone, new, floors) == ["moved", "moved"]


def shifted_box(way, extent=(0.4, 0.28, 0.22)):
    """A box on a floor before, and one after a motion; only the slivers that a point comparison sees are changes."""
    floors = [level(seed, 0.0, half=0.8) for seed in (4, 5)]
    boxes = standing(0), placed(standing(1, extent), way)
    clouds = [np.concatenate([own, floor]) for own, floor in zip(boxes, floors, strict=True)]
    pair = registered(*clouds)
    far = [
        other.tree.query(own[: len(part)])[0] > 0.035
        for own, part, other in zip(clouds, boxes, pair.surfaces.swapped, strict=True)
    ]
    labels = [np.full(len(own), -1) for own in clouds]
    for index, (label, sliver) in enumerate(zip(labels, far, strict=True)):
        label[: len(sliver)][sliver] = index
    items = tuple(
        change_of(own[label >= 0], kind, 0.9, 10.0)
        for own, label, kind in zip(clouds, labels, ("disappeared", "appeared"), strict=True)
    )
    return items, Pair(*labels), pair, len(boxes[0])


def test_a_box_that_was_shifted_in_its_place_is_one_object_with_its_motion():
    way = motion(0.0, [0.06, 0.03, 0.0])
    items, labels, pair, count = shifted_box(way)
    assert (labels.before >= 0).sum() < 0.5 * count
    moved, grown = match_moved_objects(items, labels, pair, NOISE)
    assert [change.kind for change in moved] == ["moved", "moved"]
    np.testing.assert_allclose(moved[0].transform, way, atol=0.012)
    assert (grown.before[:count] >= 0).mean() > 0.85 and (grown.before[count:] >= 0).mean() < 0.02
    assert moved[grown.before.max()].point_count == (grown.before >= 0).sum()


def test_an_object_that_was_replaced_by_a_greater_one_did_not_move():
    items, labels, pair, _ = shifted_box(motion(0.0, [0.0, 0.0, 0.0]), (0.55, 0.4, 0.3))
    moved, grown = match_moved_objects(items, labels, pair, NOISE)
    assert sorted(change.kind for change in moved) == ["appeared", "disappeared"]
    np.testing.assert_array_equal(grown.before >= 0, labels.before >= 0)


def test_a_door_that_was_closed_is_found_in_the_plane_of_its_wall():
    """Opened by 40 degrees it is a change; closed it is a part of the wall, and no change is reported there."""
    random = np.random.default_rng(0)
    spacing = 0.02
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(-1.6, 1.6, spacing), np.arange(0, 2, spacing)))
    wall = np.stack([x, np.zeros_like(x), z], axis=1)
    leaf = wall[(x > 0) & (x < 0.8) & (z < 1.8)]
    wall = wall[(x < 0) | (x >= 0.8) | (z >= 1.8)]
    floor = placed(level(1, 0.0, half=1.6, spacing=spacing), motion(0.0, [0.0, -1.6, 0.0]))
    way = motion(-0.7, [0.0, 0.0, 0.0])
    before, after = (
        np.concatenate([own, wall, floor]) + 0.002 * random.standard_normal((len(own) + len(wall) + len(floor), 3))
        for own in (leaf, placed(leaf, way))
    )
    labels = Pair(np.full(len(before), -1), np.full(len(after), -1))
    labels.after[: len(leaf)][leaf[:, 0] > 0.1] = 0
    items = (change_of(after[labels.after == 0], "appeared", 0.9, 10.0),)
    moved, grown = match_moved_objects(items, labels, registered(before, after), NOISE)
    assert [change.kind for change in moved] == ["moved", "moved"]
    np.testing.assert_allclose(moved[0].transform, way, atol=0.03)
    assert (grown.before[: len(leaf)] >= 0).mean() > 0.6


def test_two_panels_give_the_rotation_about_their_hinge():
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0.1, 0.8, 0.02), np.arange(0, 1.8, 0.02)))
    leaf = np.stack([x, np.zeros_like(x), z], axis=1)
    leaf += 0.002 * np.random.default_rng(0).standard_normal(leaf.shape)
    way = motion(-0.7, [0.0, 0.0, 0.0])
    turns = hinged_motions(Pair(leaf, placed(leaf, way)), 0.01)
    assert min(np.abs(turn - way).max() for turn in turns) < 0.02
    assert hinged_motions(Pair(leaf, leaf + 0.1), 0.01) == []
