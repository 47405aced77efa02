import numpy as np

from gmmjax.changes.evidence.support_planes import SupportSettings, supports
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box

SPACING = 0.011
NOISE = 0.004


def shelf(seed=0, size=(0.9, 0.35), noise=NOISE):
    """The top of a shelf at z = 0."""
    random = np.random.default_rng(seed)
    points = random.uniform(-0.5, 0.5, (int(9000 * size[0] * size[1]), 3)) * [*size, 0]
    return points + noise * random.standard_normal(points.shape)


def standing(seed=1, extent=(0.3, 0.25, 0.3), at=(0.0, 0.0)):
    """A box whose sides begin a little above the shelf."""
    points = box(seed, extent, noise=NOISE) + np.array([*at, extent[2] / 2])
    return points[points[:, 2] > 0.015]


def around():
    """The shelf beyond what the boxes hide of it: it did not change."""
    points = shelf(7, (1.6, 1.0))
    return points[(np.abs(points[:, :2]) > [0.47, 0.19]).any(axis=1)]


def both(before, after, settings=SupportSettings(), unchanged=None):
    """Whether each of two segments is a support of the other."""
    unchanged = around() if unchanged is None else unchanged
    points = Pair(before, after).map(lambda own: np.concatenate([own, unchanged]))
    labels = Pair(before, after).map(lambda own: np.repeat([0, -1], [len(own), len(unchanged)]))
    under = supports(points, labels, SPACING, settings)
    return under.before[: len(before)].all(), under.after[: len(after)].all()


def test_a_shelf_disappears_under_what_came_and_appears_under_what_went():
    assert both(shelf(), standing()) == (True, False)
    assert both(standing(), shelf()) == (False, True)


def test_upwards_is_found_in_any_frame():
    turned = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    assert both(shelf() @ turned, standing() @ turned, unchanged=around() @ turned) == (True, False)


def test_without_an_upward_direction_nothing_is_a_support():
    assert both(shelf(), standing(), unchanged=np.zeros((0, 3))) == (False, False)
    # What hangs in the air touches nothing.
    assert both(shelf(), standing(), unchanged=around() + np.array([0, 0, 5.0])) == (False, False)


def test_an_upright_face_is_no_support():
    """The old face of a box that was shifted by 8 cm: what came stands in front of it, and on the shelf."""
    face = box(0, (0.3, 0.25, 0.3), (0,), noise=NOISE) + np.array([0, 0, 0.15])
    face, shifted = face[face[:, 2] > 0.015] - np.array([0.3, 0, 0]), standing()
    assert both(face, shifted) == (False, False)
    # Were the face the shelf, it would be one.
    on_side = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]).T
    assert both(face, shifted, unchanged=around() @ on_side - np.array([0.15, 0, 0]))[0]


def test_what_hangs_beneath_a_surface_does_not_stand_on_it():
    """Two boxes stand on the shelf, which tells where is up; a third one hangs under it."""
    hanging = standing() * np.array([1, 1, -1.0])
    others = [standing(seed, at=(0.0, at)) for seed, at in ((3, 0.55), (4, -0.55))]
    unchanged = np.concatenate([shelf(7, (1.6, 1.8))])
    unchanged = unchanged[(np.abs(unchanged[:, :2]) > [0.47, 0.19]).any(axis=1)]
    before, after = np.concatenate([shelf(), unchanged]), np.concatenate([hanging, *others, unchanged])
    labels = Pair(
        np.repeat([0, -1], [len(shelf()), len(unchanged)]),
        np.repeat([0, 1, 2, -1], [len(hanging), *map(len, others), len(unchanged)]),
    )
    assert not any(own.any() for own in supports(Pair(before, after), labels, SPACING))


def test_what_is_next_to_it_or_reaches_through_it_does_not_stand_on_it():
    assert both(shelf(), standing(at=(1.2, 0))) == (False, False)
    assert both(shelf(), standing() + np.array([0, 0, 0.2])) == (False, False)
    assert both(shelf(), box(1, (0.3, 0.25, 0.3), noise=NOISE)) == (False, False)


def test_a_box_supports_nothing():
    """Two boxes, one gone and one new, next to each other."""
    gone, new = box(0, (0.3, 0.3, 0.3)), box(1, (0.3, 0.3, 0.3)) + np.array([0.3, 0, 0])
    assert both(gone, new) == (False, False)


def test_points_of_no_segment_are_left_alone():
    before, after = np.concatenate([shelf(), around()]), standing()
    labels = np.where((np.arange(len(before)) % 2 == 1) & (np.arange(len(before)) < len(shelf())), 0, -1)
    under, over = supports(Pair(before, after), Pair(labels, np.full(len(after), -1)), SPACING)
    assert not under.any() and not over.any()
    under, over = supports(Pair(before, after), Pair(labels, np.zeros(len(after), int)), SPACING)
    np.testing.assert_array_equal(under, labels == 0)


def test_how_many_points_must_touch_a_support_is_a_setting():
    assert both(shelf(), standing(), SupportSettings(min_touching=10_000)) == (False, False)
    # Hanging 20 cm above the shelf.
    raised = standing() + np.array([0, 0, 0.2])
    assert both(shelf(), raised, SupportSettings(touching=30.0, around=30.0)) == (True, False)
