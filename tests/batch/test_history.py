import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax import detect_changes
from gmmjax.batch import Comparison, epoch_trees, object_histories, object_rows
from gmmjax.changes import Registration
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.pair import Pair
from tests.batch.made_comparisons import EXTENT, BoxAt, chain, compared, frames
from tests.batch.series_scenes import series
from tests.changes.scanned_objects import motion

HERE, THERE, FAR = (0.5, 0.0, 0.3), (-1.0, 0.7, 1.2), (2.0, -1.0, 0.0)
# Came, moved, went; was there and went; came and stayed; was there and moved twice.
THINGS = (
    BoxAt((None, HERE, HERE, THERE, None)),
    BoxAt((FAR, FAR, None, None, None), (0.3, 0.3, 0.5)),
    BoxAt((None, None, None, HERE, HERE), (0.5, 0.4, 0.3)),
    BoxAt(((-2.0, -2.0, 0.0), (-2.0, -1.0, 0.0), (-2.0, -1.0, 0.0), (-2.0, 1.0, 0.5), (-2.0, 1.0, 0.5))),
)
EPOCHS = ("Mon", "Tue", "Wed", "Thu", "Fri")


def story(histories):
    """What happened to each object, in no order."""
    return sorted(tuple((event.kind, event.epoch) for event in history.events) for history in histories)


def one(places):
    """The history of a single box."""
    histories = object_histories([f"e{epoch}" for epoch in range(len(places))], chain([BoxAt(places)]))
    assert len(histories) == 1
    return histories[0]


def test_each_object_has_its_history():
    histories = object_histories(EPOCHS, chain(THINGS))
    assert [[(event.kind, event.epoch) for event in history.events] for history in histories] == [
        [("came", 1), ("moved", 3), ("went", 4)],
        [("moved", 1), ("moved", 3)],
        [("went", 2)],
        [("came", 3)],
    ]
    assert [history.presence for history in histories] == [
        (False, True, True, True, False),
        (True,) * 5,
        (True, True, False, False, False),
        (False, False, False, True, True),
    ]
    assert [history.number for history in histories] == [1, 2, 3, 4]


def test_coordinates_are_in_the_frame_of_the_first_epoch():
    came, moved, went = object_histories(EPOCHS, chain(THINGS))[0].events
    np.testing.assert_allclose(came.box.centre, [0.5, 0.0, EXTENT[2] / 2], atol=0.02)
    np.testing.assert_allclose(moved.origin.centre, came.box.centre)
    np.testing.assert_allclose(moved.box.centre, [-1.0, 0.7, EXTENT[2] / 2], atol=0.02)
    np.testing.assert_allclose(went.box.centre, [-1.0, 0.7, EXTENT[2] / 2], atol=0.02)
    assert moved.distance == pytest.approx(np.hypot(1.5, 0.7), abs=0.02)
    np.testing.assert_allclose(went.box.extent, EXTENT, atol=0.06)


def test_an_event_tells_the_change_that_shows_it():
    came, moved, went = object_histories(EPOCHS, chain(THINGS))[0].events
    assert (came.probability, came.overlap, came.moved_probability) == (0.9, 1.0, None)
    assert (moved.moved_probability, moved.comparison, moved.change) == (0.8, Pair(2, 3), 1)
    assert went.comparison == Pair(3, 4)
    assert went.overlap > 0.9
    assert came.point_count > 100


def test_what_stays_away_and_what_is_there_from_the_start():
    assert one((HERE, HERE, None, None)).presence == (True, True, False, False)
    assert one((None, None, HERE, HERE)).presence == (False, False, True, True)


def test_a_move_that_is_not_recognised_is_two_objects():
    places = (None, HERE, THERE)
    histories = object_histories(EPOCHS[:3], chain([BoxAt(places, moves_seen=False)]))
    assert story(histories) == [(("came", 1), ("went", 2)), (("came", 2),)]


@pytest.mark.parametrize("places", [(HERE, None, None, HERE), (None, HERE, None, HERE)])
def test_what_returns_to_its_place_in_its_shape_is_the_same_object(places):
    history = one(places)
    assert [event.kind for event in history.events][-2:] == ["went", "came"]
    assert [event.returned for event in history.events if event.kind == "came"][-1]
    assert history.events[-1].epoch == 3


def test_what_comes_in_another_shape_is_another_object():
    things = [BoxAt((HERE, None, None)), BoxAt((None, None, HERE), (0.2, 0.2, 0.6))]
    histories = object_histories(EPOCHS[:3], chain(things))
    assert story(histories) == [(("came", 2),), (("went", 1),)]
    assert not any(event.returned for history in histories for event in history.events)


def test_an_epoch_that_failed_leaves_open_when_it_happened():
    frame = frames(5)
    things = [BoxAt((None, HERE, HERE, HERE, HERE)), BoxAt((*[(0.5, 2.0, 0.0)] * 3, None, None))]
    comparisons = [compared(things, *pair, frame) for pair in ((0, 1), (1, 3), (3, 4))]
    came, went = object_histories(EPOCHS, comparisons)
    assert came.presence == (False, True, None, True, True)
    assert (went.events[0].previous, went.events[0].epoch) == (1, 3)
    assert went.presence == (True, True, None, False, False)


def test_nothing_is_linked_across_a_gap_that_no_comparison_bridges():
    frame = frames(5)
    things = [BoxAt((None, HERE, HERE, HERE, None))]
    comparisons = [compared(things, *pair, frame) for pair in ((0, 1), (1, 2), (3, 4))]
    came, went = object_histories(EPOCHS, comparisons)
    assert (came.frame, came.presence) == (0, (False, True, True, None, None))
    assert (went.frame, went.presence) == (3, (None, None, None, True, False))
    np.testing.assert_allclose(
        went.events[0].box.centre, transformed(np.array([[0.5, 0.0, EXTENT[2] / 2]]), frame[3])[0], atol=0.02
    )


def test_after_it_was_out_of_sight_an_object_is_known_again_where_a_change_shows_it():
    frame = frames(6)
    for last, presence in (
        (None, (False, True, None, True, True, False)),
        (HERE, (False, True, None, None, None, None)),
    ):
        things = [BoxAt((None, HERE, HERE, HERE, HERE, last))]
        comparisons = [
            compared(things, epoch - 1, epoch, frame, hidden=(0.0, 1.0) if epoch == 2 else ()) for epoch in range(1, 6)
        ]
        (history,) = object_histories([f"e{epoch}" for epoch in range(6)], comparisons)
        assert history.presence == presence


def test_a_missed_change_leaves_open_when_it_happened():
    """The object went in the third epoch, unnoticed, and came again in the fifth."""
    frame, box = frames(5), (None, HERE, HERE, None, HERE)
    comparisons = chain([BoxAt(box)], frame)
    comparisons[2] = dataclasses.replace(comparisons[2], changes=(), points=(), sides=())
    (history,) = object_histories(EPOCHS, comparisons)
    assert [(event.kind, event.previous, event.epoch) for event in history.events] == [
        ("came", 0, 1),
        ("went", 1, 3),
        ("came", 3, 4),
    ]
    assert history.presence == (False, True, None, False, True)


def test_an_object_found_in_two_pieces_is_one():
    """It came as one change and went as two, the smaller of which is a tenth of it."""
    comparisons = chain([BoxAt((None, HERE, None))])
    (points,), (change,) = comparisons[1].points, comparisons[1].changes
    cut = len(points) // 10
    comparisons[1] = dataclasses.replace(
        comparisons[1], changes=(change, change), points=(points[:cut], points[cut:]), sides=(0, 0)
    )
    (history,) = object_histories(EPOCHS[:3], comparisons)
    assert story([history]) == [(("came", 1), ("went", 2))]
    assert history.events[1].change == 1


@pytest.mark.parametrize(("shift", "objects"), [(0.5, 1), (0.95, 2)])
def test_places_are_one_where_most_points_of_one_lie_at_the_other(shift, objects):
    """The change that shows that it went is off along its longest edge, by a half and by nearly all of it."""
    comparisons = chain([BoxAt((None, HERE, None))], [np.eye(4)] * 3)
    (points,) = comparisons[1].points
    along = shift * EXTENT[0] * np.array([np.cos(HERE[2]), np.sin(HERE[2]), 0.0])
    comparisons[1] = dataclasses.replace(comparisons[1], points=(points + along,))
    assert len(object_histories(EPOCHS[:3], comparisons)) == objects


def test_things_that_touch_and_go_as_one_have_both_gone():
    beside = (0.5, 0.5, 0.3)
    things = [BoxAt((None, HERE, HERE, None)), BoxAt((None, None, beside, None))]
    comparisons = chain(things)
    together = comparisons[2]
    comparisons[2] = dataclasses.replace(
        together, changes=together.changes[:1], points=(np.concatenate(together.points),), sides=(0,)
    )
    histories = object_histories(EPOCHS[:4], comparisons)
    assert story(histories) == [(("came", 1), ("went", 3)), (("came", 2), ("went", 3))]


@given(seed=st.integers(0, 1000))
@settings(max_examples=5, deadline=None)
def test_neither_the_order_of_the_comparisons_nor_the_numbers_of_the_changes_matter(seed):
    random = np.random.default_rng(seed)
    expected = object_histories(EPOCHS, chain(THINGS))
    comparisons = chain(THINGS, order=random.permutation(8))
    found = object_histories(EPOCHS, [comparisons[index] for index in random.permutation(len(comparisons))])
    for own, other in zip(expected, found, strict=True):
        assert own.presence == other.presence
        for event, same in zip(own.events, other.events, strict=True):
            np.testing.assert_array_equal(event.box.centre, same.box.centre)
            assert _but_for_numbers(event) == _but_for_numbers(same)


def _but_for_numbers(event):
    """All but the boxes, and the index of the change."""
    return {name: value for name, value in vars(event).items() if name not in ("box", "origin", "change")}


@given(angle=st.floats(-3, 3), shift=st.tuples(*[st.floats(-50, 50)] * 3))
@settings(max_examples=5, deadline=None)
def test_a_rigid_motion_of_the_series_moves_the_histories(angle, shift):
    world = motion(angle, shift)
    frame = frames(5)
    expected = object_histories(EPOCHS, chain(THINGS, frame))
    found = object_histories(EPOCHS, chain(THINGS, [world @ own for own in frame]))
    for own, other in zip(expected, found, strict=True):
        assert own.presence == other.presence
        for event, same in zip(own.events, other.events, strict=True):
            np.testing.assert_allclose(transformed(event.box.centre[None], world)[0], same.box.centre, atol=1e-6)
            assert (event.kind, event.epoch, event.change) == (same.kind, same.epoch, same.change)
            assert event.distance == pytest.approx(same.distance, abs=1e-6)


def test_an_after_cloud_that_was_not_registered_is_in_the_frame_of_the_before_cloud():
    comparisons = chain([BoxAt((None, HERE, None))], [np.eye(4)] * 3)
    left_alone = Registration(motion(0.5, [9, 9, 9]), applied=False)
    comparisons = [dataclasses.replace(one, registration=left_alone) for one in comparisons]
    assert story(object_histories(EPOCHS[:3], comparisons)) == [(("came", 1), ("went", 2))]


def test_rows_of_the_table():
    rows = object_rows(object_histories(EPOCHS, chain(THINGS)))
    assert [tuple(row.values())[:5] for row in rows[:4]] == [
        (1, 0, "came", "Tue", "Mon"),
        (1, 1, "moved", "Thu", "Wed"),
        (1, 2, "went", "Fri", "Thu"),
        (2, 0, "moved", "Tue", "Mon"),
    ]
    assert tuple(rows[1][name] for name in ("before", "after", "frame", "epoch_index")) == ("Wed", "Thu", "Mon", 3)
    assert rows[1]["distance"] == pytest.approx(np.hypot(1.5, 0.7), abs=0.02)
    assert [rows[0][name] for name in ("centre_x", "centre_y", "extent_1")] == pytest.approx([0.5, 0.0, 0.4], abs=0.03)


def test_nothing_changed():
    still = [BoxAt((HERE,) * 3)]
    assert object_histories(EPOCHS[:3], chain(still)) == []
    assert object_histories(EPOCHS[:3], []) == []
    assert object_histories([], []) == []
    assert object_rows([]) == []


def test_trees_of_epochs():
    trees = epoch_trees(list("abcdef"), [Pair(0, 1), Pair(1, 3), Pair(4, 5)])
    assert [(tree.root, tree.epochs) for tree in trees] == [(0, (0, 1, 3)), (2, (2,)), (4, (4, 5))]


def test_bad_input():
    comparison = chain([BoxAt((None, HERE))])[0]
    with pytest.raises(InputError, match="not the indices of an earlier and a later one of 1 epochs"):
        object_histories(["Mon"], [comparison])
    for pairs, twice in (([(0, 2), (1, 2)], "'Wed' .* earlier"), ([(0, 1), (0, 2)], "'Mon' .* later")):
        given = [dataclasses.replace(comparison, epochs=Pair(*pair)) for pair in pairs]
        with pytest.raises(InputError, match=f"epoch {twice} ones; give one comparison of each epoch with the one"):
            object_histories(EPOCHS, given)


@pytest.mark.slow
def test_the_truth_is_recovered_from_detections():
    """Three simulated surveys, in which things came, moved and went."""
    scene, found = series(8, epochs=3, things=5, voxel=0.032), []
    for epochs in (Pair(0, 1), Pair(1, 2)):
        clouds = epochs.map(lambda epoch: scene.clouds[epoch])
        found.append(Comparison.of(*epochs, detect_changes(*clouds, restarts=1), clouds))
    histories = object_histories(EPOCHS[:3], found)
    assert sorted(scene.told(history) for history in histories) == sorted(scene.truth())
    assert {kind for _, events in scene.truth() for kind, _ in events} == {"came", "moved", "went"}
