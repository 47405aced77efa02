import numpy as np
import pytest

from gmmjax.changes.objects.outline import OutlineSettings, aligned_outlines
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, motion, placed

TRUE = motion(0.3, [1.0, 0.2, 0.0])


def misplaced(extent, faces, slid):
    parts = Pair(LocalSurface.of(box(0, extent, faces)), LocalSurface.of(placed(box(1, extent, faces), TRUE)))
    return parts, TRUE @ motion(0.0, slid)


@pytest.mark.parametrize("slid", [(0.08, 0.0, 0.0), (-0.05, 0.06, 0.0)])
def test_a_panel_is_slid_to_where_its_outline_is(slid):
    parts, transform = misplaced((0.5, 0.4, 0.02), (2,), slid)
    found = aligned_outlines(parts, transform)
    np.testing.assert_allclose(found[:3, 3], TRUE[:3, 3], atol=0.03)
    np.testing.assert_array_equal(aligned_outlines(parts, transform, OutlineSettings(determined=0.0)), transform)


def test_what_the_planes_determine_stays():
    parts, transform = misplaced((0.4, 0.3, 0.25), (0, 1, 2, 3, 4), (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(aligned_outlines(parts, transform), transform)
