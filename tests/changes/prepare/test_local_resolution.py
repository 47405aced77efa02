import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import example, given, settings

from gmmjax.changes.prepare.local_resolution import LocalResolutionSettings, locally_reduced
from gmmjax.pair import Pair

SIZE = 0.4


def floor(seed, count, lower, upper, noise=0.001):
    """Points at random on a level rectangle."""
    random = np.random.default_rng(seed)
    places = random.uniform(lower, upper, (count, 2))
    return np.column_stack([places, noise * random.standard_normal(count)])


def two_densities(seed):
    """A floor whose near half has sixteen times as many points as the far one."""
    return np.concatenate([floor(seed, 32_000, (0, 0), (4, 8)), floor(seed + 100, 2_000, (4, 0), (8, 8))])


@pytest.fixture(scope="module")
def pair():
    points = Pair(two_densities(0), two_densities(1))
    return points, locally_reduced(points, SIZE)


def sizes_at(clouds, least, most):
    """Of the voxels of both clouds in a strip."""
    return np.concatenate([own.sizes[(own.points[:, 0] > least) & (own.points[:, 0] < most)] for own in clouds])


def test_voxels_are_smaller_where_both_scans_are_denser(pair):
    _, clouds = pair
    near, far = sizes_at(clouds, 0.5, 3.5), sizes_at(clouds, 4.8, 7.5)
    assert np.median(near) <= np.median(far) / 2
    assert far.max() <= SIZE


def test_voxels_hold_every_point_once_and_stand_for_its_place(pair):
    points, clouds = pair
    for own, cloud in zip(points, clouds, strict=True):
        assert cloud.mass.sum() == len(own)
        np.testing.assert_array_equal(np.bincount(cloud.member), cloud.mass)
        away = np.abs(cloud.points[cloud.member] - own).max(axis=1)
        assert (away <= cloud.sizes[cloud.member] * (1 + 1e-9)).all()


def test_the_denser_scan_is_as_coarse_as_the_other_one_there():
    dense, sparse = floor(2, 40_000, (0, 0), (4, 4)), floor(3, 5_000, (0, 0), (4, 4))
    alone = locally_reduced(Pair(dense, floor(4, 40_000, (0, 0), (4, 4))), SIZE)
    beside = locally_reduced(Pair(dense, sparse), SIZE)
    assert np.median(beside.before.sizes) >= 2 * np.median(alone.before.sizes)


def test_a_stray_point_of_the_other_scan_costs_no_resolution():
    dense = floor(5, 40_000, (0, 0), (4, 4))
    stray = np.concatenate([floor(6, 40_000, (10, 0), (14, 4)), [[2.0, 2.0, 0.0]]])
    alone = locally_reduced(Pair(dense, stray), SIZE)
    assert np.median(alone.before.sizes) <= SIZE / 8


def test_scan_lines_with_gaps_between_them_are_no_surface():
    """Far from a scanner its points follow each other in lines that are much farther apart."""
    lines = np.stack(np.meshgrid(np.arange(0, 8, 0.005), np.arange(0, 8, 0.3), indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack([lines, np.zeros(len(lines))])
    clouds = locally_reduced(Pair(points, points + np.array([0.002, 0.1, 0.0])), SIZE)
    assert np.median(clouds.before.sizes) >= SIZE / 2


@given(st.floats(0.0, 1.0))
@settings(max_examples=10, deadline=None)
@example(0.5)
@example(0.25)
def test_the_height_of_a_floor_does_not_matter(height):
    """A floor that lies on a boundary of smaller voxels, which is none of the larger ones, is in two layers of them."""
    raised = [0.0, 0.0, height * SIZE]
    points = Pair(*(np.concatenate([floor(seed, 30_000, (0, 0), (4, 4)) + raised, [[0, 0, 0]]]) for seed in (9, 10)))
    clouds = locally_reduced(points, SIZE)
    assert max(np.median(own.sizes) for own in clouds) <= SIZE / 8


def test_voxels_are_not_smaller_than_the_noise():
    def size(noise):
        points = Pair(*(floor(seed, 60_000, (0, 0), (3, 3), noise) for seed in (7, 8)))
        return float(np.median(locally_reduced(points, 0.4).before.sizes))

    precise, noisy = size(1e-4), size(0.1)
    assert precise < 0.05 < noisy


def test_the_number_of_voxels_is_bounded(pair):
    points, clouds = pair
    bounded = locally_reduced(points, SIZE, LocalResolutionSettings(max_voxels=3_000))
    assert max(len(own.points) for own in bounded) <= 3_000 < len(clouds.before.points)
    assert bounded.before.mass.sum() == len(points.before)


def test_without_halvings_voxels_have_one_size(pair):
    points, _ = pair
    clouds = locally_reduced(points, SIZE, LocalResolutionSettings(halvings=0))
    assert set(clouds.before.sizes) | set(clouds.after.sizes) == {SIZE}


def test_survey_coordinates_lose_nothing(pair):
    points, clouds = pair
    offset = np.array([2.0**22, 2.0**22, 512.0])
    moved = locally_reduced(points.map(lambda own: own + offset), SIZE)
    assert len(moved.before.points) == pytest.approx(len(clouds.before.points), rel=0.02)
    away = np.abs(moved.before.points[moved.before.member] - (points.before + offset)).max(axis=1)
    assert (away <= moved.before.sizes[moved.before.member] * (1 + 1e-6)).all()


def test_a_point_far_away_is_no_reason_to_fail(pair):
    points, _ = pair
    clouds = locally_reduced(Pair(points.before, np.concatenate([points.after, [[1e5, 0.0, 0.0]]])), SIZE)
    assert clouds.after.mass.sum() == len(points.after) + 1


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_permuting_points_permutes_their_voxels(pair, seed):
    points, clouds = pair
    order = np.random.default_rng(seed).permutation(len(points.before))
    permuted = locally_reduced(Pair(points.before[order], points.after), SIZE).before
    np.testing.assert_array_equal(permuted.member, clouds.before.member[order])
    np.testing.assert_array_equal(permuted.sizes, clouds.before.sizes)
    np.testing.assert_allclose(permuted.points, clouds.before.points, atol=1e-12)
