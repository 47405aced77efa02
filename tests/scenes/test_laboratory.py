import jax
import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax import InputError
from gmmjax.clouds import SensorViews
from gmmjax.scenes import laboratory, laboratory_scene

CHANGES = dict(appeared=1, disappeared=1, moved=1)


@pytest.fixture(scope="module")
def room():
    return laboratory_scene(jax.random.key(0), **CHANGES)


@pytest.fixture(scope="module")
def hard_room():
    return laboratory_scene(jax.random.key(1), **CHANGES, level="hard")


@pytest.fixture(scope="module")
def frame():
    return laboratory_scene(jax.random.key(2), **CHANGES, survey="frame")


@pytest.fixture(scope="module")
def quiet_room():
    return laboratory_scene(jax.random.key(3), appeared=0)


def moved(points, transform):
    return points @ transform[:3, :3].T + transform[:3, 3]


def registered(scene):
    """The after cloud in the frame of the before cloud."""
    return moved(scene.after, np.linalg.inv(scene.misregistration))


def distances(points, others):
    return cKDTree(others).query(points)[0]


@pytest.mark.slow
def test_a_scene_is_its_key(room):
    again = laboratory_scene(jax.random.key(0), **CHANGES)
    for name in ("before", "after", "truth_before", "truth_after", "unseen_before", "unseen_after", "misregistration"):
        np.testing.assert_array_equal(getattr(again, name), getattr(room, name))
    np.testing.assert_array_equal(again.views_after.poses, room.views_after.poses)
    other = laboratory_scene(jax.random.key(9), **CHANGES)
    assert other.before.shape != room.before.shape or (other.before != room.before).any()


def test_the_two_surveys_are_measured_anew(room):
    assert not np.isin(room.before, room.after).any()
    apart = np.linalg.norm(room.views_before.poses[:, :3, 3] - room.views_after.poses[:, :3, 3], axis=1)
    assert (apart > 0.005).all() and (apart < 0.25).all()


@pytest.mark.parametrize("scene_name", ["room", "hard_room", "frame", "quiet_room"])
def test_the_clouds_have_the_size_of_such_surveys_and_one_value_for_each_point(scene_name, request):
    scene = request.getfixturevalue(scene_name)
    for side in ("before", "after"):
        points = getattr(scene, side)
        assert 15_000 <= len(points) <= 50_000
        assert np.isfinite(points).all()
        assert len(getattr(scene, f"truth_{side}")) == len(getattr(scene, f"unseen_{side}")) == len(points)
        # All but flying pixels lie in the room.
        low, high = np.percentile(points, [0.5, 99.5], axis=0)
        assert (high - low < [2.6, 2.8, 1.7]).all() and (high - low > [1.5, 1.5, 0.5]).all()


def test_the_changes_are_those_asked_for(room, quiet_room):
    assert room.kinds == ("disappeared", "appeared", "moved")
    assert set(room.truth_before) == {-1, 0, 2} and set(room.truth_after) == {-1, 1, 2}
    assert set(room.motions) == {2}
    assert quiet_room.kinds == () and not quiet_room.motions
    assert (quiet_room.truth_before == -1).all() and (quiet_room.truth_after == -1).all()


@pytest.mark.parametrize("scene_name", ["room", "hard_room", "frame"])
def test_changed_objects_are_compact_and_stand_where_the_other_survey_found_nothing(scene_name, request):
    scene = request.getfixturevalue(scene_name)
    before, after = scene.before, registered(scene)
    for points, truth, other in ((before, scene.truth_before, after), (after, scene.truth_after, before)):
        for change in set(truth) - {-1}:
            own = points[truth == change]
            core = np.percentile(own, [1, 99], axis=0)
            assert (core[1] - core[0] < 0.7).all() and core[0][2] > -0.03
            above_the_floor = own[own[:, 2] > 0.1]
            assert np.mean(distances(above_the_floor, other) > 0.03) > 0.8


@pytest.mark.parametrize("scene_name", ["room", "hard_room", "frame", "quiet_room"])
def test_what_is_unchanged_and_was_seen_lies_on_the_other_survey(scene_name, request):
    scene = request.getfixturevalue(scene_name)
    before, after = scene.before, registered(scene)
    stays = (scene.truth_before == -1) & ~scene.unseen_before
    assert np.mean(distances(before[stays], after) < 0.06) > 0.98


@pytest.mark.parametrize("scene_name", ["room", "hard_room", "frame"])
def test_the_misregistration_is_recorded(scene_name, request):
    """The cameras stand upright and the floor is level, until the after survey is moved as a whole."""
    scene = request.getfixturevalue(scene_name)
    poses = scene.views_after.moved(np.linalg.inv(scene.misregistration)).poses
    np.testing.assert_allclose(scene.views_before.poses[:, 2, 0], 0, atol=1e-12)
    np.testing.assert_allclose(poses[:, 2, 0], 0, atol=1e-12)
    assert np.abs(scene.views_after.poses[:, 2, 0]).max() > 1e-5
    after = registered(scene)
    for points in (scene.before, after):
        for x in (-1, 1):
            floor = points[(np.abs(points[:, 2]) < 0.05) & (x * points[:, 0] > 0.2)]
            assert abs(np.median(floor[:, 2])) < 0.004
    shift = np.linalg.norm(scene.misregistration[:3, 3])
    turn = np.degrees(np.arccos(np.clip((np.trace(scene.misregistration[:3, :3]) - 1) / 2, -1, 1)))
    min_shift, min_turn = (0.02, 0.5) if scene_name == "hard_room" else (0.01, 0.0)
    assert min_shift - 1e-9 <= shift <= 0.02 + 1e-9 and min_turn - 1e-6 <= turn <= 0.5 + 1e-6


@pytest.mark.parametrize("scene_name", ["room", "hard_room", "frame"])
def test_a_moved_object_is_carried_by_its_motion(scene_name, request):
    scene = request.getfixturevalue(scene_name)
    old, new = (points[truth == 2] for points, truth in ((scene.before, scene.truth_before),
                                                         (scene.after, scene.truth_after)))  # fmt: skip
    # Surveys see different sides of the object before and after; its top they see in both.
    assert np.mean(distances(moved(old, scene.motions[2]), new) < 0.03) > 0.3
    assert np.mean(distances(old, new) < 0.03) < 0.05
    assert np.linalg.norm(old.mean(axis=0) - new.mean(axis=0)) > 0.22
    # It stays on the floor, upright, until the after survey is misregistered.
    true_motion = np.linalg.inv(scene.misregistration) @ scene.motions[2]
    np.testing.assert_allclose(true_motion[2, :3], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(true_motion[:3, :3] @ true_motion[:3, :3].T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("scene_name", ["room", "hard_room"])
def test_the_views_saw_their_cloud(scene_name, request):
    scene = request.getfixturevalue(scene_name)
    for points, views in ((scene.before, scene.views_before), (scene.after, scene.views_after)):
        assert np.mean(seen_by(points, views)) > 0.999


def seen_by(points, views: SensorViews):
    """Whether any view has the point in its field of view, in front of it."""
    seen = np.zeros(len(points), bool)
    for view in range(len(views)):
        places = views.in_camera(points, view)
        seen |= views.in_field_of_view(places) & (places[:, 2] > 0)
    return seen


def test_all_points_of_a_frame_are_in_its_one_view(frame):
    for points, views in ((frame.before, frame.views_before), (frame.after, frame.views_after)):
        assert len(views) == 1 and seen_by(points, views).all()
        assert np.linalg.norm(views.in_camera(points, 0), axis=1).min() > 0.25
    step = np.linalg.inv(frame.views_before.poses[0]) @ frame.views_after.poses[0]
    assert np.linalg.norm(step[:3, 3]) < 0.06


@pytest.mark.parametrize("side", ["before", "after"])
def test_unseen_is_what_a_nearer_surface_hid_from_the_other_frame(frame, side):
    """Against the measured depth image of the other frame, by the angle between rays; edges within noise left out."""
    back = np.linalg.inv(frame.misregistration)
    clouds = {"before": frame.before, "after": registered(frame)}
    views = {"before": frame.views_before, "after": frame.views_after.moved(back)}
    other = "after" if side == "before" else "before"
    own, measured = (views[other].in_camera(clouds[name], 0) for name in (side, other))
    own_range, range_ = (np.linalg.norm(places, axis=1) for places in (own, measured))
    angle, neighbours = cKDTree(measured / range_[:, None]).query(own / own_range[:, None], k=9)
    around = range_[neighbours]
    inside = angle[:, -1] < 0.02
    hidden = inside & (around.max(axis=1) < own_range - 0.08)
    open_ = inside & (around.min(axis=1) > own_range - 0.01)
    assert hidden.sum() > 200 and open_.sum() > 5000
    unseen = getattr(frame, f"unseen_{side}")
    assert unseen[hidden].mean() > 0.98
    assert unseen[open_].mean() < 0.05


def test_the_hard_level_loses_a_quarter_of_the_frames_and_hides_more(room, hard_room):
    for side in ("before", "after"):
        assert len(getattr(room, f"views_{side}")) == 16 and len(getattr(hard_room, f"views_{side}")) == 12
    # Of those that look inward from the walls a run is lost, which leaves one gap on the way round the room.
    places = hard_room.views_before.poses[:, :3, 3]
    inward = places[np.hypot(places[:, 0], places[:, 1]) > 0.5]
    around = np.sort(np.arctan2(inward[:, 1], inward[:, 0]))
    gaps = np.diff(np.append(around, around[0] + 2 * np.pi))
    assert np.sort(gaps)[-1] > 1.3 and np.sort(gaps)[-2] < 1.2


def test_no_two_rooms_are_the_same(room, quiet_room):
    """The docking station on the far wall and the shelf on the left hang above all objects, elsewhere in each room."""
    for across, wall in ((0, (1, 0.9, 1.03)), (1, (0, -1.03, -0.89))):
        axis, nearest, farthest = wall
        places = []
        for scene in (room, quiet_room):
            along, above = scene.before[:, axis], scene.before[:, 2] > 0.5
            fixture = scene.before[(along > nearest) & (along < farthest) & above & (scene.truth_before == -1)]
            assert len(fixture) > 50
            places.append(np.median(fixture[:, across]))
        assert abs(places[0] - places[1]) > 0.03


def test_changes_that_the_other_survey_could_not_see_are_not_counted(monkeypatch):
    # Everything within 10 m in front of what a ray first meets counts as hidden.
    monkeypatch.setattr(laboratory, "HIDDEN_BY", -10.0)
    scene = laboratory_scene(jax.random.key(2), **CHANGES, survey="frame")
    assert scene.unseen_before.all() and scene.unseen_after.all()
    assert scene.uncounted_before == {0, 2} and scene.uncounted_after == {1, 2}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(appeared=-1), "appeared=-1"),
        (dict(disappeared=-2), "disappeared=-2"),
        (dict(appeared=0, moved=3), "moved=3"),
    ],
)
def test_scenes_that_cannot_be_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        laboratory_scene(jax.random.key(0), **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(dict(level="harder"), "level='harder' is unknown"), (dict(survey="walk"), "survey='walk' is unknown")],
)
def test_unknown_kinds_of_scenes_are_refused(arguments, message, as_users):
    with pytest.raises(InputError, match=message):
        laboratory_scene(jax.random.key(0), **arguments)
