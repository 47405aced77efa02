import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes.evidence.free_space import Observed, observation, sightlines
from gmmjax.changes.evidence.scan_visibility import FreeSpaceSettings, ScanVisibility
from gmmjax.clouds import SensorViews
from gmmjax.scenes.rigid_motions import looking_at
from tests.changes.rooms import around, box, looking, scanned

MARGIN = 0.03
OBJECT = box((0.25, 0.2, 0), (0.3, 0.25, 0.3))
FURNITURE = [box((-0.5, 0.1, 0), (0.2, 0.2, 0.4))]
VIEWS = around(6)


def inside(points, corners, by):
    return ((points > corners[0] + by) & (points < corners[1] - by)).all(axis=1)


@pytest.fixture(scope="module")
def surveys():
    """A room with an object and without it, and which points of the first are the object's."""
    before = scanned(VIEWS, [*FURNITURE, OBJECT], noise=0.004, seed=1, voxel=0.015)
    after = scanned(VIEWS, FURNITURE, noise=0.004, seed=2, voxel=0.015)
    return before, after, inside(before, OBJECT, -0.02) & (before[:, 2] > MARGIN + 0.01)


def wall(distance, half=1.0, spacing=0.01):
    """A square wall across the z axis, as a camera at the origin sees it."""
    steps = np.arange(-half, half, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    return np.stack([x, y, np.full_like(x, distance)], axis=1)


def one_camera(field_of_view=(60.0, 60.0), max_range=5.0):
    return SensorViews(np.eye(4)[None], field_of_view, max_range)


def observed(points, cloud, views, margin):
    return observation(points, ScanVisibility.of(cloud, views), margin)


def test_before_on_and_behind_a_wall():
    depths = np.array([0.3, 1.0, 1.9, 1.985, 2.0, 2.02, 2.1, 3.0])
    places = np.stack([np.full_like(depths, 0.1), np.zeros_like(depths), depths], axis=1)
    seen = observed(places, wall(2.0), one_camera(), MARGIN)
    assert seen.tolist() == [1, 1, 1, 0, 0, 0, -1, -1]
    assert (Observed.free, Observed.surface, Observed.unobserved) == (1, 0, -1)


def test_outside_the_view_nothing_is_known():
    places = np.array([[0, 0, -1.0], [1.5, 0, 1], [0, -1.5, 1], [0, 0, 1]])
    assert observed(places, wall(2.0, half=4.0, spacing=0.02), one_camera(), MARGIN).tolist() == [-1, -1, -1, 1]
    beyond_range = one_camera(max_range=0.9)
    assert observed(places[-1:], wall(2.0), beyond_range, MARGIN).tolist() == [-1]


def test_no_return_is_no_evidence():
    hole = wall(2.0)
    hole = hole[np.linalg.norm(hole[:, :2], axis=1) > 0.4]
    places = np.array([[0, 0, 1.0], [0.4, 0, 1.0]])
    assert observed(places, hole, one_camera(), MARGIN).tolist() == [-1, 1]


def test_what_stands_in_front_hides():
    screen = wall(1.0, half=0.2, spacing=0.02)
    places = np.array([[0, 0, 1.5], [0.1, 0.1, 1.5], [0.6, 0, 1.5], [0, 0, 0.5]])
    cloud = np.concatenate([wall(2.0), screen])
    assert observed(places, cloud, one_camera(), MARGIN).tolist() == [-1, -1, 1, 1]


def test_a_stray_point_in_the_air_hides_nothing():
    stray = np.array([[0.0, 0.0, 0.8], [0.2, 0.1, 1.0]])
    places = np.array([[0, 0, 1.5], [0.02, 0.02, 1.2], [0.3, 0.15, 1.5]])
    assert observed(places, np.concatenate([wall(2.0, spacing=0.02), stray]), one_camera(), MARGIN).tolist() == [
        1,
        1,
        1,
    ]


@pytest.mark.parametrize("size", [2, 5, 7])
def test_floating_pixels_beside_each_other_hide_nothing(size):
    """Groups 20 cm in front of a wall: five and more are no farther from each other than the points of a surface."""
    generator = np.random.default_rng(0)
    middles = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 5), np.linspace(-0.8, 0.8, 5), [1.8]), axis=-1).reshape(-1, 3)
    groups = middles[:, None] + generator.uniform(-0.01, 0.01, (25, size, 3))
    cloud = np.concatenate([wall(2.0, half=1.3, spacing=0.02), groups.reshape(-1, 3)])
    behind = middles * 1.06
    assert (observed(behind, cloud, one_camera(), MARGIN) == Observed.free).all()
    if size > 4:
        by_distance = ScanVisibility.of(cloud, one_camera(), FreeSpaceSettings(min_indegree=0.0))
        assert (observation(behind, by_distance, MARGIN) == Observed.free).mean() < 0.5


@pytest.mark.parametrize("spacing", [0.01, 0.02, 0.04])
def test_near_and_sparse_surfaces_do_not_leak(spacing):
    """Through the gaps between the points of a near screen the wall behind can be seen, but not by a sensor."""
    screen = wall(0.5, half=0.3, spacing=spacing)
    places = np.random.default_rng(0).uniform([-0.4, -0.4, 0.8], [0.4, 0.4, 1.8], (500, 3))
    cloud = np.concatenate([screen, wall(2.0, half=1.2)])
    assert (observed(places, cloud, one_camera(), MARGIN) == Observed.unobserved).all()


def test_a_grazing_floor_is_not_free():
    """The floor seen from 10 degrees above it, a little misregistered, and with a hole in it."""
    views = SensorViews(np.stack([looking((-1.8, 0, 0.32), (0, 0, 0.0))]), (60.0, 30.0), 6.0)
    room = (np.array([-2.0, -2.0, 0.0]), np.array([2.0, 2.0, 1.5]))
    floor = scanned(views, room=room, noise=0.003, pixels=(400, 240), voxel=0.01)
    floor = floor[floor[:, 2] < 0.05]
    holed = floor[np.linalg.norm(floor[:, :2] - [0.3, 0.0], axis=1) > 0.15]
    shifted = floor + np.array([0.008, 0.008, 0.012])
    for cloud in (floor, holed):
        assert (observed(shifted, cloud, views, MARGIN) == Observed.free).mean() < 0.002


@pytest.fixture(scope="module")
def here(surveys):
    """What the survey after saw of the points before."""
    before, after, _ = surveys
    return observed(before, after, VIEWS, MARGIN)


def test_the_object_is_free_and_the_room_is_not(surveys, here):
    before, after, changed = surveys
    assert (here[changed] == Observed.free).mean() > 0.95
    assert (here[~inside(before, OBJECT, -0.05)] == Observed.free).mean() < 1e-3
    # What the object hid comes out, and the survey with the object had not seen it.
    uncovered = inside(after, box((0.25, 0.2, -0.1), (0.22, 0.17, 0.2)), 0)
    assert uncovered.sum() > 50
    assert (observed(after[uncovered], before, VIEWS, MARGIN) != Observed.free).all()


def test_small_and_low_objects_are_free():
    small, low = box((0.2, -0.2, 0), (0.06, 0.06, 0.08)), box((-0.2, 0.3, 0), (0.2, 0.15, 0.04))
    before = scanned(VIEWS, [small, low], noise=0.002, seed=1, voxel=0.01)
    after = scanned(VIEWS, [], noise=0.002, seed=2, voxel=0.01)
    for corners in (small, low):
        top = inside(before, corners, -0.01) & (before[:, 2] > 0.03)
        assert (observed(before[top], after, VIEWS, 0.02) == Observed.free).mean() > 0.8


@pytest.mark.slow
@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_rigid_motion_changes_nothing(surveys, here, seed):
    before, after, _ = surveys
    generator = np.random.default_rng(seed)
    motion = np.eye(4)
    motion[:3, :3] = Rotation.random(random_state=int(seed)).as_matrix()
    motion[:3, 3] = generator.normal(0, 10, 3)

    def moved(points):
        return points @ motion[:3, :3].T + motion[:3, 3]

    there = observed(moved(before), moved(after), VIEWS.moved(motion), MARGIN)
    # A few points lie on the edge of a bin or of the margin, and rounding decides.
    assert (here != there).sum() <= 3


@pytest.mark.slow
@settings(max_examples=8)
@given(st.permutations(range(6)), st.integers(0, 2**32 - 1))
def test_order_changes_nothing(surveys, here, order, seed):
    before, after, _ = surveys
    generator = np.random.default_rng(seed)
    points, others = generator.permutation(len(before)), generator.permutation(len(after))
    views = SensorViews(VIEWS.poses[order], VIEWS.field_of_view, VIEWS.max_range)
    np.testing.assert_array_equal(here[points], observed(before[points], after[others], views, MARGIN))


@pytest.mark.slow
def test_more_views_never_know_less(surveys):
    before, after, _ = surveys
    known = np.full(len(before), Observed.unobserved)
    for count in range(1, 7):
        views = SensorViews(VIEWS.poses[:count], VIEWS.field_of_view, VIEWS.max_range)
        seen = observed(before, after, views, MARGIN)
        assert (seen[known != Observed.unobserved] == known[known != Observed.unobserved]).all()
        known = seen


def test_a_turning_scanner_sees_all_around():
    pose = looking((0.0, 0.1, 0.8), (1.0, 0.1, 0.8))
    views = SensorViews(pose[None], (360.0, 170.0), 10.0)
    walls = scanned(around(10, height=0.75, radius=0.01, target=(0, 0, 0.75)), noise=0.002, seed=3, voxel=0.02)
    floor = scanned(VIEWS, noise=0.002, seed=3, voxel=0.02)
    generator = np.random.default_rng(1)
    places = generator.uniform([-0.85, -0.85, 0.15], [0.85, 0.85, 0.7], (2000, 3))
    seen = observed(places, np.concatenate([walls, floor]), views, MARGIN)
    assert (seen == Observed.free).mean() > 0.97
    outside = generator.uniform([1.1, -0.9, 0.2], [1.4, 0.9, 0.7], (200, 3))
    assert (observed(outside, np.concatenate([walls, floor]), views, MARGIN) == Observed.unobserved).all()


def test_no_places_and_a_cloud_of_one_point():
    nothing = np.zeros((0, 3))
    assert observed(nothing, wall(2.0), one_camera(), MARGIN).shape == (0,)
    assert observed(np.array([[0, 0, 1.0]]), np.array([[0, 0, 2.0]]), one_camera(), MARGIN).tolist() == [1]


@pytest.mark.slow
def test_real_pairs(scan_pairs):
    from gmmjax.clouds import read_cloud

    for folder in scan_pairs:
        if not (folder / "unseen_before.npy").is_file():
            continue
        clouds = {side: read_cloud(folder / f"{side}.ply").points for side in ("before", "after")}
        for side, other in (("before", "after"), ("after", "before")):
            truth, unseen = (np.load(folder / f"{name}_{side}.npy") for name in ("truth", "unseen"))
            seen = observed(clouds[side], clouds[other], SensorViews.at_origin(clouds[other]), 0.01)
            free = seen == Observed.free
            assert free[(truth >= 0) & ~unseen].mean() > 0.75
            assert free[(truth < 0) & ~unseen].mean() < 1e-3
            assert free[unseen].mean() < 5e-3


def above(heights, lateral=0.1):
    """Places this far in front of a wall at 2 m."""
    heights = np.asarray(heights, float)
    return np.stack([np.full_like(heights, lateral), np.zeros_like(heights), 2.0 - heights], axis=1)


def test_nearer_than_the_margin_the_offset_from_a_flat_surface_counts():
    survey = ScanVisibility.of(wall(2.0), one_camera())
    places = above([0.05, 0.02, 0.011, 0.009, -0.02, -0.05])
    free, surface, unobserved = Observed.free, Observed.surface, Observed.unobserved
    assert observation(places, survey, MARGIN).tolist() == [free, *[surface] * 4, unobserved]
    assert observation(places, survey, MARGIN, 0.01).tolist() == [free] * 3 + [surface] * 2 + [unobserved]
    offsets = np.array([0.01, 0.03, 0.01, 0.01, 0.01, 0.01])
    assert observation(places, survey, MARGIN, offsets).tolist() == [free, surface, free, surface, surface, unobserved]


def test_a_surface_that_is_not_flat_needs_the_whole_margin():
    """Noise of two spacings: the planes through sixteen points are in no particular direction."""
    generator = np.random.default_rng(0)
    survey = ScanVisibility.of(wall(2.0) + 0.02 * generator.normal(size=(40000, 3)), one_camera())
    places = above(generator.uniform(0.03, 0.05, 300), generator.uniform(-0.4, 0.4, 300))
    assert (observation(places, survey, 0.06, 0.01) == Observed.free).mean() < 0.1


def test_each_point_may_have_its_own_margin():
    places = above([0.05, 0.05, 0.02, 0.02])
    margins = np.array([0.03, 0.06, 0.03, 0.01])
    seen = observation(places, ScanVisibility.of(wall(2.0), one_camera()), margins)
    assert seen.tolist() == [Observed.free, Observed.surface, Observed.surface, Observed.free]


def test_a_floor_that_rises_towards_the_sensor_does_not_occlude_what_stands_on_it():
    """Seen from 9 degrees above it: the floor in the bins below is nearer than a place 5 cm above it."""
    steps = np.arange(-1.0, 1.0, 0.01)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    floor = np.stack([x, y, np.zeros_like(x)], axis=1)
    views = SensorViews(looking((-2.0, 0, 0.32), (0, 0, 0))[None], (60.0, 40.0), 5.0)
    survey = ScanVisibility.of(floor, views)
    generator = np.random.default_rng(0)
    places = generator.uniform([-0.5, -0.5, 0.012], [0.2, 0.5, 0.02], (300, 3))
    assert (observation(places, survey, MARGIN, 0.01) == Observed.free).mean() > 0.95
    below = places * [1, 1, -3]
    assert (observation(below, survey, MARGIN, 0.01) != Observed.free).all()


def test_sightlines_count_the_views():
    screen = wall(1.0, half=0.1, spacing=0.01)
    beside = np.eye(4)
    beside[0, 3] = 0.5
    views = SensorViews(np.stack([np.eye(4), beside, beside]), (60.0, 60.0), 5.0)
    survey = ScanVisibility.of(np.concatenate([wall(2.0, half=2.0), screen]), views)
    places = np.array([[0, 0, 0.5], [0, 0, 1.5], [0, 0, 2.0], [0, 0, 2.5], [-0.9, 0, 1.7], [0, 0, -1.0]])
    lines = sightlines(places, survey, 0.1, 0.05)
    assert lines.through.tolist() == [1, 2, 0, 0, 1, 0]
    assert lines.blocked.tolist() == [0, 1, 1, 3, 0, 0]
    # In margins along the ray, as all of these are farther from the wall.
    assert lines.beyond[0] == pytest.approx(5, rel=0.02) and lines.beyond[4] > 3
    assert (lines.beyond[[2, 3, 5]] < 0.01).all()
    near = sightlines(above([0.02, 0.04]), ScanVisibility.of(wall(2.0), one_camera()), 0.1, 0.05)
    np.testing.assert_allclose(near.beyond, [0.4, 0.8], rtol=1e-6)
    for without in (sightlines(places, ScanVisibility.of(wall(2.0)), 0.1), sightlines(places[:0], survey, 0.1)):
        assert not any(values.any() for values in without)


def test_lines_of_sight_reach_what_they_end_at_and_what_is_before_it():
    screen = wall(1.0, half=0.2, spacing=0.02)
    cloud = np.concatenate([wall(2.0), screen])
    # Before the screen, on it, behind it by less than the margin and by more, on the wall beside it, and not in view.
    places = np.array([[0, 0, 0.7], [0, 0, 1.0], [0, 0, 1.03], [0, 0, 1.5], [0.6, 0, 2.0], [0, 0, -1.0]])
    reached = sightlines(places, ScanVisibility.of(cloud, one_camera()), 0.1, 0.01).reached
    assert reached.tolist() == [1, 1, 0, 0, 1, 0]
    beside = np.eye(4)
    beside[0, 3] = 0.5
    both = SensorViews(np.stack([np.eye(4), beside]), (60.0, 60.0), 5.0)
    assert sightlines(places, ScanVisibility.of(cloud, both), 0.1, 0.01).reached.tolist() == [1, 2, 0, 1, 2, 0]
    assert not sightlines(places, ScanVisibility.of(cloud), 0.1, 0.01).reached.any()


def test_at_a_grazing_angle_a_floor_is_reached_between_its_points():
    steps = np.arange(-1.0, 1.0, 0.02)
    floor = np.stack([*(grid.ravel() for grid in np.meshgrid(steps, steps)), np.zeros(len(steps) ** 2)], axis=1)
    views = SensorViews(looking((-2.0, 0, 0.2), (0, 0, 0))[None], (60.0, 40.0), 5.0)
    places = np.random.default_rng(0).uniform([-0.6, -0.4, -0.002], [0.6, 0.4, 0.002], (500, 3))
    assert sightlines(places, ScanVisibility.of(floor, views), 0.06, 0.01).reached.mean() > 0.98
    below = sightlines(places - [0, 0, 0.03], ScanVisibility.of(floor, views), 0.06, 0.01)
    assert below.reached.mean() < 0.02


def test_what_is_not_flat_hides_by_its_points():
    """Twigs: planes through sixteen points are in no particular direction."""
    generator = np.random.default_rng(0)
    survey = ScanVisibility.of(wall(2.0) + 0.02 * generator.normal(size=(40000, 3)), one_camera())
    places = above(generator.uniform(-0.2, -0.15, 300), generator.uniform(-0.4, 0.4, 300))
    assert sightlines(places, survey, 0.5, 0.01).reached.mean() < 0.05
    open_clutter = dataclasses.replace(survey, settings=FreeSpaceSettings(behind=np.inf))
    assert sightlines(places, open_clutter, 0.5, 0.01).reached.mean() > 0.5


def test_sightlines_agree_with_the_observation(surveys):
    before, after, _ = surveys
    survey = ScanVisibility.of(after, VIEWS)
    for offset in (np.inf, 0.015):
        free = observation(before, survey, MARGIN, offset) == Observed.free
        np.testing.assert_array_equal(sightlines(before, survey, MARGIN, offset).through > 0, free)


def test_what_counts_as_an_outlier_is_a_setting():
    cloud = np.concatenate([wall(2.0, spacing=0.02), [[0.0, 0.0, 0.8]]])
    place = np.array([[0, 0, 1.5]])
    occluding = ScanVisibility.of(
        cloud,
        one_camera(),
        FreeSpaceSettings(outlier_distance=np.inf, widest_spacing=100.0, min_indegree=0.0, max_blocked=0),
    )
    assert observed(place, cloud, one_camera(), MARGIN) == Observed.free
    assert observation(place, occluding, MARGIN) == Observed.unobserved


def test_sparse_points_on_no_plane_are_outliers_only_where_their_range_is_known():
    """A dozen spacings apart, three metres from the wall: nobody knows whether a scanner far away had no more."""
    generator = np.random.default_rng(0)
    sparse = generator.uniform((-0.3, -0.3, 4.7), (0.3, 0.3, 5.3), (100, 3))
    cloud, points = np.concatenate([wall(2.0), sparse]), slice(-len(sparse), None)
    assert ScanVisibility.of(cloud, one_camera(max_range=10.0)).outliers[points].mean() > 0.5
    assert ScanVisibility.of(cloud).outliers[points].mean() < 0.3


def test_a_tilted_plane_through_noise_does_not_free_the_floor_in_a_hole():
    random = np.random.default_rng(0)
    noise, spacing = 0.02, 0.08
    x, y = (own.ravel() for own in np.meshgrid(np.arange(1, 8, spacing), np.arange(-2, 2, spacing)))
    floor = np.stack([x, y, noise * random.standard_normal(len(x))], axis=1)
    hole = (abs(floor[:, :2] - [4.0, 0.0]) < 0.4).all(axis=1)
    places = np.column_stack([random.uniform([3.6, -0.4], [4.4, 0.4], (2000, 2)), noise * random.standard_normal(2000)])
    views = SensorViews(looking_at(np.array([0, 0, 1.5]), np.array([5.0, 0, 0.5]))[None], (80.0, 60.0), 30.0)

    def free(tilts):
        survey = ScanVisibility.of(floor[~hole], views, FreeSpaceSettings(tilts=tilts))
        # Told apart by direction, as in scans that are compared at their own resolution.
        by_direction = dataclasses.replace(survey, cell=0.2)
        return (observation(places, by_direction, spacing, 1.5 * noise) == Observed.free).mean()

    assert free(0.0) > 0.02 > 3 * free(FreeSpaceSettings().tilts)
