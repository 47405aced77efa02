import dataclasses

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes import Beam, Frame, Solid, TripodScanner, surveyed_scene, uncounted, upright

FLOOR = Solid(np.array([0.0, 0.0, -0.1]), np.array([12.0, 12.0, 0.2]))
SCREEN = Solid(np.array([2.0, 0.0, 1.5]), np.array([0.1, 3.0, 3.0]))
SIDE = np.array([0.5, 0.5, 0.5])
GONE = Solid(np.array([0.0, 2.0, 0.25]), SIDE, label=0)
NEW = Solid(np.array([3.0, 0.0, 0.25]), SIDE, label=1)
MOVED = Solid(np.array([-2.0, 0.0, 0.25]), SIDE, label=2)
TURN = rigid_transform(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, -1.0, 0.0]))
SOLIDS = Pair([FLOOR, SCREEN, GONE, MOVED], [FLOOR, SCREEN, NEW, MOVED.moved(TURN)])
FRAME = Frame(
    rigid_transform(translation=np.array([0.05, 0.02, 0.0])), rigid_transform(translation=np.array([900.0, -50.0, 3.0]))
)


def recorded(stand, solids, seed):
    scanner = TripodScanner(Beam(noise=0.001, mixed=0.0), rays=30_000)
    return scanner.recording(solids, upright(np.array([*stand, 1.2]), 0.0)[None], np.random.default_rng(seed))


@pytest.fixture(scope="module")
def recordings():
    """The first survey stands on one side of the screen, the second on the other."""
    return Pair(recorded((-0.5, 0.3), SOLIDS.before, 0), recorded((4.5, 0.0), SOLIDS.after, 1))


@pytest.fixture(scope="module")
def scene(recordings):
    return surveyed_scene(SOLIDS, recordings, FRAME)


def test_what_changed_follows_from_the_labels(scene):
    assert scene.kinds == ("disappeared", "appeared", "moved")
    assert set(scene.truth.before) == {-1, 0, 2} and 1 in scene.truth.after and 0 not in scene.truth.after


def test_what_the_other_survey_could_not_see_is_unseen_and_not_counted(scene):
    # The screen hides the new box from the first stand, and the old places from the second.
    assert scene.unseen.after[scene.truth.after == 1].all() and 1 in scene.uncounted.after
    assert scene.unseen.before[scene.truth.before == 2].mean() > 0.9 and 2 in scene.uncounted.before


def test_a_stand_beside_the_first_sees_the_same(recordings):
    near = surveyed_scene(SOLIDS, Pair(recordings.before, recorded((-0.5, 0.0), SOLIDS.after, 2)))
    assert near.unseen.before.mean() < 0.1 and near.uncounted.before == frozenset()


def test_what_a_deposit_covers_changed_with_it_and_is_seen():
    deposit = Solid(np.array([2.0, 0.0, 0.05]), np.array([2.0, 2.0, 0.3]), label=0)
    solids = Pair([FLOOR], [FLOOR, deposit])
    recordings = Pair(recorded((-0.5, 0.3), solids.before, 0), recorded((-0.5, 0.0), solids.after, 1))
    thing = surveyed_scene(solids, recordings)
    ground = surveyed_scene(solids, recordings, covers=Pair([], [deposit]))
    covered = deposit.contains(recordings.before.places)
    assert covered.sum() > 50
    assert (thing.truth.before == -1).all() and thing.unseen.before[covered].mean() > 0.8
    assert (ground.truth.before[covered] == 0).all() and not ground.unseen.before[covered].any()
    assert ground.kinds == ("appeared",) and ground.uncounted.before == frozenset()
    np.testing.assert_array_equal(ground.truth.after, thing.truth.after)
    elsewhere = ground.truth.before == -1
    np.testing.assert_array_equal(ground.unseen.before[elsewhere], thing.unseen.before[elsewhere])


def test_the_registration_undoes_the_misregistration_and_motions_bring_objects_to_their_new_places(scene):
    np.testing.assert_allclose(scene.registration, np.linalg.inv(FRAME.misregistration), atol=1e-9)
    old = rigid_transform(translation=np.array([900.0, -50.0, 3.0])) @ np.array([*MOVED.centre, 1.0])
    expected = FRAME.placement @ FRAME.misregistration @ TURN @ np.array([*MOVED.centre, 1.0])
    np.testing.assert_allclose(scene.motions[2] @ old, expected, atol=1e-9)
    assert list(scene.motions) == [2]


def test_a_unit_changes_nothing_but_the_scale(recordings, scene):
    scaled = surveyed_scene(SOLIDS, recordings, dataclasses.replace(FRAME, unit=1000.0))
    for side in ("before", "after"):
        np.testing.assert_allclose(getattr(scaled.clouds, side), 1000 * getattr(scene.clouds, side), rtol=1e-12)
        np.testing.assert_array_equal(getattr(scaled.truth, side), getattr(scene.truth, side))
        np.testing.assert_array_equal(getattr(scaled.unseen, side), getattr(scene.unseen, side))
        views, expected = getattr(scaled.views, side), getattr(scene.views, side)
        np.testing.assert_allclose(views.poses[:, :3, 3], 1000 * expected.poses[:, :3, 3], rtol=1e-12)
        np.testing.assert_array_equal(views.poses[:, :3, :3], expected.poses[:, :3, :3])
        assert views.max_range == 1000 * expected.max_range
    np.testing.assert_allclose(scaled.motions[2][:3, 3], 1000 * scene.motions[2][:3, 3], rtol=1e-9)


def test_fusing_keeps_the_truth_of_most_points(recordings):
    whole, fused = recordings.before, recordings.before.fused(0.1)
    assert len(fused.points) < len(whole.points) / 2
    inside = (GONE.contains(fused.places, 0.01) | MOVED.contains(fused.places, 0.01)) & (fused.places[:, 2] > 0.12)
    assert inside.sum() > 20
    assert (fused.labels[inside] >= 0).all()
    np.testing.assert_allclose(fused.points, fused.places, atol=1e-9)
    assert len(whole.thinned(1000, np.random.default_rng(0)).points) == 1000
    assert len(whole.fused_to(5000).points) == pytest.approx(5000, rel=0.05)


def test_labels_with_gaps_are_refused(recordings):
    solids = SOLIDS.map(lambda side: [solid for solid in side if solid.label != 1])
    with pytest.raises(InputError, match=r"labels of changes are \[0, 2\]; number them from 0"):
        surveyed_scene(solids, recordings)


def test_a_survey_without_points_is_refused(recordings):
    empty = recordings.before.chosen(np.zeros(len(recordings.before.points), bool))
    with pytest.raises(InputError, match="recorded no point"):
        surveyed_scene(SOLIDS, Pair(empty, recordings.after))


def test_a_change_counts_with_forty_points_of_which_the_other_survey_sees_more_than_half():
    truth = np.repeat([-1, 0, 1, 2], [9, 40, 39, 40])
    unseen = (truth == 2) & (np.arange(len(truth)) % 2 == 0)
    assert uncounted([GONE, NEW, MOVED], truth, unseen) == {1, 2}


def test_frames_differ_in_unit_place_and_misregistration():
    frames = [Frame.drawn(np.random.default_rng(seed), shift=0.05, degrees=0.5) for seed in range(60)]
    assert len({frame.unit for frame in frames}) > 4
    for frame in frames:
        assert np.linalg.norm(frame.misregistration[:3, 3]) <= 0.05
        assert np.degrees(np.arccos((np.trace(frame.misregistration[:3, :3]) - 1) / 2)) <= 0.5
        np.testing.assert_allclose(frame.placement[:3, :3] @ frame.placement[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame.placement[:3, :3]) == pytest.approx(1)
