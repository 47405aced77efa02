import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.coarse import coarse_transforms, normal_space_sample
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.geometry.rigid import transformed
from gmmjax.pair import Pair
from tests.changes.align.test_alignment import motion, room


@pytest.fixture(scope="module")
def rooms():
    return LocalSurface.of(room(0, points=3000)), room(1, extra=(1.3, 0.8), points=3000)


def left(transform, true, points):
    """Mean distance between where the points should be and where they are, and the angle in degrees."""
    total = transform @ true
    distance = np.linalg.norm(transformed(points, total) - points, axis=1).mean()
    return distance, np.degrees(Rotation.from_matrix(total[:3, :3]).magnitude())


@pytest.mark.parametrize(("shift", "degrees"), [((0.4, -0.3, 0.2), 25.0), ((0, 0, 0), 0.0), ((40.0, 7.0, -3.0), 10.0)])
def test_the_best_is_within_a_voxel_or_two_of_the_truth(rooms, shift, degrees):
    before, after = rooms
    true = motion(shift, degrees)
    found = coarse_transforms(Pair(before, LocalSurface.of(transformed(after, true))))
    distance, angle = left(found.transforms[0], true, after)
    assert distance < 2 * found.accuracy and angle < 8
    assert found.accuracy < 0.15


def test_any_unit_will_do(rooms):
    before, after = rooms
    true = motion((0.3, 0.1, -0.2), 20.0)
    moved = transformed(after, true)
    metres = coarse_transforms(Pair(before, LocalSurface.of(moved)))
    millimetres = coarse_transforms(Pair(LocalSurface.of(1000 * before.points), LocalSurface.of(1000 * moved)))
    assert millimetres.accuracy == pytest.approx(1000 * metres.accuracy)
    for one, other in zip(metres.transforms, millimetres.transforms, strict=True):
        np.testing.assert_allclose(one[:3, :3], other[:3, :3], atol=1e-9)
        np.testing.assert_allclose(1000 * one[:3, 3], other[:3, 3], atol=1e-6)


def test_six_rigid_transforms_are_found(rooms):
    found = coarse_transforms(Pair(rooms[0], LocalSurface.of(rooms[1])))
    assert len(found.transforms) == 6
    for transform in found.transforms:
        np.testing.assert_allclose(transform[:3, :3] @ transform[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(transform[:3, :3]) > 0


def test_points_are_drawn_evenly_over_the_directions():
    """Of a floor with a small box on it, a fair part is of the box."""
    random = np.random.default_rng(0)
    floor = np.column_stack([random.uniform(0, 2, (9000, 2)), 0.002 * random.standard_normal(9000)])
    side = np.column_stack([0.001 * random.standard_normal(300), random.uniform(0, 0.3, (300, 2))]) + np.array(
        [1, 1, 0.02]
    )
    surface = LocalSurface.of(np.concatenate([floor, side]))
    chosen = normal_space_sample(surface, 300)
    assert len(np.unique(chosen)) == 300
    assert (chosen >= 9000).mean() > 5 * 300 / 9300


def test_a_small_cloud_is_taken_whole():
    surface = LocalSurface.of(np.random.default_rng(0).normal(size=(40, 3)))
    assert sorted(normal_space_sample(surface, 300)) == list(range(40))
