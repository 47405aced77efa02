import dataclasses

import numpy as np
import pytest

from gmmjax.batch import Comparison
from gmmjax.changes import Changes, DetectionConfig, Registration, change_of
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.pair import Pair
from tests.changes.scanned_objects import motion

REGISTRATION = Registration(motion(0.3, [1.0, 2.0, 0.0]), applied=True)


@pytest.fixture
def clouds():
    random = np.random.default_rng(0)
    return Pair(*(PointCloud.from_rows(random.normal(size=(count, 3))) for count in (400, 500)))


@pytest.fixture
def changes(clouds):
    """The first 50 points of the before cloud moved and are the next 60 of the after cloud; its first 30 appeared."""
    labels_before, labels_after = np.full(400, -1), np.full(500, -1)
    labels_before[:50], labels_after[:30], labels_after[30:90] = 2, 0, 1
    items = (
        change_of(clouds.after.points[:30], "appeared", 0.9, 9.0),
        dataclasses.replace(change_of(clouds.after.points[30:90], "moved", 0.9, 9.0), partner=2),
        dataclasses.replace(change_of(clouds.before.points[:50], "moved", 0.9, 9.0), partner=1),
    )
    return Changes(
        labels_before=labels_before,
        labels_after=labels_after,
        probability_before=np.zeros(400),
        probability_after=np.zeros(500),
        unobserved_before=np.arange(400) >= 300,
        unobserved_after=np.zeros(500, bool),
        items=items,
        emd=0.0,
        config=DetectionConfig(),
        diagnostics={},
        registration=REGISTRATION,
    )


def test_each_change_has_its_points_in_the_frame_of_the_before_cloud(clouds, changes):
    comparison = Comparison.of(2, 5, changes, clouds)
    assert comparison.epochs == Pair(2, 5)
    assert comparison.sides == (1, 1, 0)
    after = transformed(clouds.after.points, REGISTRATION.transform)
    for points, expected in zip(comparison.points, (after[:30], after[30:90], clouds.before.points[:50]), strict=True):
        np.testing.assert_array_equal(points, expected)


def test_points_are_thinned_evenly_and_the_same_way_each_time(clouds, changes, monkeypatch):
    monkeypatch.setattr("gmmjax.batch.comparison.CHANGE_POINTS", 20)
    monkeypatch.setattr("gmmjax.batch.comparison.COVERAGE_POINTS", 40)
    comparison, again = (Comparison.of(0, 1, changes, clouds) for _ in range(2))
    assert [len(points) for points in comparison.points] == [20, 20, 20]
    np.testing.assert_array_equal(comparison.points[2], again.points[2])
    np.testing.assert_array_equal(comparison.points[2][[0, -1]], clouds.before.points[[0, 49]])
    assert comparison.coverage.before.unobserved.mean() == 0.25
    assert len(comparison.coverage.before.points) == 40


def test_of_a_cloud_that_was_observed_completely_no_coverage_is_kept(clouds, changes):
    comparison = Comparison.of(0, 1, changes, clouds)
    assert len(comparison.coverage.after.points) == 0


def test_a_change_without_points_is_at_its_mean(clouds, changes):
    """As of two Gaussians of which one takes all points."""
    bare = dataclasses.replace(changes, labels_after=np.where(changes.labels_after == 0, -1, changes.labels_after))
    np.testing.assert_array_equal(Comparison.of(0, 1, bare, clouds).points[0], changes[0].mean[None])


def test_bad_input(clouds, changes):
    with pytest.raises(InputError, match=r"after: has 400 points, the changes have labels for 500"):
        Comparison.of(0, 1, changes, Pair(clouds.before, clouds.before))
