import numpy as np
import pytest

from gmmjax.changes.objects.overlap import overlap
from gmmjax.geometry.local_surface import LocalSurface
from tests.changes.scanned_objects import box, motion, placed

NOISE = 0.003
EXTENT = (0.4, 0.28, 0.22)


def fits(one, other, scene=None):
    other = LocalSurface.of(other)
    return overlap(LocalSurface.of(one), np.eye(4), other, scene or other, NOISE, 500)


def test_an_object_fits_itself():
    fit = fits(box(0, EXTENT), box(1, EXTENT))
    assert fit.covered > 0.97 and fit.contradicted < 0.02


def test_sides_that_the_other_survey_did_not_see_do_not_contradict():
    whole, some = box(0, EXTENT), box(1, EXTENT, faces=(0, 1, 2))
    assert fits(some, whole).covered > 0.97
    fit = fits(whole, some)
    assert fit.covered < 0.75 and fit.contradicted < 0.04


@pytest.mark.parametrize("longer", [0, 1, 2])
def test_a_greater_object_does_not_fit(longer):
    extent = np.array(EXTENT)
    extent[longer] += 0.08
    # Laid corner onto corner, so that all that is greater is on one side.
    shift = np.zeros(3)
    shift[longer] = -0.04
    greater = box(1, extent) + shift
    assert max(fits(box(0, EXTENT), greater).contradicted, fits(greater, box(0, EXTENT)).contradicted) > 0.08


def test_what_lies_on_another_surface_of_the_scene_says_nothing():
    """The lowest points of an object, say, that only the other segment took for the floor."""
    whole, shorter = box(0, EXTENT), box(1, EXTENT)
    lowest = shorter[:, 2] < -0.06
    assert fits(whole, shorter[~lowest]).contradicted > 0.08
    assert fits(whole, shorter[~lowest], LocalSurface.of(shorter)).contradicted < 0.02


def test_a_rigid_motion_of_both_changes_nothing():
    one, other, way = box(0, EXTENT), box(1, (0.4, 0.28, 0.3)), motion(0.7, [3, -2, 1])
    here, there = fits(one, other), fits(placed(one, way), placed(other, way))
    assert there.covered == pytest.approx(here.covered, abs=0.01)
    assert there.contradicted == pytest.approx(here.contradicted, abs=0.01)
