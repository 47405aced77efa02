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
from tests.batch.made_comparisons import EXTENT, BoxAt, chain, compared, frames, star
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


def one(places, make=chain, **options):
    """The history of a single box, its comparisons made by `chain` or `star`."""
    histories = object_histories([f"e{epoch}" for epoch in range(len(places))], make([BoxAt(places)], **options))
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


@pytest.mark.parametrize("make", [chain, star])
def test_what_stays_away_and_what_is_there_from_the_start(make):
    assert one((HERE, HERE, None, None), make).presence == (True, True, False, False)
    assert one((None, None, HERE, HERE), make).presence == (False, False, True, True)


def test_against_the_first_epoch_the_want_of_a_change_is_an_event():
    history = one((None, None, HERE, HERE, HERE, None, None), star)
    came, went = history.events
    assert (came.kind, came.epoch, came.previous, came.comparison) == ("came", 2, 1, Pair(0, 2))
    assert (went.kind, went.epoch, went.change, went.overlap) == ("went", 5, None, None)
    assert went.comparison == Pair(0, 5)
    assert went.probability == 0.9
    np.testing.assert_allclose(went.box.centre, [0.5, 0.0, EXTENT[2] / 2], atol=0.02)


def test_against_the_first_epoch_an_object_of_it_moves_and_returns():
    moved, again, back = one((HERE, THERE, THERE, FAR, HERE), star).events
    assert [(event.kind, event.epoch) for event in (moved, again, back)] == [("moved", 1), ("moved", 3), ("moved", 4)]
    assert moved.distance == pytest.approx(np.hypot(1.5, 0.7), abs=0.02)
    assert again.distance == pytest.approx(np.hypot(3.0, 1.7), abs=0.02)
    assert back.distance == pytest.approx(np.hypot(1.5, 1.0), abs=0.02)
    assert back.change is None


def test_against_the_first_epoch_a_move_that_is_not_recognised_once_parts_no_object():
    """In its place of yesterday it is itself, however today's comparison calls it."""
    frame = frames(3)
    places = (HERE, THERE, THERE)
    comparisons = [compared([BoxAt(places)], 0, 1, frame), compared([BoxAt(places, moves_seen=False)], 0, 2, frame)]
    (history,) = object_histories(EPOCHS[:3], comparisons)
    assert story([history]) == [(("moved", 1),)]
    assert history.presence == (True, True, True)


def test_a_move_that_is_not_recognised_is_two_objects():
    places = (None, HERE, THERE)
    histories = object_histories(EPOCHS[:3], chain([BoxAt(places, moves_seen=False)]))
    assert story(histories) == [(("came", 1), ("went", 2)), (("came", 2),)]


@pytest.mark.parametrize("make", [chain, star])
@pytest.mark.parametrize("places", [(HERE, None, None, HERE), (None, HERE, None, HERE)])
def test_what_returns_to_its_place_in_its_shape_is_the_same_object(make, places):
    history = one(places, make)
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


def test_what_was_not_observed_is_not_gone():
    """Against the first epoch, the object's place is out of sight in the third survey, and in the fifth it is gone."""
    frame = frames(6)
    things = [BoxAt((None, HERE, HERE, HERE, HERE, None))]
    comparisons = [compared(things, 0, epoch, frame, hidden=(0.0, 1.0) if epoch == 3 else ()) for epoch in range(1, 6)]
    (history,) = object_histories([f"e{epoch}" for epoch in range(6)], comparisons)
    assert history.presence == (False, True, True, None, True, False)
    assert story([history]) == [(("came", 1), ("went", 5))]


def test_an_object_that_was_out_of_sight_is_itself_seen_from_another_side():
    """Its shape alone would not tell: what returns has most of the points of both."""
    frame, places = frames(4), (None, HERE, HERE, HERE)
    comparisons = [
        compared([BoxAt(places)], 0, epoch, frame, hidden=(0.0, 1.0) if epoch == 2 else ()) for epoch in (1, 2, 3)
    ]
    (points,) = comparisons[2].points
    comparisons[2] = dataclasses.replace(comparisons[2], points=(points[: len(points) // 3],))
    (history,) = object_histories(EPOCHS[:4], comparisons)
    assert history.presence == (False, True, None, True)


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


@pytest.mark.parametrize("make", [chain, star])
@given(seed=st.integers(0, 1000))
@settings(max_examples=5, deadline=None)
def test_neither_the_order_of_the_comparisons_nor_the_numbers_of_the_changes_matter(make, seed):
    random = np.random.default_rng(seed)
    expected = object_histories(EPOCHS, make(THINGS))
    comparisons = make(THINGS, order=random.permutation(8))
    found = object_histories(EPOCHS, [comparisons[index] for index in random.permutation(len(comparisons))])
    for own, other in zip(expected, found, strict=True):
        assert own.presence == other.presence
        for event, same in zip(own.events, other.events, strict=True):
            np.testing.assert_array_equal(event.box.centre, same.box.centre)
            assert _but_for_numbers(event) == _but_for_numbers(same)


def _but_for_numbers(event):
    """All but the boxes, and the index of the change."""
    return {name: value for name, value in vars(event).items() if name not in ("box", "origin", "change")}


@pytest.mark.parametrize("make", [chain, star])
@given(angle=st.floats(-3, 3), shift=st.tuples(*[st.floats(-50, 50)] * 3))
@settings(max_examples=5, deadline=None)
def test_a_rigid_motion_of_the_series_moves_the_histories(make, angle, shift):
    world = motion(angle, shift)
    frame = frames(5)
    expected = object_histories(EPOCHS, make(THINGS, frame))
    found = object_histories(EPOCHS, make(THINGS, [world @ own for own in frame]))
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
    assert [(row.object, row.event, row.kind, row.epoch, row.previous) for row in rows[:4]] == [
        (1, 0, "came", "Tue", "Mon"),
        (1, 1, "moved", "Thu", "Wed"),
        (1, 2, "went", "Fri", "Thu"),
        (2, 0, "moved", "Tue", "Mon"),
    ]
    assert (rows[1].before, rows[1].after, rows[1].frame, rows[1].epoch_index) == ("Wed", "Thu", "Mon", 3)
    assert rows[1].distance == pytest.approx(np.hypot(1.5, 0.7), abs=0.02)
    assert [rows[0].centre_x, rows[0].centre_y, rows[0].extent_1] == pytest.approx([0.5, 0.0, 0.4], abs=0.03)


def test_nothing_changed():
    still = [BoxAt((HERE,) * 3)]
    assert object_histories(EPOCHS[:3], chain(still)) == []
    assert object_histories(EPOCHS[:3], []) == []
    assert object_histories([], []) == []
    assert object_rows([]) == []


def test_trees_of_epochs():
    trees = epoch_trees(list("abcdef"), [Pair(0, 1), Pair(1, 3), Pair(4, 5)])
    assert [(tree.root, tree.epochs) for tree in trees] == [(0, (0, 1, 3)), (2, (2,)), (4, (4, 5))]
    assert trees[0].parents == {1: 0, 3: 1}


def test_bad_input():
    comparison = chain([BoxAt((None, HERE))])[0]
    with pytest.raises(InputError, match="not the indices of an earlier and a later one of 1 epochs"):
        object_histories(["Mon"], [comparison])
    with pytest.raises(InputError, match="'Wed' is compared with 'Mon' and with 'Tue'; give one"):
        object_histories(EPOCHS, [dataclasses.replace(comparison, epochs=Pair(before, 2)) for before in (0, 1)])


@pytest.mark.slow
def test_the_truth_is_recovered_from_detections():
    """Three simulated surveys, against the previous and against the first: things that came, moved and went."""
    scene = series(8, epochs=3, things=5, voxel=0.032)
    found = {}
    for epochs in (Pair(0, 1), Pair(1, 2), Pair(0, 2)):
        clouds = epochs.map(lambda epoch: scene.clouds[epoch])
        found[epochs.before, epochs.after] = Comparison.of(*epochs, detect_changes(*clouds, restarts=1), clouds)
    for against, pairs in (("previous", [(0, 1), (1, 2)]), ("first", [(0, 1), (0, 2)])):
        histories = object_histories(EPOCHS[:3], [found[pair] for pair in pairs])
        assert sorted(scene.told(history) for history in histories) == sorted(scene.truth(against))
    assert {kind for _, events in scene.truth() for kind, _ in events} == {"came", "moved", "went"}
