import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.alignment import aligned
from gmmjax.pair import Pair
from gmmjax.scenes import random_scene
from tests.clouds.scanned_room import STATIONS, scan


def room(seed, extra=None, points=5000):
    """Floor and two walls of 2 m with a box on the floor, 5 mm of noise; `extra` is the corner of one more box."""
    random = np.random.default_rng(seed)
    u, v = random.uniform(0, 2, (2, points))
    zero = np.zeros(points)
    parts = [np.stack([u, v, zero], 1), np.stack([u, zero, v], 1), np.stack([zero, u, v], 1)]
    for corner in [(0.5, 1.2), *([extra] if extra else [])]:
        a, b = random.uniform(0, 0.3, (2, points // 20))
        side = np.full(len(a), 0.3)
        parts += [
            np.stack(faces, axis=1) + np.array([*corner, 0]) for faces in ((a, b, side), (a, 0 * a, b), (0 * a, a, b))
        ]
    cloud = np.concatenate(parts)
    return cloud + 0.005 * random.standard_normal(cloud.shape)


def motion(shift, degrees):
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, 0, 0.8])).as_matrix()
    transform[:3, 3] = shift
    return transform


def error_of(transform, true, points):
    """Greatest distance between where a point should be and where it is."""
    total = transform @ true
    return np.linalg.norm(points @ total[:3, :3].T + total[:3, 3] - points, axis=1).max()


def registered(before, after, mode="auto"):
    return aligned(Pair(before, after), mode).registration


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_recovers_a_motion_although_something_changed(scale):
    before, after = room(0), room(1, extra=(1.3, 0.8))
    true = motion([0.015, -0.01, 0.012], 0.5)
    moved = after @ true[:3, :3].T + true[:3, 3]
    true[:3, 3] *= scale
    result = registered(scale * before, scale * moved)
    assert result.applied
    assert error_of(result.transform, true, scale * after) < 0.004 * scale
    assert result.residual < 0.7 * result.residual_before
    assert result.overlap > 0.9


def test_leaves_aligned_clouds_alone():
    result = registered(room(2), room(3))
    assert not result.applied and (result.transform == np.eye(4)).all()


def test_never_leaves_misaligned_clouds_alone():
    result = registered(room(2), room(3) + 0.02, "never")
    assert not result.applied and result.residual == result.residual_before > 0.008


@pytest.mark.slow
@pytest.mark.parametrize("shift", [0.05, 0.3])
def test_a_shift_that_only_the_ends_of_a_room_show_is_taken_back(shift):
    """Their share of the points is too small for the median offset to show it."""
    sides = [STATIONS, STATIONS + np.array([[0.7, -0.4, 0.1], [-0.5, 0.6, 0.0]])]
    before, after = (
        np.concatenate([scan(own, 20_000, seed=10 * number + i) for i, own in enumerate(side)])
        for number, side in enumerate(sides)
    )
    true = motion([shift, 0, 0], 0)
    result = registered(before, after + true[:3, 3])
    assert result.applied and result.residual > 0.9 * result.residual_before
    assert error_of(result.transform, true, after) < 0.005
    assert not registered(before, after).applied


def test_does_not_slide_along_a_wall():
    """One plane says nothing of motions within it."""
    random = np.random.default_rng(4)
    before, after = (
        np.concatenate([random.uniform(0, 2, (6000, 2)), 0.003 * random.standard_normal((6000, 1))], axis=1)
        for _ in range(2)
    )
    after[:, 2] += 0.03
    result = registered(before, after)
    assert result.applied
    assert result.transform[2, 3] == pytest.approx(-0.03, abs=0.003)
    assert np.abs(result.transform[:2, 3]).max() < 0.01


def test_says_how_little_the_clouds_overlap():
    result = registered(room(5), room(6) + np.array([1.5, 0.3, 0]), "never")
    assert result.overlap < 0.5


def test_a_far_displacement_is_found():
    result = registered(room(5), room(6) + np.array([3.0, -1.0, 0.5]))
    assert result.applied and result.overlap > 0.9
    assert error_of(result.transform, motion([3.0, -1.0, 0.5], 0), room(6)) < 0.01


def test_volumetric_clouds_are_aligned_by_their_components():
    """Nearest neighbours say little there; the Gaussians' means say it to millimetres."""
    scene = random_scene(jax.random.key(3), appeared=1, disappeared=1, points=400)
    shift = np.array([0.1, -0.15, 0.08])
    moved = registered(scene.before, scene.after + shift)
    assert moved.applied
    np.testing.assert_allclose(moved.transform[:3, 3], -shift, atol=0.04)
    same = registered(scene.before, scene.after)
    assert not same.applied and same.residual == 0


@pytest.mark.parametrize("seed", range(4))
def test_large_displacements_are_taken_back(seed):
    random = np.random.default_rng(seed)
    before, after = room(10), room(11, extra=(1.3, 0.8))
    true = np.eye(4)
    true[:3, :3] = Rotation.from_rotvec(np.radians(28) * direction(random)).as_matrix()
    true[:3, 3] = random.uniform(0.2, 0.5) * direction(random)
    result = registered(before, after @ true[:3, :3].T + true[:3, 3])
    assert result.applied and result.confidence > 0.97
    assert error_of(result.transform, true, after) < 0.006
    assert result.displacement == pytest.approx(
        np.linalg.norm((true @ [*after.mean(axis=0), 1])[:3] - after.mean(axis=0)), abs=0.01
    )


def direction(random):
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


@pytest.mark.slow
def test_the_voxels_are_those_of_the_common_frame():
    """What is found does not depend on the frame that the after cloud was given in."""
    before, after = room(12, points=18000), room(13, extra=(1.3, 0.8), points=18000)
    true = motion([0.2, 0.1, -0.3], 17)
    given = aligned(Pair(before, after), "always")
    displaced = aligned(Pair(before, after @ true[:3, :3].T + true[:3, 3]))
    assert given.working.voxel_size is not None
    assert displaced.working.voxel_size == pytest.approx(given.working.voxel_size, rel=0.01)
    distances = given.surfaces.after.tree.query(displaced.surfaces.after.points)[0]
    # Voxels in another frame lie a third of the spacing apart in the median.
    assert np.median(distances) < 0.15 * given.working.spacing


def test_clouds_of_two_places_are_in_doubt():
    random = np.random.default_rng(0)
    ball = random.normal(size=(8000, 3))
    ball *= (0.8 + 0.004 * random.standard_normal((8000, 1))) / np.linalg.norm(ball, axis=1, keepdims=True)
    result = registered(room(14), ball + np.array([5, 0, 0]))
    assert result.confidence < 0.5


def test_volumetric_clouds_that_were_rotated_are_in_doubt():
    """Their components agree on no displacement."""
    scene = random_scene(jax.random.key(3), appeared=1, disappeared=1, points=400)
    rotated = scene.after @ motion([0, 0, 0], 20)[:3, :3].T
    result = registered(scene.before, rotated)
    assert not result.applied and result.confidence < 0.1
    assert registered(scene.before, scene.after).confidence > 0.9
