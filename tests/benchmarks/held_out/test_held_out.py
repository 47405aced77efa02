"""That the held-out scenes are what they say: rays meet what is there, and the truth is where things changed."""

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes import ScanVisibility
from tests.benchmarks.held_out import held_out_pair, held_out_sources, meshes
from tests.benchmarks.held_out.casting import RIM, Foliage, Terrain, Thing, first_hits
from tests.benchmarks.held_out.halls import hall
from tests.benchmarks.held_out.sensors import camera, looking
from tests.benchmarks.held_out.surveys import labelled


def unit(count, seed=0):
    directions = np.random.default_rng(seed).standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_rays_meet_the_nearest_surface():
    block = Thing(meshes.box(2, 2, 1, (0, 0, -0.5)), 3)
    ball = Thing(meshes.shifted(meshes.ellipsoid(2, 2, 2, 40, 80), (5, 0, -1)), 7)
    directions = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    hits = first_hits([block, ball], np.array([3.0, 0, 0]), directions)
    np.testing.assert_allclose(hits.ranges, [1, np.inf, 2, np.inf], atol=0.01)
    np.testing.assert_array_equal(hits.change, [7, -1, 3, -1])
    # From within a box every ray meets one of its sides.
    inside = unit(500)
    expected = 1 / (np.abs(inside) / (1, 1, 0.5)).max(axis=1)
    np.testing.assert_allclose(first_hits([block], np.zeros(3), inside).ranges, expected)


def test_rays_meet_terrain_from_above():
    """A plane of height x / 2, of which the half with y > 0 has changed."""
    x = np.arange(-20, 21) * 0.5
    heights = np.tile(x[:, None] / 2, (1, 41))
    numbers = np.where(x > 0, 4, -1)[None, :] * np.ones((41, 1), int)
    plane, origin = Terrain(heights, np.array([-10.0, -10.0]), 0.5, numbers, {4: 0.1}), np.array([0.2, 0.1, 6.0])
    directions = unit(2000, 1) * (1, 1, -1)
    hits = first_hits([plane], origin, directions)
    met = np.flatnonzero(np.isfinite(hits.ranges))
    places = origin + hits.ranges[met, None] * directions[met]
    assert len(met) > 500
    np.testing.assert_allclose(places[:, 2], places[:, 0] / 2, atol=0.1 * plane.cell)
    np.testing.assert_array_equal(hits.change[met] == 4, np.round((places[:, 1] + 10) / 0.5) > 20)
    # Beside the edges there are no normals.
    within = np.abs(places[:, :2]).max(axis=1) < 9
    facing = np.abs(directions[met] @ np.array([-1, 0, 2]) / np.sqrt(5))
    np.testing.assert_allclose(hits.facing[met][within], facing[within], atol=1e-6)


def test_leaves_stop_rays_at_random_and_hide_nothing():
    bush, along = Foliage(np.array([5.0, 0, 0]), np.ones(3), 0.5), np.tile([1.0, 0, 0], (4000, 1))
    ranges = first_hits([bush], np.zeros(3), along, np.random.default_rng(0)).ranges
    stopped = ranges[np.isfinite(ranges)]
    assert stopped.min() >= 4 and stopped.max() <= 6
    assert len(stopped) / len(ranges) == pytest.approx(1 - np.exp(-2 / 0.5), abs=0.01)
    assert np.isinf(first_hits([bush], np.zeros(3), along).ranges).all()


def test_a_camera_sees_what_nothing_hides():
    wall, block = Thing(meshes.box(0.1, 4, 4, (3, 0, -2)), 0), Thing(meshes.box(0.2, 1, 1, (1.5, 0, -0.5)), 1)
    sensor, pose = camera(40, 30, 60.0, 5.0, (0.0,), lost=0.0), looking((0, 0, 0), (1, 0, 0))
    frame = sensor.frame([wall, block], pose, np.random.default_rng(0))
    measured = frame.measured @ pose[:3, :3].T
    np.testing.assert_allclose(measured[frame.change == 0][:, 0], 2.95)
    np.testing.assert_allclose(measured[frame.change == 1][:, 0], 1.4)
    places = np.array([[2.95, 0.0, 0.0], [2.95, 1.3, 0.0], [0.7, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(sensor.sees(places, [wall, block], pose, 0.03), [False, True, True, False])


@pytest.mark.slow
def test_a_seed_gives_one_scene_and_its_truth():
    # The first one that is drawn from this seed has no change within sight.
    pair, same = (held_out_pair("single_frame", 3, True) for _ in range(2))
    np.testing.assert_array_equal(pair.after.points, same.after.points)
    assert not pair.unchanged
    assert held_out_pair("single_frame", 3, False).unchanged
    for cloud in (pair.before, pair.after):
        assert np.isfinite(cloud.points).all() and len(cloud.points) == len(cloud.truth) == len(cloud.unseen)
        assert (cloud.truth < 0).mean() > 0.8 and cloud.unseen.mean() < 0.2


def test_a_box_moves_by_what_its_kind_says():
    pair = held_out_pair("box_by_10_cm", 3, True)
    before, after = (cloud.points[cloud.truth == 0] for cloud in (pair.before, pair.after))
    assert np.linalg.norm(after.mean(axis=0) - before.mean(axis=0)) == pytest.approx(0.1, abs=0.03)
    assert pair.before.not_counted == pair.after.not_counted == {RIM}
    assert np.linalg.norm(pair.motions[0][:3, 3]) == pytest.approx(0.1)
    np.testing.assert_allclose(pair.motions[0][:3, :3], np.eye(3), atol=1e-9)


def test_poses_change_nothing_but_the_views():
    known, unknown = (held_out_pair("single_frame", 1, True, poses) for poses in ("given", "unknown"))
    np.testing.assert_array_equal(known.after.points, unknown.after.points)
    assert unknown.after.views is None
    own = known.after.views.in_camera(known.after.points, 0)
    assert known.after.views.in_field_of_view(own).mean() > 0.99
    assert ScanVisibility.of(known.after.points, known.after.views).views is not None


@pytest.mark.slow
def test_eroded_ground_lies_lower_and_its_rim_does_not_count():
    pair = held_out_pair("slope", 1, True, points=20_000)
    assert not pair.unchanged and RIM in pair.after.not_counted and (pair.after.truth == RIM).any()
    both = set(pair.before.truth) & set(pair.after.truth) - {-1, RIM}
    assert both and not any(pair.before.unseen[pair.before.truth == number].any() for number in both)
    assert held_out_pair("slope", 1, False, points=20_000).unchanged


@pytest.mark.slow
def test_a_hall_has_what_changes_on_its_floor():
    random = np.random.default_rng(1)
    pair = labelled("hall", hall(random, True, 20_000), random, given=True)
    assert len(pair.after.points) == pytest.approx(20_000, rel=0.1)
    heights = np.concatenate([own.points[own.truth >= 0, 2] for own in (pair.before, pair.after)])
    assert len(heights) > 10 and (heights > -0.1).all() and (heights < 6).all()


def test_sources_name_kind_poses_and_condition():
    sources = held_out_sources(["room", "hall"], [4, 5], ["given"])
    names = [(source.group, source.condition, source.name) for source in sources]
    kinds, conditions = ("room", "hall"), ("changed", "unchanged")
    expected = [(f"{k}, poses given", c, f"{k} {seed}") for k in kinds for c in conditions for seed in (4, 5)]
    assert names == expected
    with pytest.raises(InputError, match="'garden' is unknown; choose from room"):
        held_out_sources(["garden"], [0], ["given"])
