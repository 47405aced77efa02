import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.consensus import change_of
from gmmjax.changes.objects.moved import with_moved
from gmmjax.changes.objects.upright import Ground, grounds, standing_motions, stays_standing, top_of
from gmmjax.geometry.local_surface import LocalSurface, moved_points
from tests.changes.scanned_objects import box, motion, placed

NOISE = 0.003
EXTENT = (0.4, 0.28, 0.22)
SIDES = (0, 1, 2, 3, 4)


def level(seed, height, middle=(0.0, 0.0), half=0.7, hole=None, spacing=0.012):
    """A floor or a shelf, and what of it an object (a box that is cut out) does not hide."""
    steps = np.arange(-half, half, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    noise = NOISE * np.random.default_rng(seed).standard_normal((3, len(x)))
    points = np.stack([x + middle[0], y + middle[1], np.full(len(x), height)], axis=1) + noise.T
    if hole is None:
        return points
    return points[~((points[:, :2] > hole.min(axis=0)[:2]) & (points[:, :2] < hole.max(axis=0)[:2])).all(axis=1)]


def standing(seed, extent=EXTENT, height=0.0, middle=(0.0, 0.0), yaw=0.0, faces=SIDES):
    """A box with its foot at this height."""
    points = placed(box(seed, extent, faces), motion(yaw, [0, 0, 0]))
    return points + np.array([*middle, height + extent[2] / 2])


def grounds_of(objects, background):
    return grounds([LocalSurface.of(points) for points in objects], background, NOISE)


@pytest.fixture(scope="module")
def on_floor_and_shelf():
    """A box on the floor and one on a shelf, and what is around them."""
    objects = standing(0), standing(1, height=0.6, middle=(1.0, 0.0))
    return objects, np.concatenate([level(2, 0.0, hole=objects[0]), level(3, 0.6, (1.0, 0.0), 0.3, hole=objects[1])])


def test_the_ground_is_what_objects_stand_on(on_floor_and_shelf):
    objects, background = on_floor_and_shelf
    for ground, height in zip(grounds_of(objects, background), (0.0, 0.6), strict=True):
        np.testing.assert_allclose(ground.up, [0, 0, 1], atol=0.03)
        assert ground.above(np.array([[0.0, 0.0, height], [1.0, 0.0, height]])).min() == pytest.approx(0, abs=0.04)


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_a_rigid_motion_turns_the_ground_with_the_scene(on_floor_and_shelf, seed):
    objects, background = on_floor_and_shelf
    transform = np.eye(4)
    transform[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    transform[:3, 3] = [3.0, -1.0, 2.0]
    turned = grounds_of([moved_points(points, transform) for points in objects], moved_points(background, transform))
    for ground, other in zip(grounds_of(objects, background), turned, strict=True):
        np.testing.assert_allclose(other.up, transform[:3, :3] @ ground.up, atol=1e-6)
        assert other.height == pytest.approx(ground.height + other.up @ transform[:3, 3], abs=1e-6)


def test_what_was_not_seen_is_no_ground(on_floor_and_shelf):
    objects, background = on_floor_and_shelf
    floor = background[background[:, 2] < 0.3]
    assert [ground is None for ground in grounds_of(objects, floor)] == [False, True]
    assert grounds_of(objects, np.zeros((0, 3))) == [None, None]


def test_an_object_stays_standing_when_it_is_put_elsewhere(on_floor_and_shelf):
    objects, background = on_floor_and_shelf
    first, second = grounds_of(objects, background)
    middle, reach = objects[1].mean(axis=0), 3 * NOISE
    carried = motion(1.2, [1.0, 0.0, 0.6])
    assert stays_standing(carried, first, second, middle, reach)
    sunk = motion(1.2, [1.0, 0.0, 0.57])
    assert not stays_standing(sunk, first, second, middle, reach)
    tilted = carried.copy()
    tilted[:3, :3] = Rotation.from_euler("x", 40, degrees=True).as_matrix() @ carried[:3, :3]
    tilted[:3, 3] += middle - moved_points(middle[None] - [1.0, 0.0, 0.6], tilted)[0]
    assert not stays_standing(tilted, first, second, middle, reach)


def test_all_motions_that_are_tried_keep_it_standing(on_floor_and_shelf):
    objects, background = on_floor_and_shelf
    first, second = grounds_of(objects, background)
    motions = standing_motions(*(LocalSurface.of(points) for points in objects), first, second)
    turns = {round(float(np.degrees(Rotation.from_matrix(each[:3, :3]).magnitude()))) for each in motions}
    assert len(turns) > 10
    for each in motions:
        assert stays_standing(each, first, second, objects[1].mean(axis=0), 1e-6)
        np.testing.assert_allclose(each[:3, :3] @ each[:3, :3].T, np.eye(3), atol=1e-12)


def test_a_top_has_the_sides_and_the_height_of_the_object_however_it_is_turned():
    tops = []
    for seed, yaw in ((0, 0.0), (1, 0.6), (2, 2.5)):
        part = LocalSurface.of(standing(seed, yaw=yaw))
        tops.append(top_of(part, Ground(np.array([0.0, 0.0, 1.0]), 0.0), NOISE))
    for top in tops:
        np.testing.assert_allclose(top.sides, [0.28, 0.4], atol=0.02)
        assert top.height == pytest.approx(0.22, abs=0.01)
        assert top.like(tops[0], NOISE)
    other = LocalSurface.of(standing(3, (0.4, 0.25, 0.22), yaw=1.0))
    assert not top_of(other, Ground(np.array([0.0, 0.0, 1.0]), 0.0), NOISE).like(tops[0], NOISE)


def test_what_shows_its_sides_alone_has_no_top():
    part = LocalSurface.of(standing(0, faces=(0, 1, 3)))
    assert top_of(part, Ground(np.array([0.0, 0.0, 1.0]), 0.0), NOISE) is None


def kinds(gone, new, floors):
    """What becomes of two changes in a scene."""
    before, after = np.concatenate([gone, floors[0]]), np.concatenate([new, floors[1]])
    items = change_of(gone, "disappeared", 1.0, 10.0), change_of(new, "appeared", 1.0, 10.0)
    labels = [np.where(np.arange(len(cloud)) < own, index, -1) for index, (cloud, own) in
              enumerate([(before, len(gone)), (after, len(new))])]  # fmt: skip
    moved = with_moved(items, LocalSurface.of(before), LocalSurface.of(after), *labels, NOISE)
    return [change.kind for change in moved]


def test_a_lower_box_of_the_same_outline_is_another_one():
    """Top on top it would be sunk into the floor, and where it would stand its top is too low."""
    gone, other = standing(0), standing(1, (0.4, 0.28, 0.19), middle=(0.3, 0.5), yaw=0.4)
    floors = level(2, 0.0, hole=gone), level(3, 0.0, hole=other)
    assert kinds(gone, other, floors) == ["disappeared", "appeared"]
    assert kinds(gone, standing(1, middle=(0.3, 0.5), yaw=0.4), floors) == ["moved", "moved"]


def test_one_object_is_known_again_by_its_top():
    """Seen from opposite corners, its sides have nothing in common."""
    gone, new = standing(0, faces=(0, 1, 2)), standing(1, middle=(0.4, 0.4), yaw=2.0, faces=(2, 3, 4))
    floors = level(2, 0.0, hole=gone), level(3, 0.0, hole=new)
    assert kinds(gone, new, floors) == ["moved", "moved"]
