import functools
import importlib

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax import InputError
from gmmjax.geometry import transformed
from gmmjax.scenes import FAMILIES, family_scene

# One scene of each family in which something changes.
SEEDS = {"rooms": 7, "kitchens": 0, "station": 1, "corridors": 1, "halls": 0, "depots": 0, "apartments": 1, "yards": 1}

# Points of a cloud, at most: some families are as dense as scans.
MOST = dict.fromkeys(FAMILIES, 42_000) | {"apartments": 105_000, "depots": 210_000, "halls": 260_000}

scene_of = functools.cache(family_scene)


@pytest.fixture(params=FAMILIES)
def name(request):
    return request.param


@pytest.fixture
def scene(name):
    return scene_of(name, SEEDS.get(name, 0))


def counted(scene):
    """The changes that count in both clouds."""
    return set(range(len(scene.kinds))) - scene.uncounted.before - scene.uncounted.after


def sides_of(scene, number):
    """The points of a change in either cloud."""
    return [cloud[truth == number] for cloud, truth in zip(scene.clouds, scene.truth, strict=True)]


@pytest.mark.parametrize("family", ["tabletop", "yards"])
def test_a_scene_is_its_family_and_its_seed(family):
    seed = SEEDS.get(family, 0)
    again, scene, other = family_scene(family, seed), scene_of(family, seed), scene_of(family, seed + 1)
    for side in ("before", "after"):
        np.testing.assert_array_equal(getattr(again.clouds, side), getattr(scene.clouds, side))
        np.testing.assert_array_equal(getattr(again.truth, side), getattr(scene.truth, side))
        np.testing.assert_array_equal(getattr(again.views, side).poses, getattr(scene.views, side).poses)
    assert other.clouds.before.shape != scene.clouds.before.shape


@pytest.mark.slow
def test_the_truth_of_a_scene_is_consistent(name, scene):
    for number, kind in enumerate(scene.kinds):
        absent = {"appeared": scene.truth.before, "disappeared": scene.truth.after}.get(kind, np.zeros(0))
        assert name in GROUND or not (absent == number).any()
    assert set(scene.motions) == {number for number, kind in enumerate(scene.kinds) if kind == "moved"}
    for side in ("before", "after"):
        cloud, truth, unseen = (getattr(pair, side) for pair in (scene.clouds, scene.truth, scene.unseen))
        assert cloud.shape == (len(truth), 3) and len(unseen) == len(truth) and np.isfinite(cloud).all()
        assert 2000 <= len(truth) <= MOST[name] and set(truth) <= {-1, *range(len(scene.kinds))}
        for number in set(truth) - {-1} - getattr(scene.uncounted, side):
            assert (truth == number).sum() >= 40 and unseen[truth == number].mean() < 0.5


# Of ground that comes or goes both the old and the new surface are changes.
GROUND = ("terrain", "earthworks")


def test_views_see_their_own_cloud(scene):
    for cloud, views in zip(scene.clouds, scene.views, strict=True):
        some = cloud[:: len(cloud) // 500]
        seen = [views.in_field_of_view(views.in_camera(some, view)) for view in range(len(views))]
        assert np.any(seen, axis=0).mean() > 0.97


def test_unchanged_surfaces_lie_on_each_other_once_registered(scene):
    stays = scene.clouds.before[(scene.truth.before == -1) & ~scene.unseen.before]
    other = (scene.truth.after == -1) & ~scene.unseen.after
    distance = cKDTree(transformed(scene.clouds.after, scene.registration)[other]).query(stays[::10])[0]
    spacing = cKDTree(scene.clouds.before).query(stays[::10], k=8)[0][:, -1]
    assert np.median(distance) < 3 * max(np.median(spacing), 0.05 * scene.unit)


def test_an_unknown_family_is_refused():
    with pytest.raises(InputError, match="family='cellars' is unknown; choose from rooms, kitchens"):
        family_scene("cellars", 0)


def true_motions(monkeypatch, family, seeds):
    """The motions of what moved in rooms that nobody surveys."""
    arrangements = []

    def instead(random, arrangement, size, aim):
        arrangements.append(arrangement)
        return scene_of("yards", 1)

    for module in ("doors", "room_surveys"):
        monkeypatch.setattr(importlib.import_module(f"gmmjax.scenes.families.{module}"), "surveyed_room", instead)
    for seed in seeds:
        FAMILIES[family](np.random.default_rng(seed))
    for arrangement in arrangements:
        for number in range(arrangement.changes):
            old, new = (next(own.pose() for own in side if own.label == number) for side in arrangement.solids)
            yield old, new @ np.linalg.inv(old)


def degrees(motion):
    return np.degrees(np.arccos(np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1)))


def test_leaves_turn_about_a_hinge_and_drawers_are_pulled_straight(monkeypatch):
    motions = [motion for _, motion in true_motions(monkeypatch, "doors", range(40))]
    angles = np.array([degrees(motion) for motion in motions])
    turns, slides = angles > 1, angles < 1e-3
    assert (turns | slides).all() and turns.sum() > 5 and slides.sum() > 5
    assert (angles[turns] >= 5 - 1e-6).all() and (angles[turns] <= 100 + 1e-6).all()
    for motion, slide in zip(motions, slides, strict=True):
        if slide:
            assert 0.05 <= np.linalg.norm(motion[:3, 3]) <= 0.4
        else:
            # A hinge stays where it is: along the axis of the rotation nothing moves.
            axis = np.linalg.svd(motion[:3, :3] - np.eye(3))[2][2]
            assert abs(axis @ motion[:3, 3]) < 1e-6 * max(1.0, np.linalg.norm(motion[:3, 3]))


def test_things_are_turned_or_shifted_within_their_places(monkeypatch):
    moved = list(true_motions(monkeypatch, "small_motions", range(25)))
    shifts = np.array([np.linalg.norm((motion @ old - old)[:3, 3]) for old, motion in moved])
    angles = np.array([degrees(motion) for _, motion in moved])
    assert len(moved) > 8 and shifts.max() < 0.35 and angles.max() < 60 + 1e-6
    assert ((shifts > 0.019) | (angles > 4.9)).all()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_leaf_lies_after_where_its_motion_brings_it(seed):
    scene = scene_of("doors", seed)
    for number in set(scene.motions) & counted(scene):
        before, after = sides_of(scene, number)
        assert np.median(cKDTree(transformed(before, scene.motions[number])).query(after)[0]) < 0.1 * scene.unit


TABLES = range(7, 16)


def test_the_camera_stands_near_the_table():
    for scene in (scene_of("tabletop", seed) for seed in TABLES):
        for cloud, views in zip(scene.clouds, scene.views, strict=True):
            nearest = cKDTree(cloud).query(views.poses[:, :3, 3])[0] / scene.unit
            assert 1 <= len(views) <= 3 and (nearest > 0.25).all() and (nearest < 1.6).all()


def test_what_came_or_went_lies_apart_from_the_other_cloud():
    apart = []
    for scene in (scene_of("tabletop", seed) for seed in TABLES):
        registered = transformed(scene.clouds.after, scene.registration)
        for kind, side, own, other in (
            ("disappeared", "before", scene.clouds.before, registered),
            ("appeared", "after", registered, scene.clouds.before),
        ):
            distance, truth = cKDTree(other).query(own)[0], getattr(scene.truth, side)
            usual = np.median(distance[(truth == -1) & ~getattr(scene.unseen, side)])
            numbers = set(range(len(scene.kinds))) - getattr(scene.uncounted, side)
            apart += [np.median(distance[truth == number]) / usual for number in numbers if scene.kinds[number] == kind]
    # One thing in the place of another may lie on its surface, in part.
    assert len(apart) >= 4 and np.median(apart) > 3 and min(apart) > 0.9


def test_some_tables_are_one_frame_split_in_two():
    scenes = [scene_of("tabletop", seed) for seed in TABLES]
    split = [scene for scene in scenes if np.allclose(scene.registration, np.eye(4))]
    assert split and len(split) < len(scenes)
    for scene in split:
        np.testing.assert_array_equal(scene.views.before.poses, scene.views.after.poses)
        assert len(scene.views.before) == 1


@pytest.mark.slow
def test_the_ground_below_a_deposit_changed_with_it():
    scene = scene_of("terrain", 9)
    assert scene.kinds == ("appeared",)
    low, high = np.percentile(scene.clouds.before / scene.unit, [1, 99], axis=0)
    assert 15 < np.max(high - low) < 250
    for truth, unseen in zip(scene.truth, scene.unseen, strict=True):
        assert (truth == 0).sum() > 80 and unseen[truth == 0].mean() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number", "kind"), [(6, 0, "disappeared"), (10, 1, "appeared"), (12, 1, "appeared")])
def test_displaced_ground_is_a_change_at_both_its_heights(seed, number, kind):
    scene = scene_of("earthworks", seed)
    assert scene.kinds[number] == kind
    before, after = sides_of(scene, number)
    after = transformed(after, scene.registration)
    assert min(len(before), len(after)) > 40
    below = cKDTree(before[:, :2]).query(after[:, :2])[1]
    rise = np.median(after[:, 2] - before[below, 2]) / scene.unit
    assert 0.1 < (rise if kind == "appeared" else -rise) < 5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, 12])
def test_changes_of_ground_are_apart_and_smaller_than_the_ground(seed):
    scene = scene_of("earthworks", seed)
    for cloud, truth in zip(scene.clouds, scene.truth, strict=True):
        extent = np.ptp(cloud[:, :2], axis=0).max()
        places = [cloud[truth == number] for number in range(len(scene.kinds)) if (truth == number).sum() > 20]
        for one in range(len(places)):
            assert np.ptp(places[one][:, :2], axis=0).max() < 0.6 * extent
            assert all(cKDTree(places[one]).query(places[other])[0].min() > 0 for other in range(one))


@pytest.mark.slow
def test_what_changes_stands_on_the_floor_and_in_the_racks():
    lowest = []
    for scene in (scene_of("depots", seed) for seed in (0, 3)):
        # A camera's y axis is down.
        above = -scene.clouds.before @ scene.views.before.poses[0, :3, 1] / scene.unit
        changes = np.unique(scene.truth.before[scene.truth.before >= 0])
        lowest += [above[scene.truth.before == number].min() - np.percentile(above, 1) for number in changes]
    assert min(lowest) < 0.1 and max(lowest) > 0.7


@pytest.mark.slow
def test_towns_are_seen_from_far_above_or_from_the_street():
    flown = []
    for scene in (scene_of("town", seed) for seed in range(3)):
        views = scene.views.before
        flown.append(views.field_of_view[0] < 180)
        ranges = np.linalg.norm(scene.clouds.before[::50, None] - views.poses[None, :, :3, 3], axis=2).min(axis=1)
        if flown[-1]:
            # One direction to all that is below, and walls hardly seen.
            axes = views.poses[:, :3, 2]
            np.testing.assert_allclose(axes, np.broadcast_to(axes[:1], axes.shape), atol=2e-3)
            assert ranges.min() > 100 * scene.unit
        else:
            heights = transformed(scene.clouds.before, np.linalg.inv(views.poses[len(views) // 2]))[:, 1] / scene.unit
            # The ground is 1.7 to 2.4 m below the lidar on a car's roof.
            assert 1.2 < np.percentile(heights, 90) < 3.5 and ranges.min() < 8 * scene.unit
        assert (scene.truth.before >= 0).mean() < 0.3
    assert set(flown) == {True, False}
