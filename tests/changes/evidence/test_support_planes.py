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


def both(before, after, settings=SupportSettings()):
    points = Pair(before, after)
    under = supports(points, points.map(lambda own: np.zeros(len(own), int)), SPACING, settings)
    return under.before.all(), under.after.all()


def test_a_shelf_disappears_under_what_came_and_appears_under_what_went():
    assert both(shelf(), standing()) == (True, False)
    assert both(standing(), shelf()) == (False, True)


def test_any_side_may_be_stood_on():
    """Gravity is not known: a poster can hang on a wall that it hides."""
    turned = [[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]
    assert both(shelf() @ turned, standing() @ turned) == (True, False)


def test_what_is_next_to_it_or_reaches_through_it_does_not_stand_on_it():
    assert both(shelf(), standing(at=(1.2, 0))) == (False, False)
    assert both(shelf(), standing() + np.array([0, 0, 0.2])) == (False, False)
    assert both(shelf(), box(1, (0.3, 0.25, 0.3), noise=NOISE)) == (False, False)


def test_a_box_supports_nothing():
    """Two boxes, one gone and one new, next to each other."""
    gone, new = box(0, (0.3, 0.3, 0.3)), box(1, (0.3, 0.3, 0.3)) + np.array([0.3, 0, 0])
    assert both(gone, new) == (False, False)


def test_points_of_no_segment_are_left_alone():
    before, after = shelf(), standing()
    labels = np.where(np.arange(len(before)) % 2, 0, -1)
    under, over = supports(Pair(before, after), Pair(labels, np.full(len(after), -1)), SPACING)
    assert not under.any() and not over.any()
    under, over = supports(Pair(before, after), Pair(labels, np.zeros(len(after), int)), SPACING)
    np.testing.assert_array_equal(under, labels == 0)


def test_how_many_points_must_touch_a_support_is_a_setting():
    assert both(shelf(), standing(), SupportSettings(least_touching=10_000)) == (False, False)
    # Hanging 20 cm above the shelf.
    raised = standing() + np.array([0, 0, 0.2])
    assert both(shelf(), raised, SupportSettings(touching=30.0)) == (True, False)
