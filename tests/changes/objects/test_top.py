import numpy as np
import pytest

from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.objects.top import top_of
from gmmjax.geometry.local_surface import LocalSurface
from tests.changes.scanned_objects import standing

NOISE = 0.003
FLOOR = SupportPlane(np.array([0.0, 0.0, 1.0]), 0.0)


def test_a_top_has_the_sides_and_the_height_of_the_object_however_it_is_rotated():
    tops = []
    for seed, yaw in ((0, 0.0), (1, 0.6), (2, 2.5)):
        part = LocalSurface.of(standing(seed, yaw=yaw))
        tops.append(top_of(part, FLOOR, NOISE))
    for top in tops:
        np.testing.assert_allclose(top.sides, [0.28, 0.4], atol=0.02)
        assert top.height == pytest.approx(0.22, abs=0.01)
        assert top.equals(tops[0], NOISE)
    other = LocalSurface.of(standing(3, (0.4, 0.25, 0.22), yaw=1.0))
    assert not top_of(other, FLOOR, NOISE).equals(tops[0], NOISE)


def test_what_shows_its_sides_alone_has_no_top():
    part = LocalSurface.of(standing(0, faces=(0, 1, 3)))
    assert top_of(part, FLOOR, NOISE) is None
