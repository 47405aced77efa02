import numpy as np
import pytest

from gmmjax.changes.differences import (
    DifferenceSettings,
    LocalDifference,
    detection_limits,
    differences_between,
    local_difference,
)
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.pair import Pair
from tests.mixtures.examples import random_rotation

# Of 4000 points on a square metre, to their nearest neighbours.
SPACING = 0.008


def floor(seed, count=4000, noise=0.005, height=0.0):
    random = np.random.default_rng(seed)
    return np.column_stack([random.uniform(0, 1, (count, 2)), height + noise * random.standard_normal(count)])


def difference(points, other):
    return local_difference(LocalSurface.of(points), LocalSurface.of(other))


def test_averages_see_an_offset_below_the_noise():
    same, raised = difference(floor(0), floor(1)), difference(floor(0), floor(1, height=0.01))
    assert np.median(raised.offset) == pytest.approx(0.01, abs=0.001)
    assert np.median(same.offset) < 0.002
    # Single points do not: their scatter is of the size of the offset.
    assert np.median(raised.distance) < 1.5 * np.median(same.distance)


def test_the_registration_error_is_the_noise_of_the_means():
    local = Pair(difference(floor(2), floor(3)), difference(floor(3), floor(2)))
    limits = detection_limits(local, SPACING)
    expected = 0.005 * np.sqrt(1 / 8 + 1 / 16)
    assert limits.registration_error == pytest.approx(expected, rel=0.25)
    assert np.median(local.before.noise) == pytest.approx(expected, rel=0.25)


def test_the_less_changed_cloud_sets_the_limits():
    random = np.random.default_rng(4)
    crowded = np.concatenate([floor(5), random.uniform(0, 1, (6000, 3)) + np.array([0, 0, 0.5])])
    limits = detection_limits(Pair(difference(floor(6), crowded), difference(crowded, floor(6))), SPACING)
    assert limits.registration_error < 0.004


def test_unchanged_points_are_within_the_limits_and_a_raised_floor_is_not():
    points = Pair(floor(12), np.concatenate([floor(13), floor(14, count=400, height=0.2)]))
    found = differences_between(points.map(LocalSurface.of), SPACING)
    own, limits = found.local.after, found.limits
    beyond = (own.distance > limits.local_distance(own)) & (own.offset > limits.local_offset(own))
    assert beyond[-400:].all() and not beyond[:-400].any()
    # A larger limit for all, in the unit of the clouds.
    assert detection_limits(found.local, 0.1, DifferenceSettings(spacings=4.0)).distance == pytest.approx(0.4)


def test_limits_are_larger_where_the_other_cloud_is_sparser_thicker_or_noisier():
    limits = detection_limits(Pair(difference(floor(2), floor(3)), difference(floor(3), floor(2))), SPACING)
    local = LocalDifference(
        *np.zeros((2, 4)),
        noise=np.array([0.0, 0.01, 0.0, 0.0]),
        thickness=np.array([0.0, 0.0, 0.1, 0.0]),
        spacing=np.array([0.0, 0.0, 0.0, 0.2]),
        point_offset=np.zeros(4),
        point_noise=np.zeros(4),
    )
    np.testing.assert_allclose(limits.local_distance(local), [limits.distance, limits.distance, 4 * 0.1, 3 * 0.2])
    np.testing.assert_allclose(limits.local_offset(local), [limits.offset, 7 * 0.01, limits.offset, limits.offset])


def test_thickness_and_spacing_are_those_of_the_other_cloud():
    found = difference(floor(7, noise=0.001), floor(8, noise=0.005, count=10_000))
    assert np.median(found.thickness) == pytest.approx(0.005, rel=0.3)
    # 10,000 points on a square metre are 1 cm apart on a grid.
    assert 0.006 < np.median(found.spacing) < 0.0125


def test_a_pipe_on_a_floor_is_told_by_its_own_points():
    """It is one point wide, so that every local mean is of pipe and floor."""
    pipe = np.column_stack([np.linspace(0.1, 0.9, 25), np.full(25, 0.5), np.full(25, 0.013)])
    points = Pair(floor(20, noise=0.001), np.concatenate([floor(21, noise=0.001), pipe]))
    found = differences_between(points.map(LocalSurface.of), SPACING)
    own, limits = found.local.after, found.limits
    of_means, relative = own.offset / limits.local_offset(own), limits.relative_offset(own)
    assert np.median(of_means[-25:]) < 0.7
    assert (relative[-25:] > 1).mean() > 0.9 and (relative[:-25] > 1).mean() < 0.01


def test_what_lies_beside_a_surface_is_not_off_it():
    """The plane of a shelf's edge says nothing about a post that stands in front of it."""
    post = np.column_stack([np.full(100, 1.1), np.full(100, 0.5), np.linspace(0.02, 0.1, 100)])
    assert not difference(np.concatenate([floor(22), post]), floor(23)).point_offset[-100:].any()


def test_offsets_from_what_is_no_surface_are_uncertain():
    """In clutter a plane may be turned by any angle, though the mean of its points is known well."""
    random = np.random.default_rng(0)
    crowd = [random.uniform(0, 1, (4000, 3)) for _ in range(2)]
    found = difference(*crowd)
    of_means = found.thickness * np.sqrt(1 / 8 + 1 / 16)
    assert np.median(found.noise / of_means) > 1.3
    flat = difference(floor(24), floor(25))
    assert np.median(flat.noise / (flat.thickness * np.sqrt(1 / 8 + 1 / 16))) < 1.2


def rough_ground(seed, count):
    """Bumps of half a metre, on ten metres, without noise."""
    places = np.random.default_rng(seed).uniform(0, 10, (count, 2))
    waves = np.random.default_rng(0).normal(0, 2 * np.pi / 0.7, (2, 40))
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 40)
    return np.column_stack([places, 0.01 * np.cos(places @ waves + phases).sum(axis=1)])


def test_relief_that_the_other_cloud_is_too_sparse_to_show_is_noise():
    """A bump between two points of the sparse cloud is off its plane everywhere, and nothing has changed."""
    dense, sparse = rough_ground(2, 40_000), rough_ground(3, 300)
    inside = (np.abs(dense[:, :2] - 5) < 4).all(axis=1)
    found = difference(dense, sparse)
    assert ((found.offset > 3 * found.noise)[inside]).mean() < 0.02
    # Where both are dense, bumps do not hide what is lower by as much.
    sunk = difference(dense, rough_ground(4, 40_000) - [0, 0, 0.06])
    assert ((sunk.offset > 3 * sunk.noise)[inside]).mean() > 0.95


def test_the_offset_of_a_point_counts_as_far_as_the_surface_lies_opposite():
    low, high = (np.array([[0.5, 0.5, height]]) for height in (0.01, 0.05))
    points, other = (LocalSurface.of(own) for own in (np.concatenate([floor(26), low, high]), floor(27)))
    assert local_difference(points, other).point_offset[-2:] == pytest.approx([0.01, 0], abs=0.005)
    settings = DifferenceSettings(opposite_height=10.0)
    assert local_difference(points, other, settings=settings).point_offset[-1] == pytest.approx(0.05, abs=0.005)


def test_offsets_from_rows_of_points_say_nothing():
    """Rows along the lines of a scanner, other ones each time: a plane through a row may stand upright."""
    random = np.random.default_rng(0)
    step, along = 0.06, np.tile(0.006 * np.arange(250), 20)
    rows = [np.column_stack([along, np.repeat(step * (np.arange(20) + shift), 250), 0 * along]) for shift in (0, 0.2)]
    rows = [own + random.normal(0, [0, 0, 0.002], own.shape) for own in rows]
    found = difference(*rows)
    assert np.median(found.offset) > 0.003
    assert np.isinf(found.noise).mean() > 0.9


def test_a_rigid_motion_changes_nothing():
    rotation, shift = random_rotation(), np.array([3.0, -2, 1])
    points, other = floor(9), floor(10)
    here, there = difference(points, other), difference(points @ rotation.T + shift, other @ rotation.T + shift)
    np.testing.assert_allclose(there.offset, here.offset, atol=1e-9)
    np.testing.assert_allclose(there.distance, here.distance, atol=1e-9)


def test_two_points_work():
    few = np.array([[0.0, 0, 0], [1, 0, 0]])
    found = difference(few, few)
    assert np.isfinite(found.distance).all() and np.isfinite(found.offset).all()
    # A line has no normal.
    assert np.isinf(found.noise).all()


def test_equal_planes_have_limits_that_can_be_divided_by():
    flat = LocalSurface.of(np.column_stack([np.random.default_rng(0).uniform(size=(300, 2)), np.zeros(300)]))
    local = Pair(local_difference(flat, flat), local_difference(flat, flat))
    limits = detection_limits(local, SPACING)
    spacing = np.median(local.before.spacing)
    assert limits.median_distance == 0 and 0 < limits.registration_error < 1e-5 * spacing + 1e-12


def test_a_change_that_fills_a_region_is_no_registration_error_of_dense_scans():
    """Where spacings differ from place to place, the error is the median of several regions."""
    random = np.random.default_rng(0)
    points = np.c_[random.uniform(0, 20, (20_000, 2)), random.normal(0, 0.002, 20_000)]
    # Within the limit of the pair, on more points than a region has.
    sunk = np.hypot(*(points[:, :2] - 10).T) < 2.2
    after = points + np.array([0.0, 0.0, 0.001]) + random.normal(0, 0.001, points.shape)
    after[sunk, 2] -= 0.012
    surfaces = Pair(points, after).map(LocalSurface.of)
    spacings = surfaces.map(lambda surface: surface.spacing(np.arange(len(surface))))
    own = differences_between(surfaces, 0.1, own_spacing=spacings)
    everywhere = differences_between(surfaces, 0.1)
    middle = np.hypot(*(points[:, :2] - 10).T) < 1
    usual = own.limits.registration_error
    assert np.median(own.local.before.error[middle]) < 1.3 * usual
    assert np.median(everywhere.local.before.error[middle]) > 1.5 * usual


def test_what_stands_on_a_floor_that_was_sampled_along_lines_is_off_it():
    """As by a scanner far away, where a line is farther from the next one than the thing is wide."""
    along, line = np.meshgrid(0.05 * np.arange(300), 0.6 * np.arange(15))
    random = np.random.default_rng(3)
    far = np.column_stack([along.ravel(), line.ravel(), 0.001 * random.standard_normal(along.size)])
    pallet = floor(9, 1500, 0.003, height=0.12) * [0.5, 0.5, 1] + [7, 4, 0]
    bare = floor(10, 1500, 0.003) * [0.5, 0.5, 1] + [7, 4, 0]
    on_it, without = difference(pallet, far), difference(bare, far)
    assert np.median(on_it.offset) == pytest.approx(0.12, abs=0.005)
    assert (on_it.offset > 7 * on_it.noise).all() and np.median(without.offset) < 0.003
    # By the distance alone nothing is there that the other survey could not have missed.
    assert (on_it.distance < 3 * on_it.spacing).all()
