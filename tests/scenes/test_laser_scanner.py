import dataclasses

import numpy as np
import pytest

from gmmjax.scenes import (
    AirborneScanner,
    Beam,
    PoseErrors,
    Solid,
    SpinningLidar,
    TripodScanner,
    looking_down,
    upright,
)

FLOOR = Solid(np.array([0.0, 0.0, -0.1]), np.array([40.0, 40.0, 0.2]))
WALL = Solid(np.array([10.0, 0.0, 3.0]), np.array([0.2, 40.0, 6.0]), label=7)
POST = Solid(np.array([5.0, 0.0, 1.0]), np.array([0.3, 0.3, 2.0]), label=3)
EXACT = Beam(noise=0.0, growth=0.0, mixed=0.0, lost=0.0)
EXACT_FAR = dataclasses.replace(EXACT, max_range=500.0)


@pytest.fixture
def random():
    return np.random.default_rng(0)


def stand(height=1.5, heading=0.0):
    return upright(np.array([0.0, 0.0, height]), heading)[None]


def test_a_tripod_scanner_sees_all_round_but_for_the_cone_below(random):
    recording = TripodScanner(EXACT, rays=20_000, lowest=-45.0).recording([FLOOR, WALL, POST], stand(), random)
    assert set(recording.labels) == {-1, 3, 7}
    floor = recording.points[(recording.labels == -1) & (recording.points[:, 2] < 0.01)]
    np.testing.assert_allclose(floor[:, 2], 0, atol=1e-9)
    assert np.hypot(floor[:, 0], floor[:, 1]).min() == pytest.approx(1.5, abs=0.1)
    assert (floor[:, 0] < -5).any() and (np.abs(floor[:, 1]) > 5).any()
    np.testing.assert_array_equal(recording.points, recording.places)


def test_what_a_scanner_measured_it_could_see_and_the_cone_below_it_could_not(random):
    solids = [FLOOR, WALL, POST]
    recording = TripodScanner(EXACT, rays=5000, lowest=-45.0).recording(solids, stand(), random)
    assert recording.saw(recording.places, solids, 0.01).all()
    hidden = np.array([[0.2, 0.2, 0.0], [6.0, 0.0, 1.0], [12.0, 3.0, 1.0]])
    assert not recording.saw(hidden, solids, 0.01).any()
    assert recording.saw(np.array([[-3.0, 0.0, 1.0]]), solids, 0.01).all()


def test_a_sector_scan_sees_no_more_than_its_sector(random):
    scanner = TripodScanner(EXACT, rays=5000, horizontal=200.0)
    recording = scanner.recording([FLOOR, WALL], stand(heading=np.pi), random)
    azimuths = np.degrees(np.arctan2(recording.points[:, 1], recording.points[:, 0]))
    assert np.abs(azimuths).min() > 79.9
    assert not recording.saw(np.array([[9.0, 0.0, 1.0]]), [FLOOR, WALL], 0.01).any()


def test_noise_grows_with_the_range_and_rays_at_edges_return_something_between(random):
    beam = Beam(noise=0.005, growth=0.002, mixed=0.5, lost=0.0)
    recording = TripodScanner(beam, rays=40_000).recording([FLOOR, WALL, POST], stand(), random)
    wall = recording.points[recording.labels == 7]
    assert np.std(wall[np.abs(wall[:, 1]) < 3, 0] - 9.9) == pytest.approx(0.025, rel=0.2)
    between = (recording.points[:, 0] > 5.3) & (recording.points[:, 0] < 9.5) & (recording.points[:, 2] > 0.3)
    assert between.sum() > 5 and set(recording.labels[between]) == {-1}


def test_a_lidar_has_rings(random):
    recording = SpinningLidar(EXACT, rings=8, vertical=40.0, columns=90).recording([FLOOR, WALL], stand(), random)
    offset = recording.points - [0.0, 0.0, 1.5]
    elevations = np.degrees(np.arctan2(offset[:, 2], np.hypot(offset[:, 0], offset[:, 1])))
    np.testing.assert_allclose(np.unique(elevations.round(3)), np.linspace(-20, 20, 8), atol=0.01)


def test_drift_grows_along_the_path(random):
    poses = np.concatenate([upright(np.array([x, 0.0, 1.0]), 0.0)[None] for x in np.linspace(-6, 6, 13)])
    lidar = SpinningLidar(EXACT, rings=4, columns=40)
    recording = lidar.recording([FLOOR, WALL], poses, random, PoseErrors(drift=0.2, drift_degrees=0.3))
    believed = np.linalg.norm(recording.views.poses[:, :3, 3] - recording.stands.poses[:, :3, 3], axis=1)
    assert believed[0] == 0 and (np.diff(believed) > 0).all() and 0.1 < believed[-1] < 0.2 + 12 * np.radians(0.3)
    displaced = np.linalg.norm(recording.points - recording.places, axis=1)
    per_pose = len(displaced) // 13
    assert displaced[: per_pose // 2].max() < 1e-9 and displaced[-per_pose // 2 :].mean() > 0.1


def test_an_aircraft_sees_roofs_and_ground(random):
    roof = Solid(np.array([0.0, 0.0, 2.0]), np.array([4.0, 4.0, 4.0]), label=1)
    poses = np.concatenate([looking_down(np.array([x, 0.0, 100.0]), 0.0)[None] for x in (-5.0, 0.0, 5.0)])
    recording = AirborneScanner(EXACT_FAR, across=15.0, along=4.0).recording([FLOOR, roof], poses, random)
    on_roof = recording.points[recording.labels == 1, 2]
    assert on_roof.max() == pytest.approx(4.0) and np.mean(on_roof > 3.999) > 0.9
    assert np.abs(recording.points[:, 1]).max() > 12 and np.abs(recording.points[:, 0]).max() < 9
    assert recording.saw(recording.places, [FLOOR, roof], 0.01).all()
    assert not recording.saw(np.array([[0.0, 0.0, 1.0]]), [FLOOR, roof], 0.01).any()
