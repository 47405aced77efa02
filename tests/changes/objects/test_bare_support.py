import numpy as np
import pytest

from gmmjax.changes.objects.bare_support import BareSupportSettings, Footing
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.geometry import LocalSurface
from tests.changes.scanned_objects import level, motion, standing

NOISE = 0.003
FLOOR = SupportPlane(np.array([0.0, 0.0, 1.0]), 0.0)


def footing(floor, settings=BareSupportSettings(), **box):
    own = standing(0, **box)
    scene = LocalSurface.of(np.concatenate([own, floor(own)]))
    return Footing.of(LocalSurface.of(own), scene, FLOOR, NOISE, settings)


def bare_floor(own):
    return level(1, 0.0, hole=own)


@pytest.fixture(scope="module")
def other():
    return LocalSurface.of(standing(2, extent=(0.8, 0.28, 0.22)))


def test_a_longer_box_would_hide_the_floor_beside_this_one(other):
    share = footing(bare_floor).bare_share(other, np.eye(4))
    # Half of its length, less what is near the edges of the shorter one, and of the floor that its own side hides.
    assert 0.3 < share < 0.55


def test_the_same_box_hides_what_this_one_hides():
    same = LocalSurface.of(standing(3))
    assert footing(bare_floor).bare_share(same, np.eye(4)) < 0.01
    assert footing(bare_floor).bare_share(same, motion(np.pi / 2, np.zeros(3))) > 0.1


def test_where_the_floor_was_not_seen_nothing_stands_over_it(other):
    """Something in front hides the floor beside the box, and so it may hide the rest of a longer one."""
    assert footing(lambda own: own[:0]).bare_share(other, np.eye(4)) == 0
    hidden = footing(lambda own: (floor := bare_floor(own))[np.abs(floor[:, 0]) > 0.45])
    assert hidden.bare_share(other, np.eye(4)) < 0.05


def test_a_support_that_is_far_from_its_plane_is_none(other):
    assert footing(bare_floor, BareSupportSettings(height=0.0)).bare_share(other, np.eye(4)) == 0
