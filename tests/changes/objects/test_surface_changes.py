import numpy as np
import pytest

from gmmjax.changes.differences import DetectionLimits, DifferenceSettings, LocalDifference
from gmmjax.changes.evidence.examination import Examined
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
    DISTANCE, np.full(100, 0.002), *np.full((2, 100), 0.001), np.full(100, 0.01), *np.full((2, 100), 0.001)
)
LOOKS_CHANGED = np.repeat([0.8, 0.7, 0.6], [60, 10, 30])
UNOBSERVED = np.arange(100) >= 95
EXAMINED = Examined(
    LABELS, np.array([0.97, 0.6]), LOOKS_CHANGED, UNOBSERVED,
    (explanation(0.97, 0.02), explanation(0.6)), ((np.arange(80, 95), explanation(0.1, 0.8)),),
)  # fmt: skip
# Two points of the cloud for each working point.
POINTS, MEMBER = np.random.default_rng(0).normal(size=(200, 3)), np.repeat(np.arange(100), 2)


def found(*settings, examined=EXAMINED):
    return surface_changes(POINTS, MEMBER, DIFFERENCE, examined, "appeared", LIMITS, *settings)


def test_all_points_have_the_change_of_their_working_point():
    changes = found()
    np.testing.assert_array_equal(changes.labels, np.repeat([0, 1, -1], [120, 20, 60]))
    assert [(change.kind, change.point_count) for change in changes.items] == [("appeared", 120), ("appeared", 20)]
    np.testing.assert_array_equal(changes.items[0].mean, POINTS[:120].mean(axis=0))
    assert changes.items[0].significance == pytest.approx(np.sqrt(60))


def test_changes_and_their_points_have_the_probability_of_the_verdict():
    changes = found()
    assert [change.probability for change in changes.items] == [0.97, 0.6]
    np.testing.assert_array_equal(changes.probability[:140], np.repeat([0.97, 0.6], [120, 20]))


def test_points_of_no_candidate_are_hardly_probable():
    outside = np.repeat(np.arange(100), 2) >= 95
    np.testing.assert_allclose(found().probability[outside], 0.05 * calibrated(np.full(10, 0.6)))
    as_measured = found(SurfaceChangeSettings(sharpening=1.0, outside=1.0))
    np.testing.assert_allclose(as_measured.probability[outside], 0.6)


def test_every_candidate_keeps_its_verdict():
    changes = found()
    assert [change.explanation for change in changes.items] == list(EXAMINED.explanations)
    (rejected,) = changes.rejected
    assert (rejected.kind, rejected.reason, rejected.probability) == ("appeared", "unchanged", 0.1)
    assert rejected.explanation == explanation(0.1, 0.8)
    assert rejected.point_count == 30
    np.testing.assert_array_equal(changes.probability[160:190], 0.1)
    np.testing.assert_array_equal(rejected.mean, POINTS[160:190].mean(axis=0))


def test_without_a_verdict_there_is_no_explanation():
    changes = found(examined=EXAMINED._replace(explanations=(None, None), rejected=()))
    assert [change.explanation for change in changes.items] == [None, None]
    assert changes.rejected == ()


def test_significance_counts_points_without_counterpart_in_deviations():
    # 60 points of which none is explained: 60 / sqrt(60).
    assert significance(DIFFERENCE, LABELS == 0, LIMITS) == pytest.approx(np.sqrt(60))
    # All ten explained, offset of two registration errors.
    assert significance(DIFFERENCE, LABELS == 1, LIMITS) == pytest.approx(2)


def test_calibration_moves_probabilities_away_from_a_half():
    np.testing.assert_allclose(calibrated(np.array([0.0, 0.25, 0.5, 0.75, 1.0])), [0, 1 / 28, 0.5, 27 / 28, 1])
