import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.consensus import change_of
from gmmjax.changes.moved import LEAST_SHARE, rigid_match, with_moved

NOISE = 0.003


def box(seed, extent, count=2500, noise=0.005):
    """The sides and the top of a box, as a depth camera sees them."""
    random = np.random.default_rng(seed)
    extent = np.array(extent)
    points = random.uniform(-0.5, 0.5, (count, 3))
    face = random.integers(0, 5, count)
    points[np.arange(count), face % 3] = np.where(face < 3, 0.5, -0.5)
    return points * extent + noise * random.standard_normal((count, 3))


def motion(yaw, shift):
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec([0, 0, yaw]).as_matrix()
    transform[:3, 3] = shift
    return transform


def placed(points, transform):
    return points @ transform[:3, :3].T + transform[:3, 3]


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.2])
def test_the_same_object_elsewhere_is_laid_onto_itself(yaw):
    extent = (0.4, 0.28, 0.22)
    true = motion(yaw, [0.8, -0.3, 0.1])
    match = rigid_match(box(0, extent), placed(box(1, extent), true), NOISE)
    assert match.share > LEAST_SHARE
    corners = box(2, extent, noise=0)
    # A box is the same after half a turn: its points are compared, not the motions.
    half_turn = true @ motion(np.pi, [0, 0, 0])
    error = min(
        np.linalg.norm(placed(corners, match.transform) - placed(corners, way), axis=1).max()
        for way in (true, half_turn)
    )
    assert error < 0.02


@pytest.mark.parametrize("other", [(0.4, 0.28, 0.32), (0.3, 0.28, 0.22), (0.33, 0.33, 0.33)])
def test_another_object_is_not(other):
    assert rigid_match(box(0, (0.4, 0.28, 0.22)), box(1, other) + 0.5, NOISE).share < LEAST_SHARE


def changes(before, after):
    """The disappeared and appeared changes of clouds given as lists of objects."""
    items = [change_of(points, "disappeared", 1.0, 10.0) for points in before]
    items += [change_of(points, "appeared", 1.0, 10.0) for points in after]
    labels_before = np.repeat(np.arange(len(before)), [len(points) for points in before])
    labels_after = np.repeat(len(before) + np.arange(len(after)), [len(points) for points in after])
    return tuple(items), np.concatenate(before), np.concatenate(after), labels_before, labels_after


def test_each_object_finds_its_partner():
    flat, tall = (0.45, 0.3, 0.2), (0.25, 0.25, 0.45)
    before = [box(0, flat), box(1, tall) + 1]
    after = [box(2, tall) + np.array([-1, 1, 0]), box(3, flat) + np.array([0, 2, 0])]
    moved = with_moved(*changes(before, after), NOISE)
    assert [change.kind for change in moved] == ["moved"] * 4
    assert [change.partner for change in moved] == [3, 2, 1, 0]
    np.testing.assert_array_equal(moved[0].transform, moved[3].transform)
    np.testing.assert_allclose(placed(before[0].mean(0), moved[0].transform), after[1].mean(0), atol=0.02)


def test_a_gone_and_a_new_object_of_other_size_stay_what_they_are():
    gone, new = box(0, (0.45, 0.3, 0.2)), box(1, (0.25, 0.25, 0.3)) + 1
    assert [change.kind for change in with_moved(*changes([gone], [new]), NOISE)] == ["disappeared", "appeared"]


def test_one_kind_alone_cannot_move():
    items, before, after, labels_before, labels_after = changes([box(0, (0.3, 0.3, 0.3))], [box(1, (0.3, 0.3, 0.3))])
    assert with_moved(items[:1], before, after, labels_before, np.full_like(labels_after, -1), NOISE) == items[:1]
