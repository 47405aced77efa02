import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes.evidence.free_space import Observed, observation, sightlines
from gmmjax.changes.evidence.nearest_return import (
    NearestReturnSettings,
    angles_between,
    nearest_return,
    nearest_return_at,
)
from gmmjax.changes.evidence.scan_visibility import FreeSpaceSettings, ScanVisibility
from gmmjax.clouds import SensorViews, voxel_grid

CELL = 2.0
POST = 3.0
WALL = 8.0


def views_at(*places):
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = places
    return SensorViews(poses, (360.0, 179.9), 100.0)


VIEWS = views_at((0.0, 0.0, 0.0), (5.0, 1.0, 0.0))


@st.composite
def clouds(draw):
    random = np.random.default_rng(draw(st.integers(0, 2**31)))
    return random.normal(size=(draw(st.integers(1, 400)), 3)) * [6.0, 6.0, 2.0]


@settings(max_examples=30, deadline=None)
@given(clouds())
def test_what_is_left_out_has_something_nearer_beside_it_in_every_view(points):
    kept = points[nearest_return_at(points, VIEWS, CELL)]
    for place in VIEWS.poses[:, :3, 3]:
        own, others = points - place, kept - place
        ranges, nearest = np.linalg.norm(own, axis=1), np.linalg.norm(others, axis=1)
        cosine = (own / ranges[:, None]) @ (others / nearest[:, None]).T
        # The diagonal of a cell, whose width is at most its height, a little more in the rows at the poles.
        beside = cosine >= np.cos(np.radians(1.6 * CELL))
        assert (np.where(beside, nearest, np.inf).min(axis=1) <= ranges + 1e-9).all()


@settings(max_examples=30, deadline=None)
@given(clouds(), st.randoms(use_true_random=False))
def test_neither_order_nor_parts_matter(points, random):
    order = np.array(random.sample(range(len(points)), len(points)))
    whole = points[nearest_return_at(points, VIEWS, CELL)]
    shuffled = points[order]
    np.testing.assert_array_equal(
        np.sort(shuffled[nearest_return_at(shuffled, VIEWS, CELL)], axis=0), np.sort(whole, axis=0)
    )
    parts = np.concatenate([part[nearest_return_at(part, VIEWS, CELL)] for part in np.array_split(shuffled, 3)])
    np.testing.assert_array_equal(np.sort(parts[nearest_return_at(parts, VIEWS, CELL)], axis=0), np.sort(whole, axis=0))


def test_a_motion_of_survey_and_sensor_changes_nothing():
    points = np.random.default_rng(0).normal(size=(3000, 3))
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_euler("xyz", [20, 40, 60], degrees=True).as_matrix(), [9.0, -4.0, 2.0]
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    kept, other = nearest_return_at(points, VIEWS, CELL), nearest_return_at(moved, VIEWS.moved(motion), CELL)
    # Points on the border of two cells may be rounded to either.
    assert len(np.setxor1d(kept, other)) <= 3


def test_only_what_a_view_shows_is_seen():
    points = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0], [0.0, 0.0, 200.0], [2.0, 0.0, 0.1]])
    ahead = SensorViews(np.eye(4)[None], (60.0, 40.0), 50.0)
    assert nearest_return_at(points, ahead, CELL).tolist() == [0]


@pytest.mark.slow
def test_the_number_of_points_is_bounded():
    points = np.random.default_rng(1).normal(size=(20_000, 3))
    everything, cell = nearest_return(points, VIEWS, NearestReturnSettings(cell=0.01))
    assert (len(everything), cell) == (20_000, 0.01)
    few, coarser = nearest_return(points, VIEWS, NearestReturnSettings(cell=0.01, max_points=500))
    assert 0 < len(few) <= 500 and coarser > 0.01
    assert np.isin(few, everything).all()
    some, _ = nearest_return(points, VIEWS, NearestReturnSettings(cell=0.01, max_looks=10_000))
    assert len(some) == 5_000 and (some % 4 == 0).all()


def test_no_points_are_none():
    rows, cell = nearest_return(np.empty((0, 3)), VIEWS)
    assert len(rows) == 0 and cell == NearestReturnSettings().cell


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_the_angle_to_the_fourth_neighbour_on_a_grid_is_its_step(step):
    angles = np.radians(np.arange(-10, 10, step))
    across, down = (own.ravel() for own in np.meshgrid(angles, angles))
    ranges = np.random.default_rng(2).uniform(1, 20, len(across))
    directions = np.stack([np.sin(across) * np.cos(down), np.sin(down), np.cos(across) * np.cos(down)], axis=1)
    own = angles_between(directions * ranges[:, None], 4)
    assert np.degrees(np.median(own)) == pytest.approx(step, rel=0.02)
    assert angles_between(directions[:1], 4).tolist() == [0]


def scan(step=0.3):
    """A wall behind a post of 8 cm near a scanner that looks along z."""
    angles = np.radians(np.arange(-25.0, 25.0, step))
    across, down = (np.tan(own.ravel()) for own in np.meshgrid(angles, angles / 2))
    post = np.abs(across) * POST < 0.04
    depth = np.where(post, POST, WALL)
    noise = np.random.default_rng(3).normal(size=len(depth)) * 0.002
    return np.stack([across, down, np.ones_like(depth)], axis=1) * (depth + noise)[:, None]


@pytest.fixture(scope="module")
def survey():
    """The survey in voxels of a quarter of a metre, and as its sensor saw it."""
    points = scan()
    coarse = ScanVisibility.of(voxel_grid(points, 0.25).points, views_at((0.0, 0.0, 0.0)))
    return coarse, coarse.with_line_of_sight(points)


def test_a_post_hides_what_is_behind_it_and_not_what_is_beside_it(survey):
    coarse, sighted = survey
    angles = np.radians([0.0, 3.0, -3.0, 5.0])
    places = np.stack([np.tan(angles) * 6.0, np.full(4, 0.1), np.full(4, 6.0)], axis=1)
    assert observation(places, sighted, 0.3).tolist() == [Observed.unobserved, *[Observed.free] * 3]
    # In voxels the post is as wide as they are by angle, with those around it.
    assert (observation(places, coarse, 0.3)[:3] == Observed.unobserved).all()
    assert sightlines(places, sighted, 0.3).blocked.tolist() == [1, 0, 0, 0]


def test_the_surface_of_the_survey_still_tells_what_is_near(survey):
    _, sighted = survey
    places = np.array([[2.0, 0.1, WALL - 0.1], [2.0, 0.1, WALL + 1.0]])
    assert observation(places, sighted, 0.3).tolist() == [Observed.surface, Observed.unobserved]


def test_without_views_nothing_is_seen(survey):
    _, sighted = survey
    unknown = sighted.without_views()
    assert unknown.views is None and unknown.sighted is None
    assert unknown.with_line_of_sight(scan()) is unknown
    assert observation(np.array([[1.0, 0.0, 5.0]]), unknown, 0.3).tolist() == [Observed.unobserved]


def test_bins_are_never_finer_than_the_step_of_a_scanner():
    """A second scanner samples the wall finely: between its own lines of sight the first one still sees nothing."""
    points, beside = scan(step=1.0), np.array([1.5, 0.0, WALL - 1.0])
    grid = np.stack(
        [own.ravel() for own in np.meshgrid(np.arange(0.5, 2.5, 0.01), np.arange(-1, 1, 0.01), WALL)], axis=1
    )
    views = views_at((0.0, 0.0, 0.0), beside)
    fine = FreeSpaceSettings(directions=NearestReturnSettings(cell=0.05))
    survey = ScanVisibility.of(voxel_grid(points, 0.25).points, views, fine).with_line_of_sight(
        np.concatenate([points, grid])
    )
    shown = [
        level.bin_size
        for _, image in survey.sighted.images(0)
        for level in image.levels
        if (level.nearest < len(image.ranges)).any()
    ]
    assert np.degrees(min(shown)) >= 1.0


def test_a_floor_at_a_grazing_angle_is_not_seen_through():
    """Below a second scanner the floor has a hole, at whose far side a line of sight of the first one ends."""
    height, away, random = 1.6, 8.0, np.random.default_rng(4)
    across, along = (own.ravel() for own in np.meshgrid(np.arange(-3, 3, 0.02), np.arange(-3, 3, 0.02)))
    around = np.hypot(across, along) > 0.6
    ring = np.stack([across, np.full_like(across, height), away + along], axis=1)[around]
    ring[:, 1] += random.normal(0, 0.002, len(ring))
    views = views_at((0.0, 0.0, 0.0), (0.0, 0.0, away))
    below = np.tan(np.radians(np.arange(2.0, 40.0, 0.5)))
    aside = np.tan(np.radians(np.arange(-20.0, 20.0, 0.5)))
    aside, below = (own.ravel() for own in np.meshgrid(aside, below))
    floor = np.stack([aside * height / below, np.full_like(below, height), height / below], axis=1)
    floor = floor[np.hypot(floor[:, 0], floor[:, 2] - away) > 0.6]
    survey = ScanVisibility.of(voxel_grid(np.concatenate([ring, floor]), 0.1).points, views)
    survey = survey.with_line_of_sight(np.concatenate([ring, floor]))
    beside, along = (own.ravel() for own in np.meshgrid(np.arange(-0.3, 0.31, 0.1), np.arange(-0.3, 0.41, 0.1)))
    hole = np.stack([beside, np.full_like(beside, height), away + along], axis=1)
    assert (observation(hole, survey, 0.05, 0.01) != Observed.free).all()
    standing = hole - np.array([0.0, 0.5, 0.0])
    assert (observation(standing, survey, 0.05, 0.01) == Observed.free).mean() > 0.9
