import jax
import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes.prepare.resolution import ResolutionSettings, common_voxel_size, working_pair
from gmmjax.pair import Pair
from gmmjax.scenes import random_scene

MAX_VOXELS = ResolutionSettings().voxels


def planes(seed, noise, size=2.0, count=8000):
    """A floor and a wall."""
    random = np.random.default_rng(seed)
    u, v = random.uniform(0, size, (2, count))
    flat = noise * random.standard_normal(count)
    return np.concatenate([np.stack([u, v, flat], axis=1), np.stack([u, flat, v], axis=1)])


@pytest.mark.parametrize("points", [60, 200, 1000])
@pytest.mark.parametrize("overlap", ["low", "medium"])
def test_gaussians_fill_volumes(points, overlap):
    scene = random_scene(jax.random.key(points), appeared=1, overlap=overlap, points=points)
    assert working_pair(Pair(scene.before, scene.after)).volumetric


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_scans_lie_on_surfaces_in_any_unit(noise, unit):
    pair = working_pair(Pair(unit * planes(0, noise), unit * planes(1, noise)))
    assert not pair.volumetric
    # 8,000 points on 4 square metres, at random.
    assert 0.005 * unit < pair.spacing < 0.03 * unit


def test_a_wall_whose_noise_is_larger_than_its_spacing_is_a_surface():
    """As a depth camera sees it that stands close by."""
    walls = [planes(seed, 0.01, size=0.7, count=15_000) for seed in (4, 5)]
    pair = working_pair(Pair(*walls))
    assert pair.spacing < 0.01
    assert not pair.volumetric


def test_a_map_of_a_hall_is_a_surface_too():
    assert not working_pair(Pair(planes(2, 0.02, size=30.0), planes(3, 0.02, size=30.0))).volumetric


FEW_VOXELS = ResolutionSettings(voxels=3000)


def test_a_site_whose_voxels_are_as_large_as_what_stands_in_it_is_a_surface():
    """As many rooms together are: small boards in all directions, everywhere."""

    def boards(seed):
        random = np.random.default_rng(seed)
        middles, turns = random.uniform(0, 10, (2000, 1, 3)), np.linalg.qr(random.standard_normal((2000, 3, 3)))[0]
        flat = random.uniform(-0.1, 0.1, (2000, 40, 3)) * [1, 1, 0.01]
        return (middles + flat @ turns).reshape(-1, 3)

    pair = working_pair(Pair(boards(0), boards(1)), settings=FEW_VOXELS)
    assert pair.voxel_size > 0.2 and not pair.volumetric


def test_volumes_of_many_points_fill_volumes():
    scene = random_scene(jax.random.key(0), appeared=1, points=3000)
    pair = working_pair(Pair(scene.before, scene.after), settings=FEW_VOXELS)
    assert pair.voxel_size is not None and pair.volumetric


def test_large_clouds_are_reduced_to_one_size_of_voxels():
    before, after = planes(4, 0.002, count=MAX_VOXELS), planes(5, 0.002, count=1000)
    pair = working_pair(Pair(before, after))
    assert pair.voxel_size is not None and pair.voxel_size == common_voxel_size(Pair(before, after), MAX_VOXELS)
    assert len(pair.clouds.before.points) <= MAX_VOXELS
    assert pair.clouds.before.mass.sum() == len(before) and len(pair.clouds.before.member) == len(before)
    # A point is in the voxel that it counts for.
    distance = np.linalg.norm(pair.clouds.before.points[pair.clouds.before.member] - before, axis=1)
    assert distance.max() < pair.voxel_size * 3**0.5


def test_small_clouds_are_taken_as_they_are():
    before = planes(6, 0.01, count=100)
    pair = working_pair(Pair(before, before))
    assert pair.voxel_size is None
    np.testing.assert_array_equal(pair.clouds.before.points, before)


def test_equal_points_are_one_working_point():
    points = np.repeat(planes(6, 0.01, count=100), 3, axis=0)
    pair = working_pair(Pair(points, points))
    np.testing.assert_array_equal(pair.clouds.after.points, points[::3])
    np.testing.assert_array_equal(pair.clouds.after.mass, np.full(200, 3.0))
    np.testing.assert_array_equal(pair.clouds.after.points[pair.clouds.after.member], points)
    assert pair.spacing > 0


@pytest.mark.parametrize("count", [1000, MAX_VOXELS + 1000])
def test_a_cloud_within_the_spacing_of_the_other_cannot_be_compared(count):
    before, after = planes(6, 0.01, count=count), 1000 * planes(7, 0.01, count=500)
    with pytest.raises(InputError, match="nothing can be compared"):
        working_pair(Pair(before, after))
    with pytest.raises(InputError, match="nothing can be compared"):
        working_pair(Pair(after, before))
