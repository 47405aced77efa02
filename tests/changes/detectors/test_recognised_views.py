"""Views of scans whose stations nobody has told."""

import numpy as np
import pytest

from gmmjax.changes import (
    Clock,
    DetectionConfig,
    JointDetector,
    Scan,
    silent,
    with_recognised_views,
)
from gmmjax.changes.prepare.resolution import ResolutionSettings
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair
from tests.clouds.scanned_room import STATIONS, scan


@pytest.fixture(scope="module")
def points():
    """The room from one station each time, the after one 5 cm further and in a frame that is off by 2 cm."""
    shift = np.array([0.05, 0.0, 0.0])
    return Pair(
        scan(STATIONS[0], 40_000, seed=1), scan(STATIONS[0] + shift, 40_000, seed=2) + np.array([0.02, 0.0, 0.0])
    )


def prepared(points, **config):
    detector = JointDetector(DetectionConfig(restarts=1, **config), common_resolution=ResolutionSettings(voxels=10_000))
    return detector.prepared(points.map(lambda own: own if isinstance(own, Scan) else Scan(own)), Clock(silent))


def test_a_scan_without_views_has_those_of_its_station(points):
    scan_with_views = with_recognised_views(Scan(points.before), points.before)
    assert scan_with_views.recognised and scan_with_views.views.turning
    np.testing.assert_allclose(scan_with_views.views.poses[:, :3, 3], STATIONS[:1], atol=0.4)
    assert scan_with_views.views.max_range > np.linalg.norm(points.before - STATIONS[0], axis=1).max()


def test_views_that_are_given_are_kept(points):
    views = SensorViews.from_positions(points.before, [3.0, 3.0, 1.5])
    kept = with_recognised_views(Scan(points.before, views), points.before)
    assert kept.views is views and not kept.recognised


def test_a_scan_that_shows_no_station_has_no_views():
    points = np.random.default_rng(0).uniform(size=(20_000, 3)) * [20, 12, 0.01]
    assert with_recognised_views(Scan(points), points) == Scan(points)


@pytest.mark.slow
def test_recognised_views_are_used_in_the_frame_of_the_before_scan(points):
    found = prepared(points)
    places = found.surveys.map(lambda own: own.views.poses[0, :3, 3])
    assert abs((places.after - places.before)[0] - 0.05) < 0.04


def test_nothing_is_recognised_where_it_is_switched_off(points):
    assert all(own.views is None for own in prepared(points, recognise_stations=False).surveys)


@pytest.mark.slow
def test_recognised_views_that_contradict_their_scan_are_left_out_without_a_warning(points, recwarn):
    """As where a wall hides half of the room from the only station that is recognised."""
    behind = scan(np.array([5.0, 6.0, 1.6]), 40_000, seed=3) + np.array([0.0, 12.4, 0.0])
    # Its own station is no longer to be seen.
    behind = behind[np.linalg.norm(behind[:, :2] - [5.0, 18.4], axis=1) > 4.0]
    both = np.concatenate([points.before, behind])
    assert len(with_recognised_views(Scan(both), both).views) == 1
    found = prepared(Pair(both, both), registration="never")
    assert all(own.views is None for own in found.surveys)
    assert not recwarn.list


@pytest.mark.slow
def test_the_record_says_where_the_stations_are_in_the_frame_of_each_scan(points):
    detector = JointDetector(DetectionConfig(restarts=1, max_components=12, registration="always"))
    moved = Pair(points.before, points.after + np.array([0.13, 0.0, 0.0]))
    changes = detector.changes(moved.map(Scan))
    assert abs(changes.registration.transform[0, 3] + 0.15) < 0.01
    before, after = changes.recognised_stations()
    assert len(before) == len(after) == 1
    np.testing.assert_allclose(after[0, :2] - before[0, :2], [0.2, 0.0], atol=0.05)
    assert [changes.diagnostics[side]["views"] for side in ("before", "after")] == [1, 1]
