import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.alignment import aligned
from gmmjax.errors import InputWarning
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
    with pytest.warns(InputWarning, match="lie apart nearly everywhere"):
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


@pytest.mark.slow
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


def ground(seed, mounds, points=837, noise=0.05):
    """Sparse airborne ground of 35 by 42 m, in a national grid."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(0, 35, points), random.uniform(0, 42, points)
    heights = sum(h * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * w * w)) for a, b, h, w in mounds)
    return np.column_stack([x, y, heights + random.normal(0, noise, points)]) + np.array([194470, 259220, 425])


def reshaped_ground(seed, count=9, **options):
    """Mounds, and the same after each was pushed by some metres and reshaped."""
    random = np.random.default_rng(seed)
    before = [(*random.uniform(3, (32, 39)), random.uniform(1.5, 4), random.uniform(2, 3.5)) for _ in range(count)]
    after = [(*np.add((a, b), random.normal(0, 1.5, 2)), h * random.uniform(0.7, 1.3), w) for a, b, h, w in before]
    return ground(2 * seed, before, **options), ground(2 * seed + 1, after, **options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the after scan was kept", "ignore:the scans lie apart")
@pytest.mark.parametrize("one_system", [False, True])
@pytest.mark.parametrize("seed", [301, 304, 308, 315])
def test_reshaped_ground_stays_where_it_is(seed, one_system):
    """Another alignment that fits some of the mounds better does not fit the others."""
    result = aligned(Pair(*reshaped_ground(seed)), one_system=one_system).registration
    assert not result.applied
    assert result.confidence > 0.7 or not one_system


@pytest.mark.filterwarnings("ignore:the after scan was kept", "ignore:the scans lie apart")
@pytest.mark.parametrize(("points", "noise", "count"), [(400, 0.02, 4), (3000, 0.02, 4), (3000, 0.1, 9)])
def test_ground_of_any_density_stays_where_it_is(points, noise, count):
    result = registered(*reshaped_ground(1000 + points, count, points=points, noise=noise))
    assert not result.applied and result.residual == result.residual_before


@pytest.mark.slow
def test_in_one_reference_system_a_far_displacement_is_told_but_not_taken_back():
    before, after = room(0), room(1) + np.array([0.3, 0.1, 0])
    with pytest.warns(InputWarning, match=r"both files state one reference system.*--registration always"):
        kept = aligned(Pair(before, after), one_system=True).registration
    assert not kept.applied and kept.confidence < 0.1
    moved = aligned(Pair(before, after), "always", one_system=True).registration
    assert moved.applied and moved.displacement == pytest.approx(np.hypot(0.3, 0.1), abs=0.01)


def test_in_one_reference_system_a_fine_correction_is_made():
    with pytest.warns(InputWarning, match=r"was moved by -0.0.*although both files state one reference system"):
        result = aligned(Pair(room(0), room(1) + np.array([0.01, 0.0, 0.01])), one_system=True).registration
    assert result.applied and result.displacement == pytest.approx(np.sqrt(2) * 0.01, abs=0.003)
    assert result.confidence == 1


def trees(seed, shift=0.0):
    """Crowns of 3 m, which fill volumes, over ground of 30 m; other points of the same trees for each seed."""
    random, places = np.random.default_rng(seed), np.random.default_rng(9)
    crowns = []
    for x, y in places.uniform(0, 30, (20, 2)):
        inside = random.normal(size=(120, 3))
        inside *= random.random((120, 1)) ** 0.25 / np.linalg.norm(inside, axis=1, keepdims=True)
        crowns.append(inside * [2, 2, 4] + [x, y, 9])
    floor = np.column_stack([random.uniform(0, 30, (1000, 2)), random.normal(0, 0.05, 1000)])
    return np.concatenate([*crowns, floor]) + np.array([shift, 0, 0])


def of_itself():
    random = np.random.default_rng(0)
    sphere = random.normal(size=(2000, 3))
    flat = np.column_stack([random.uniform(0, 2, (1000, 2)), np.zeros(1000)])
    return {
        "room": room(0, points=2000),
        "plane": flat + 0.003 * random.normal(size=(1000, 1)) * [0, 0, 1],
        "flat": flat,
        "lattice": np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0), [0.0]), axis=-1).reshape(-1, 3),
        "sphere": sphere / np.linalg.norm(sphere, axis=1, keepdims=True),
        "twice each": np.repeat(room(0, points=500), 2, axis=0),
        "tiny": random.normal(size=(15, 3)),
        "volume": random.normal(size=(1200, 3)),
        "trees": trees(0),
    }


@pytest.mark.slow
@pytest.mark.parametrize("kind", of_itself())
def test_a_cloud_with_itself_is_certain(kind):
    cloud = of_itself()[kind]
    result = registered(cloud, cloud.copy())
    assert not result.applied and result.confidence == 1


def test_another_survey_of_trees_is_certain_and_a_displaced_one_is_in_doubt():
    """Hardly any of their components agree, but points of both surveys are mixed everywhere."""
    same, displaced = registered(trees(0), trees(1)), registered(trees(0), trees(1, shift=1.5))
    assert not same.applied and same.confidence == 1 and same.overlap > 0.9
    assert displaced.confidence < 0.5


@pytest.mark.parametrize(("mode", "one_system"), [("never", False), ("never", True)])
def test_settlement_of_everything_is_not_silent(mode, one_system):
    """By 0.3 m, of ground with points a metre apart: within the level of detection, which it raises itself."""
    scans = [np.random.default_rng(seed).uniform([0, 0, 0], [60, 60, 0], (3600, 3)) for seed in (0, 1)]
    for own in scans:
        own[:, 2] = 3 * np.sin(own[:, 0] / 14) + 2.5 * np.cos(own[:, 1] / 17)
    pair = Pair(scans[0], scans[1] - np.array([0, 0, 0.3]))
    with pytest.warns(InputWarning, match="lie apart nearly everywhere.*reported as no change"):
        found = aligned(pair, mode, one_system=one_system)
    assert found.remarked and not found.registration.applied
    with pytest.warns(InputWarning, match="settlement, is in it and is no change.*--registration never"):
        assert aligned(pair, one_system=True).registration.applied
