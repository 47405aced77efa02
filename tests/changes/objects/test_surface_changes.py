import numpy as np
import pytest

from gmmjax.changes.differences import DetectionLimits, DifferenceSettings, LocalDifference
from gmmjax.changes.evidence.examination import Examined, Rejected
from gmmjax.changes.objects.surface_changes import SurfaceChangeSettings, calibrated, significance, surface_changes
from tests.changes.explained import explanation

LIMITS = DetectionLimits(
    spacing=0.01, median_distance=0.005, registration_error=0.001, distance=0.03, offset=0.007,
    settings=DifferenceSettings(),
)  # fmt: skip
# A hundred working points: an object of 60 points far from the other cloud, one of ten close to it, and the rest.
LABELS = np.repeat([0, 1, -1], [60, 10, 30])
DISTANCE = np.repeat([0.2, 0.004, 0.004], [60, 10, 30])
DIFFERENCE = LocalDifference(
    DISTANCE, np.full(100, 0.002), np.full(100, 0.001), np.full(100, 0.001), np.full(100, 0.01)
)
PROBABILITY = np.repeat([[0.9, 0.7, 0.6], [0.7, 0.7, 0.6]], [60, 10, 30], axis=1)
EXAMINED = Examined(LABELS, PROBABILITY, np.zeros(100, bool))
# Two points of the cloud for each working point.
POINTS, MEMBER = np.random.default_rng(0).normal(size=(200, 3)), np.repeat(np.arange(100), 2)


def found(*settings):
    return surface_changes(POINTS, MEMBER, DIFFERENCE, EXAMINED, LIMITS, "appeared", *settings)


def test_all_points_have_the_change_of_their_working_point():
    changes = found()
    (change,) = changes.items
    np.testing.assert_array_equal(changes.labels, np.repeat([0, -1], [120, 80]))
    assert (change.kind, change.point_count) == ("appeared", 120)
    np.testing.assert_array_equal(change.mean, POINTS[:120].mean(axis=0))
    # The mean of 0.9 and 0.7 over the restarts, with its odds to the third power.
    assert change.probability == pytest.approx(0.8**3 / (0.8**3 + 0.2**3))
    np.testing.assert_allclose(changes.probability[:120], change.probability)


def test_points_of_no_change_are_hardly_probable():
    outside = found().probability[120:]
    np.testing.assert_allclose(outside[:20], 0.05 * calibrated(np.full(20, 0.7)))
    np.testing.assert_allclose(outside[20:], 0.05 * calibrated(np.full(60, 0.6)))


def test_settings_decide_what_is_significant_and_how_probable():
    assert found(SurfaceChangeSettings(least_significance=1e3)).items == []
    everything = found(SurfaceChangeSettings(least_significance=0.0, sharpening=1.0, outside=1.0))
    assert [change.point_count for change in everything.items] == [120, 20]
    np.testing.assert_allclose(everything.probability, np.repeat([0.8, 0.7, 0.6], [120, 20, 60]))


def test_significance_counts_points_without_counterpart_in_deviations():
    # 60 points of which none is explained: 60 / sqrt(60).
    assert significance(DIFFERENCE, LABELS == 0, LIMITS) == pytest.approx(np.sqrt(60))
    # All ten explained, offset of two registration errors.
    assert significance(DIFFERENCE, LABELS == 1, LIMITS) == pytest.approx(2)


def test_calibration_moves_probabilities_away_from_a_half():
    np.testing.assert_allclose(calibrated(np.array([0.0, 0.25, 0.5, 0.75, 1.0])), [0, 1 / 28, 0.5, 27 / 28, 1])


def test_every_candidate_keeps_its_verdict():
    examined = EXAMINED._replace(
        explanations=(explanation(0.8), explanation(0.6)),
        rejected=(Rejected(np.arange(100) >= 90, explanation(0.1, 0.2)),),
    )
    changes = surface_changes(POINTS, MEMBER, DIFFERENCE, examined, LIMITS, "appeared")
    assert changes.items[0].explanation == explanation(0.8)
    by_reason = {one.reason: one for one in changes.rejected}
    assert by_reason.keys() == {"not observed", "not significant"}
    unseen, small = by_reason["not observed"], by_reason["not significant"]
    assert (unseen.kind, unseen.probability, unseen.point_count) == ("appeared", 0.1, 20)
    np.testing.assert_array_equal(unseen.mean, POINTS[180:].mean(axis=0))
    assert (small.explanation, small.point_count) == (explanation(0.6), 20)


def test_without_a_verdict_there_is_no_explanation():
    changes = found()
    assert changes.items[0].explanation is None
    assert changes.rejected == ()
