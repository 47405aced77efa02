import functools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax import InputError
from gmmjax.geometry import transformed
from gmmjax.scenes import FAMILIES, family_scene
from gmmjax.scenes.families.staging import Support, Turnover, turned
from gmmjax.scenes.families.things import box, moved

# One scene of each family in which something changes.
SEEDS = {"rooms": 7, "kitchens": 0, "station": 1, "corridors": 1, "halls": 0, "depots": 0, "apartments": 1, "yards": 1}

# Points of a cloud, at most: some families are as dense as scans.
MOST = dict.fromkeys(FAMILIES, 42_000) | {"apartments": 105_000, "depots": 210_000, "halls": 260_000}

scene_of = functools.cache(lambda name: family_scene(name, SEEDS.get(name, 0)))


@pytest.mark.parametrize("name", ["kitchens", "apartments"])
def test_a_scene_is_its_family_and_its_seed(name):
    again, scene = family_scene(name, SEEDS.get(name, 0)), scene_of(name)
    for side in ("before", "after"):
        np.testing.assert_array_equal(getattr(again.clouds, side), getattr(scene.clouds, side))
        np.testing.assert_array_equal(getattr(again.truth, side), getattr(scene.truth, side))
        np.testing.assert_array_equal(getattr(again.views, side).poses, getattr(scene.views, side).poses)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_changes_are_on_the_sides_that_their_kinds_say(name):
    scene = scene_of(name)
    for number, kind in enumerate(scene.kinds):
        assert kind == "moved" or not (scene.truth.before == number).any() or kind == "disappeared"
        assert kind == "moved" or not (scene.truth.after == number).any() or kind == "appeared"
    for cloud, truth, unseen in zip(scene.clouds, scene.truth, scene.unseen, strict=True):
        assert cloud.shape == (len(truth), 3) and len(unseen) == len(truth) and np.isfinite(cloud).all()
        assert 4000 <= len(truth) <= MOST[name]
        assert set(truth) <= {-1, *range(len(scene.kinds))}
    assert set(scene.motions) == {number for number, kind in enumerate(scene.kinds) if kind == "moved"}


@pytest.mark.parametrize("name", FAMILIES)
def test_changes_that_count_have_points_that_the_other_survey_could_see(name):
    scene = scene_of(name)
    for truth, unseen, uncounted in zip(scene.truth, scene.unseen, scene.uncounted, strict=True):
        for number in set(truth) - {-1} - uncounted:
            assert (truth == number).sum() >= 40 and unseen[truth == number].mean() < 0.5


@pytest.mark.parametrize("name", FAMILIES)
def test_views_see_their_own_cloud(name):
    scene = scene_of(name)
    for cloud, views in zip(scene.clouds, scene.views, strict=True):
        some = cloud[:: len(cloud) // 500]
        seen = np.zeros(len(some), bool)
        for view in range(len(views)):
            seen |= views.in_field_of_view(views.in_camera(some, view))
        assert seen.mean() > 0.97


@pytest.mark.parametrize("name", FAMILIES)
def test_unchanged_surfaces_lie_on_each_other_once_registered(name):
    scene = scene_of(name)
    stays = scene.clouds.before[(scene.truth.before == -1) & ~scene.unseen.before]
    tree = cKDTree(scene.clouds.before)
    other = (scene.truth.after == -1) & ~scene.unseen.after
    distance = cKDTree(transformed(scene.clouds.after, scene.registration)[other]).query(stays[::10])[0]
    spacing = tree.query(stays[::10], k=8)[0][:, -1]
    assert np.median(distance) < 3 * max(np.median(spacing), 0.05 * scene.unit)


def test_seeds_give_different_scenes():
    assert family_scene("rooms", 0).clouds.before.shape != scene_of("rooms").clouds.before.shape


def test_nothing_changes_in_a_third_of_the_scenes():
    drawn = [Turnover().drawn(np.random.default_rng(seed)) for seed in range(300)]
    assert np.mean([counts == (0, 0, 0) for counts in drawn]) == pytest.approx(1 / 3, abs=0.1)
    assert {max(counts) for counts in drawn} == {0, 1, 2, 3}


def test_things_stand_apart_and_on_their_support():
    random = np.random.default_rng(0)
    support = Support(turned(0.5, (1.0, 2.0, 0.7)), (3.0, 2.0))
    things = [box(random) for _ in range(12)]
    poses = [support.pose(random, thing) for thing in things]
    standing = [moved(thing, pose) for thing, pose in zip(things, poses, strict=True) if pose is not None]
    assert len(standing) > 4
    for thing in standing:
        assert thing[0].centre[2] - thing[0].extent[2] / 2 == pytest.approx(0.7)
        near = [other for other in standing if other is not thing and other[0].contains(thing[0].centre[None], 0.05)]
        assert not near
    assert Support(np.eye(4), (3.0, 2.0), headroom=0.05).pose(random, things[0]) is None


def test_an_unknown_family_is_refused():
    with pytest.raises(InputError, match="family='cellars' is unknown; choose from rooms, kitchens"):
        family_scene("cellars", 0)
