import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.scenes import seen
from gmmjax.thesis.laboratory import THINGS, lab_cloud, lab_frames, lab_pair, laboratory_of, with_truth

BOX = THINGS.index("gear box")


@pytest.fixture(scope="module")
def localised(recordings):
    return with_truth(*(lab_cloud(recording, "localised") for recording in recordings))


def in_the_scene(cloud):
    return cloud.points @ cloud.to_scene[:3, :3].T + cloud.to_scene[:3, 3]


def test_the_truth_is_the_object_that_came(localised):
    assert localised.changes == {"gear box": "appeared"}
    assert (localised.truth_before == -1).all()
    assert set(np.unique(localised.truth_after)) == {-1, BOX}
    box = localised.after.laboratory.things["gear box"][0]
    places = in_the_scene(localised.after)
    assert box.contains(places[localised.truth_after == BOX], 0.06).mean() > 0.98
    assert not box.contains(places[localised.truth_after == -1], -0.06).any()
    assert localised.uncounted_before == localised.uncounted_after == frozenset()


def test_what_the_new_object_covers_is_unseen(localised):
    """The top of the bag where the box stands on it."""
    box = localised.after.laboratory.things["gear box"][0]
    places = in_the_scene(localised.before)
    under = box.contains(places, 0.0) & (places[:, 2] < 0.5)
    middle = np.linalg.norm((places - box.centre)[:, :2], axis=1) < 0.08
    # Pose noise lifts a few of the bag's points above the depth that the truth calls hidden.
    covered = np.abs(places[:, 2] - 0.42) < 0.01
    assert (middle & covered).sum() > 20
    assert under.sum() > 100
    hidden = ~seen(np.array([[*box.centre[:2], 0.38]]), localised.after.laboratory.solids, localised.after.views)
    assert hidden.all()


def test_a_volumetric_map_has_the_same_truth(recordings, open3d):
    pair = with_truth(*(lab_cloud(recording, "volumetric") for recording in recordings))
    box = pair.after.laboratory.things["gear box"][0]
    own = pair.truth_after == BOX
    assert own.sum() > 500
    assert box.contains(in_the_scene(pair.after)[own], 0.05).mean() > 0.98


def test_single_frames_are_of_something_that_changed():
    for seed in range(4):
        pair = lab_frames(("run5", "run4"), seed)
        assert pair.before.frame is not None and pair.after.frame is not None
        assert (pair.truth_after >= 0).sum() > 500
        assert (pair.truth_before == -1).all()
        apart = np.linalg.norm(pair.before.to_scene[:3, 3] - pair.after.to_scene[:3, 3])
        assert 0 < apart < 0.06
        # Objects that are out of the picture are not asked for.
        seen_objects = set(np.unique(pair.truth_after)) - {-1}
        changed = {THINGS.index(name) for name in pair.changes}
        assert changed - seen_objects <= pair.uncounted_after
        np.testing.assert_array_equal(lab_pair("frame", ("run5", "run4"), seed).after.points, pair.after.points)


def test_frames_back_are_the_frames_from_there():
    pair = lab_frames(("run1", "run5"), 0)
    assert set(pair.changes.values()) == {"disappeared"}
    assert (pair.truth_after == -1).all() and (pair.truth_before >= 0).any()


def test_an_unknown_kind_is_named(as_users):
    with pytest.raises(InputError, match=r"kind='mesh' is unknown; choose from frame, volumetric, localised"):
        lab_pair("mesh", ("run5", "run1"), 0)


def test_the_room_is_the_laboratorys():
    assert lab_frames(("run5", "run5"), 0).changes == {}
    assert laboratory_of("run5", 0).objects == {}
