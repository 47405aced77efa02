import numpy as np
import pytest

from gmmjax.changes.agreement import Agreement, agreement
from gmmjax.changes.free_space import Survey
from gmmjax.clouds import SensorViews
from tests.changes.scanned_objects import box, motion, placed

NOISE = 0.003
EXTENT = (0.4, 0.28, 0.22)


def fits(one, other, survey=None):
    return agreement(one, other, survey or Survey(other), NOISE, 500)


def test_an_object_fits_itself():
    fit = fits(box(0, EXTENT), box(1, EXTENT))
    assert fit.covered > 0.97 and fit.share > 0.98


def test_sides_that_the_other_survey_did_not_see_do_not_contradict():
    whole, some = box(0, EXTENT), box(1, EXTENT, faces=(0, 1, 2))
    assert fits(some, whole).covered > 0.97
    fit = fits(whole, some)
    assert fit.covered < 0.75 and fit.share > 0.95


@pytest.mark.parametrize("longer", [0, 1, 2])
def test_a_greater_object_does_not_fit(longer):
    extent = np.array(EXTENT)
    extent[longer] += 0.08
    # Laid corner onto corner, so that all that is greater is on one side.
    shift = np.zeros(3)
    shift[longer] = -0.04
    greater = box(1, extent) + shift
    assert min(fits(box(0, EXTENT), greater).share, fits(greater, box(0, EXTENT)).share) < 0.9


def test_what_lies_on_another_surface_that_the_survey_saw_says_nothing():
    """The lowest points of an object, say, that only the other segment took for the floor."""
    whole, shorter = box(0, EXTENT), box(1, EXTENT)
    lowest = shorter[:, 2] < -0.06
    survey = Survey(shorter)
    assert fits(whole, shorter[~lowest]).share < 0.9
    assert fits(whole, shorter[~lowest], survey).share > 0.97


def patch(half, depth, spacing=0.01):
    """A square across the z axis."""
    steps = np.arange(-half, half, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    return np.stack([x, y, np.full_like(x, depth)], axis=1)


def test_with_views_what_was_looked_through_contradicts_and_what_was_hidden_does_not():
    front = patch(0.15, 1.0)
    views = SensorViews(np.eye(4)[None], (60.0, 60.0), 5.0)
    seen, blind = Survey(np.concatenate([front, patch(1.5, 2.0)]), views), Survey(front)
    # A box behind the patch, in its shadow, and one that is wider than the shadow.
    shadow = np.concatenate([front, patch(0.1, 1.2)])
    wider = np.concatenate([front, patch(0.4, 1.2)])
    assert fits(shadow, front, seen).contradicted < 0.02
    assert fits(wider, front, blind).contradicted < 0.02
    assert fits(wider, front, seen).contradicted > 0.5
    nearer = np.concatenate([front, patch(0.1, 0.8)])
    assert fits(nearer, front, seen).contradicted > 0.2


def test_a_rigid_motion_of_both_changes_nothing():
    one, other, way = box(0, EXTENT), box(1, (0.4, 0.28, 0.3)), motion(0.7, [3, -2, 1])
    here, there = fits(one, other), fits(placed(one, way), placed(other, way))
    assert there.covered == pytest.approx(here.covered, abs=0.01)
    assert there.contradicted == pytest.approx(here.contradicted, abs=0.01)


def test_the_share_is_of_what_says_anything():
    assert Agreement(0.6, 0.2).share == pytest.approx(0.75)
    assert Agreement(0.0, 0.0).share == 0
