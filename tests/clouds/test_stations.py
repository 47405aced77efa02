"""Stations of a scanner, recognised in its scans."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.clouds import GroundSettings, StationSettings, recognised_stations, thinned_cloud, voxel_grid
from tests.clouds.made_clouds import ChunkedArray
from tests.clouds.scanned_room import STATIONS, scan


@pytest.fixture(scope="module")
def room():
    """The room from two stations."""
    return np.concatenate([scan(own, 100_000, seed=index) for index, own in enumerate(STATIONS)])


def assert_are(found, stations, metre=1.0, across=0.06, up=0.25):
    """Whether these are the stations, in any order, as exactly as lines of sight need them."""
    assert len(found) == len(stations)
    for station in stations:
        nearest = found[np.argmin(np.linalg.norm(found - station, axis=1))]
        assert np.linalg.norm((nearest - station)[:2]) < across * metre
        assert abs(nearest[2] - station[2]) < up * metre


def test_both_stations_of_a_room_are_recognised(room):
    assert_are(recognised_stations(room), STATIONS)


@pytest.mark.slow
@settings(max_examples=4)
@given(st.floats(0, 360), st.floats(-3, 3), st.sampled_from([(0.0, 0.0, 0.0), (433_000.0, 5_411_000.0, 300.0)]))
def test_stations_move_with_the_scan_in_any_unit(room, degrees, exponent, place):
    metre, turn = 10.0**exponent, Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    moved = (room @ turn.T + place) * metre
    assert_are(recognised_stations(moved), (STATIONS @ turn.T + place) * metre, metre)


def test_the_order_of_the_points_does_not_matter(room):
    order = np.random.default_rng(3).permutation(len(room))
    np.testing.assert_allclose(recognised_stations(room[order]), recognised_stations(room), atol=1e-9)


@pytest.mark.parametrize(("rays", "lowest"), [(40_000, -60.0), (40_000, -45.0), (200_000, -60.0), (200_000, -70.0)])
def test_a_station_is_recognised_at_any_density_and_of_any_hole(rays, lowest):
    assert_are(recognised_stations(scan(STATIONS[0], rays, lowest=lowest)), STATIONS[:1], up=0.35)


def test_ground_may_rise():
    """By a tenth; the station seems to be a little further up."""
    station = STATIONS[0] + [0.0, 0.0, 0.6]
    assert_are(recognised_stations(scan(station, 100_000, slope=0.1)), station[None], across=0.15)


def test_a_station_beside_a_wall_is_recognised():
    station = np.array([1.5, 5.0, 1.6])
    assert_are(recognised_stations(scan(station, 100_000)), station[None])


@pytest.mark.slow
def test_voxels_with_the_numbers_of_their_points_show_what_the_points_do(room):
    thinned = thinned_cloud(ChunkedArray(room, 50_000).chunks(), 60_000)
    assert thinned.total == len(room) > 2 * len(thinned.points)
    assert_are(recognised_stations(thinned.points, thinned.counts), STATIONS, across=0.2, up=0.5)


def test_clouds_whose_density_was_made_even_show_none(room):
    assert len(recognised_stations(voxel_grid(room, 0.1).points)) == 0


def test_a_scanner_that_was_carried_shows_no_station():
    places = [[x, 6.0 + 0.3 * np.sin(x), 1.6] for x in np.arange(3.0, 17.0, 0.25)]
    walk = [scan(np.array(place), 3_000, seed=index) for index, place in enumerate(places)]
    assert len(recognised_stations(np.concatenate(walk))) == 0


def test_dense_things_are_no_stations():
    """Gaussians, a floor that was looked at more closely in one place, and boards."""
    random = np.random.default_rng(0)
    floor = np.c_[random.uniform(0, 20, (60_000, 2)), np.zeros(60_000)]
    blobs = [random.normal(centre, 0.5, (5_000, 3)) for centre in ((3, 3, 0), (10, 5, 0), (16, 12, 0))]
    disc = random.normal(0, 1.0, (20_000, 3)) * [1, 1, 0.002] + [10, 10, 0]
    board = np.c_[random.uniform(5, 7, 20_000), random.uniform(5, 5.3, 20_000), np.full(20_000, 0.02)]
    for things in (blobs, [floor, *blobs], [floor, disc], [floor, board]):
        assert len(recognised_stations(np.concatenate(things))) == 0


def test_what_stands_all_around_hides_a_station():
    """Of a scanner that looks through a slit a third of the ground is seen: too little to be sure."""
    points = scan(STATIONS[0], 100_000)
    x, y = (points - STATIONS[0])[:, :2].T
    assert len(recognised_stations(points[np.abs(np.arctan2(y, x)) < np.pi / 3])) == 0


@pytest.mark.parametrize("number", [0, 1, 2, 30])
def test_few_points_show_none(number):
    assert recognised_stations(np.random.default_rng(0).normal(size=(number, 3))).shape == (0, 3)


@pytest.mark.parametrize("axis", range(3))
def test_points_in_a_line_or_in_a_plane_show_none(axis):
    points = np.random.default_rng(0).normal(size=(1_000, 3))
    points[:, axis] = 1.0
    assert len(recognised_stations(points)) == 0
    points[:, axis - 1] = 2.0
    assert len(recognised_stations(points)) == 0


def test_one_point_far_away_is_no_endless_map():
    points = np.r_[np.random.default_rng(0).normal(size=(1_000, 3)), [[1e9, 0.0, 0.0]]]
    assert len(recognised_stations(points)) == 0


@pytest.mark.slow
def test_each_condition_of_a_station_can_be_made_harder(room):
    """So that it is the condition that refuses it."""
    for name, value in {
        "contrast": 1e6,
        "seen": 1.1,
        "deviation": 0.0,
        "ground": GroundSettings(thickness=-1.0),
        "share": 2.0,
        "filled": -1.0,
        "largest": 0.01,
    }.items():
        harder = dataclasses.replace(StationSettings(), **{name: value})
        assert len(recognised_stations(room, settings=harder)) == 0, name


@pytest.mark.slow
def test_more_stations_are_recognised_apart():
    places = np.array([[x, y, 1.6] for x, y in itertools.product((4.0, 10.0, 16.0), (3.5, 8.5))])
    points = np.concatenate([scan(own, 60_000, seed=index) for index, own in enumerate(places)])
    assert_are(recognised_stations(points), places)
