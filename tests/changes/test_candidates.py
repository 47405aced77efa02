import tracemalloc

import numpy as np
import pytest

from gmmjax.changes.candidates import (
    CandidateSettings,
    candidates_of,
    clusters_with_core,
    mean_probability,
    probability_by_difference,
)
from gmmjax.changes.differences import DetectionLimits, Differences, DifferenceSettings, LocalDifference
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.clouds import SensorViews
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

SPACING = 0.01
LIMITS = DetectionLimits(SPACING, 0.1 / 3, 0.02 / 7, distance=0.1, offset=0.02, settings=DifferenceSettings())


def difference(distance=0.0, offset=0.0, noise=0.0, thickness=0.0, spacing=0.0, point_offset=0.0, point_noise=0.0):
    """Local differences of some points; where one number is given all points have it."""
    values = distance, offset, noise, thickness, spacing, point_offset, point_noise
    return LocalDifference(*np.atleast_1d(*np.broadcast_arrays(*values)))


def blob(centre, count, seed=0):
    """Points about a centre, all within two spacings of it along each axis."""
    return np.array(centre) + np.random.default_rng(seed).uniform(-2 * SPACING, 2 * SPACING, (count, 3))


def by_restart(values):
    """Values [r, n] of all restarts."""
    return RestartValues(len(values), lambda restart, rows: values[restart][rows])


def test_the_probability_rises_with_the_distance_from_a_fraction_of_its_limit():
    probability = probability_by_difference(difference([0.0, 0.03, 0.065, 0.1, 0.5]), LIMITS)
    np.testing.assert_allclose(probability, [0, 0, 0.5, 1, 1], atol=1e-12)


def test_a_point_alone_counts_from_the_offset_that_is_sure_by_its_own_noise():
    # A mean of eight has a noise that is the root of eight smaller.
    probability = probability_by_difference(difference(point_offset=np.array([0.01, 0.02, 0.1]) * np.sqrt(8)), LIMITS)
    np.testing.assert_allclose(probability, [0, 1, 1])
    rough = probability_by_difference(difference(point_offset=0.1, point_noise=0.1), LIMITS)
    np.testing.assert_allclose(rough, 0)


def test_the_probability_rises_with_the_offset_up_to_its_limit():
    probability = probability_by_difference(difference(offset=[0.0, 0.005, 0.02, 0.1]), LIMITS)
    np.testing.assert_allclose(probability, [0, 0.25, 1, 1])


def test_where_the_other_cloud_is_noisy_sparse_or_thick_limits_are_larger():
    usual = difference(distance=0.1, offset=0.02)
    assert probability_by_difference(usual, LIMITS) == 1
    for local in (
        difference(distance=0.1, offset=0.02, noise=0.01, spacing=0.1),
        difference(distance=0.1, offset=0.02, noise=0.01, thickness=0.1),
    ):
        assert probability_by_difference(local, LIMITS) < 0.5


def test_the_greatest_of_mixture_distance_and_offset_counts_in_each_restart():
    by_difference = probability_by_difference(difference(distance=[0.065, 0, 0], offset=[0, 0.005, 0]), LIMITS)
    excess = np.array([[0.1, 0.1, 0.7], [0.9, 0.2, 0.0]])
    expected = np.mean([[0.5, 0.25, 0.7], [0.9, 0.25, 0.0]], axis=0)
    np.testing.assert_allclose(mean_probability(by_restart(excess), by_difference), expected, atol=1e-12)


def test_the_memory_of_the_mean_does_not_grow_with_the_restarts():
    """Beyond the values of a few restarts, however many there are."""
    points = 100_000

    def peak(restarts):
        values = RestartValues(restarts, lambda restart, rows: np.full(points, restart / restarts))
        tracemalloc.start()
        mean_probability(values, np.zeros(points))
        memory = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return memory

    assert peak(64) < 1.1 * peak(4) and peak(64) < 5 * 8 * points


@pytest.fixture
def cloud():
    """Two groups of sure points, one with less sure points beside it, and points that are hardly changed or single."""
    points = np.concatenate(
        [blob((0, 0, 0), 40), blob((1, 0, 0), 30, 1), blob((0.05, 0, 0), 25, 2), blob((2, 0, 0), 30, 3), [[9, 9, 9.0]]]
    )
    return points, np.repeat([1.0, 0.95, 0.6, 0.4, 1.0], [40, 30, 25, 30, 1])


def test_candidates_are_dense_groups_of_sure_points_and_what_adjoins_them(cloud):
    labels = clusters_with_core(*cloud, SPACING)
    np.testing.assert_array_equal(labels, np.repeat([0, 1, 0, -1, -1], [40, 30, 25, 30, 1]))


def test_a_group_without_enough_sure_points_is_no_candidate(cloud):
    labels = clusters_with_core(*cloud, SPACING, settings=CandidateSettings(smallest_core=35))
    assert (labels[:40] == 0).all() and (labels[40:70] == -1).all()
    assert (clusters_with_core(*cloud, SPACING, settings=CandidateSettings(core_probability=1.1)) == -1).all()


def test_how_far_a_candidate_grows_is_a_setting(cloud):
    points, probability = cloud
    labels = clusters_with_core(points, probability, SPACING, settings=CandidateSettings(growth=0.1))
    assert (labels[:40] == 0).all() and (labels[70:95] == -1).any()


def test_a_group_of_outliers_is_no_candidate_and_one_with_some_of_them_is_whole(cloud):
    outliers = np.zeros(len(cloud[0]), bool)
    outliers[:35], outliers[40:69] = True, True
    labels = clusters_with_core(*cloud, SPACING, outliers=outliers)
    np.testing.assert_array_equal(labels, np.repeat([0, -1, 0, -1, -1], [40, 30, 25, 30, 1]))
    off = clusters_with_core(*cloud, SPACING, settings=CandidateSettings(outliers=1.0), outliers=outliers)
    np.testing.assert_array_equal(off, clusters_with_core(*cloud, SPACING))


def test_no_points_have_no_candidates():
    assert clusters_with_core(np.zeros((0, 3)), np.zeros(0), SPACING).shape == (0,)


def test_a_threshold_above_the_core_is_that_of_the_core(cloud):
    labels = clusters_with_core(*cloud, SPACING, 0.97)
    np.testing.assert_array_equal(labels >= 0, np.repeat([True, False], [40, 86]))


def test_both_clouds_have_candidates_of_their_own_by_the_mean_of_the_restarts():
    points = Pair(blob((0, 0, 0), 30), blob((0, 0, 0), 50, 1))
    local = points.map(lambda own: difference(np.zeros(len(own))))
    # In one of two restarts all points of the before cloud are changed: its mean is the threshold, not sure.
    excess = Pair(np.stack([np.ones(30), np.zeros(30)]), np.ones((2, 50)))
    found = candidates_of(points, Differences(local, LIMITS), excess.map(by_restart))
    assert (found.before.labels == -1).all() and (found.after.labels == 0).all()
    np.testing.assert_array_equal(found.before.looks_changed, 0.5)
    assert found.after.points is points.after and found.after.difference is local.after


def test_flying_pixels_before_a_wall_are_no_candidate_and_a_small_object_is():
    """Single points in the air, near enough to each other and to the wall for clusters."""
    steps = np.arange(60) * SPACING
    wall = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
    flying = np.random.default_rng(0).uniform((0, 0, 0.05), (0.3, 0.3, 0.15), (160, 3))
    item = blob((0.3, 0.3, 0.3), 14)
    points, parts = np.concatenate([wall, item, flying]), [len(wall), len(item), len(flying)]
    local, excess = difference(np.repeat([0.0, 1.0, 1.0], parts)), by_restart(np.zeros((1, len(points))))
    differences, sizes = Differences(Pair(local, local), LIMITS), np.full(len(points), SPACING)

    def labels(outliers):
        both = Pair(points, points), differences, Pair(excess, excess)
        found = candidates_of(*both, sizes=Pair(sizes, sizes), outliers=Pair(outliers, outliers))
        return np.split(found.before.labels, np.cumsum(parts)[:2])[1:]

    assert (labels(None)[1] >= 0).mean() > 0.9
    scanner = np.eye(4)[None]
    scanner[0, :3, 3] = 0.3, 0.3, 2.0
    of_item, of_flying = labels(ScanVisibility.of(points, SensorViews(scanner, (360.0, 170.0), 10.0)).outliers)
    assert (of_item >= 0).all() and (of_flying == -1).all()


@pytest.mark.parametrize(("apart", "found"), [(1, True), (4, True), (20, False)])
def test_what_stands_where_a_scan_is_sparse_is_one_candidate(apart, found):
    """A board whose points are some spacings of the pair apart: far from the scanner, or alone in the air."""
    steps = np.arange(7) * apart * SPACING
    board = np.stack(np.meshgrid(steps, [0.0], steps), axis=-1).reshape(-1, 3)
    points, local = Pair(board, blob((0, 0, 0), 50)), Pair(difference(np.ones(49)), difference(np.zeros(50)))
    excess = points.map(lambda own: by_restart(np.zeros((1, len(own)))))
    spacings = points.map(lambda own: LocalSurface.of(own).spacing(np.arange(len(own))))
    candidates = candidates_of(points, Differences(local, LIMITS), excess, spacings=spacings)
    np.testing.assert_array_equal(candidates.before.labels, 0 if found else -1)
    # By the spacing of the pair alone it is none.
    by_pair = candidates_of(points, Differences(local, LIMITS), excess)
    off = candidates_of(
        points, Differences(local, LIMITS), excess, settings=CandidateSettings(sparse_radius=0.0), spacings=spacings
    )
    for other in (by_pair, off):
        np.testing.assert_array_equal(other.before.labels, 0 if apart == 1 else -1)


def test_where_voxels_are_local_what_the_other_survey_saw_through_is_a_candidate():
    points, sizes = Pair(blob((0, 0, 0), 30), blob((0, 0, 0), 50, 1)), Pair(np.full(30, SPACING), np.full(50, SPACING))
    local = points.map(lambda own: difference(np.zeros(len(own))))
    excess = points.map(lambda own: by_restart(np.zeros((1, len(own)))))
    # The before cloud is a dozen points before a wall that the other survey sees behind them.
    observed = Pair(np.where(np.arange(30) < 12, 1, 0).astype(np.int8), np.zeros(50, np.int8))
    found = candidates_of(points, Differences(local, LIMITS), excess, observed, sizes=sizes)
    np.testing.assert_array_equal(found.before.labels, np.where(np.arange(30) < 12, 0, -1))
    assert (found.after.labels == -1).all()
    unknown = candidates_of(points, Differences(local, LIMITS), excess, sizes=sizes)
    assert (unknown.before.labels == -1).all()
