import numpy as np
import pytest

from gmmjax.changes.objects.rigid_match import rigid_matches
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, motion, placed

NOISE = 0.003


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.2])
@pytest.mark.parametrize("faces", [(0, 1, 2, 3, 4), (0, 1, 2)])
def test_one_of_the_motions_lays_an_object_onto_itself(yaw, faces):
    extent = (0.4, 0.28, 0.22)
    true = motion(yaw, [0.8, -0.3, 0.1])
    objects = Pair(box(0, extent), placed(box(1, extent, faces), true)).map(LocalSurface.of)
    motions = rigid_matches(objects, NOISE, 6)
    assert len(motions) == 6
    corners = box(2, extent, noise=0)
    # A box is the same after half a turn about any of its axes: its points are compared, not the motions.
    turns = [np.diag(signs) for signs in ([1, 1, 1, 1], [-1, -1, 1, 1.0], [1, -1, -1, 1], [-1, 1, -1, 1])]
    errors = [
        np.linalg.norm(placed(corners, way) - placed(corners, true @ turn), axis=1).max()
        for way in motions
        for turn in turns
    ]
    assert min(errors) < 0.02


def test_motions_are_rigid():
    objects = Pair(box(0, (0.3, 0.2, 0.2)), box(1, (0.3, 0.3, 0.2)) + 1).map(LocalSurface.of)
    for way in rigid_matches(objects, NOISE, 3):
        np.testing.assert_allclose(way[:3, :3] @ way[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(way[:3, :3]) == pytest.approx(1)
        np.testing.assert_array_equal(way[3], [0, 0, 0, 1])
