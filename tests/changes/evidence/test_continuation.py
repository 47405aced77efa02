import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.evidence.continuation import Continuation, ContinuationSettings
from gmmjax.changes.evidence.coverage_edge import CoverageEdgeSettings, ReferenceSurfaces
from gmmjax.clouds import SensorViews
from tests.changes.rooms import around, box, looking, scanned

SPACING = 0.015
TOLERANCE = 0.02
# A segment is what is this far from the other cloud.
REACH = 0.045
NOT_OBSERVED = 0.6
VIEWS = around(8)


def unobserved_shares(points, labels, unchanged, other, settings=ContinuationSettings(), tolerance=TOLERANCE):
    """The share of each segment's points that are unobserved."""
    reference = ReferenceSurfaces.of(points[unchanged], other, tolerance, SPACING)
    segments = [points[labels == label] for label in range(labels.max() + 1)]
    return np.array([Continuation(segment, reference, settings).unobserved.mean() for segment in segments])


def share(cloud, other, where, reach=REACH, **arguments):
    """The share of the one segment: the points of the box `where` that the other cloud has not."""
    distant = cKDTree(other).query(cloud)[0] > reach
    inside = ((cloud > where[0]) & (cloud < where[1])).all(axis=1)
    labels = np.where(distant & inside, 0, -1)
    assert (labels == 0).sum() > 20
    return unobserved_shares(cloud, labels, ~distant, other, **arguments)[0]


def room(*boxes, views=VIEWS, seed=0, noise=0.004):
    return scanned(views, boxes, noise=noise, seed=seed, voxel=0.012)


def grown(corners, by=0.02):
    return corners[0] - by, corners[1] + by


CARTON = box((0.1, 0.2, 0), (0.3, 0.25, 0.3))


@pytest.mark.parametrize(
    "thing",
    [
        CARTON,
        box((0.86, 0.1, 0), (0.25, 0.3, 0.4)),
        box((0.85, 0.85, 0), (0.28, 0.28, 0.3)),
        box((0.2, 0.1, 0), (0.5, 0.5, 0.1)),
    ],
    ids=["in the room", "against a wall", "in a corner", "flat"],
)
def test_an_object_is_no_continuation_but_what_it_hid_is(thing):
    full, empty = room(thing, seed=1), room(seed=2)
    assert share(full, empty, grown(thing)) < 0.3
    below = thing[0] - 0.02, np.array([*thing[1][:2] + 0.02, 0.02])
    assert share(empty, full, below) > 0.9


def test_the_lowest_part_of_an_object_passes_for_unchanged():
    """It is too near the floor to be told from it; the rest continues its sides, but the other cloud has none."""
    full, empty = room(CARTON, seed=1), room(seed=2)
    for reach in (0.06, 0.09, 0.12):
        assert share(full, empty, grown(CARTON), reach=reach) < 0.3


@pytest.mark.parametrize("thickness", [0.03, 0.05])
def test_thin_objects_are_no_continuation(thickness):
    """Thinner than what an unchanged surface may be apart; the other cloud has the table below it."""
    book = box((0.1, 0.1, 0), (0.3, 0.25, thickness))
    poster = (np.array([0.99 - thickness, -0.3, 0.5]), np.array([1.0, 0.3, 0.9]))
    for thing in (book, poster):
        full, empty = room(thing, seed=1, noise=0.002), room(seed=2, noise=0.002)
        assert share(full, empty, grown(thing), reach=0.8 * thickness, tolerance=thickness) < 0.3


def test_a_wall_seen_further_is_a_continuation():
    """One survey looked along the wall to the corner and round it, the other not so far."""
    full = room(seed=1)
    less = room(seed=2)
    less = less[~((less[:, 0] > 0.7) & (less[:, 1] > 0.2))]
    assert share(full, less, (np.full(3, -2.0), np.full(3, 2.0))) > 0.75


def test_a_whole_wall_that_the_other_survey_did_not_see():
    """No part of it is in both clouds; nothing that the other survey has is behind it."""
    some = SensorViews(VIEWS.poses[:5], VIEWS.field_of_view, VIEWS.max_range)
    full, less = room(CARTON, seed=1), room(CARTON, views=some, seed=2)
    less = less[less[:, 1] > -0.93]
    wall = np.array([-0.95, -1.1, 0.1]), np.array([0.95, -0.95, 1.6])
    assert share(full, less, wall) > 0.9
    # A thing that stands before the wall is still told from it.
    thing = box((0.0, -0.6, 0), (0.3, 0.25, 0.3))
    assert share(room(CARTON, thing, seed=1), less, grown(thing)) < 0.3


def test_a_roof_on_bare_ground_is_no_wall():
    """From above: only the top of the new box is seen, and nothing lies above it; but it hides the ground."""
    ground = (np.array([-9.0, -9.0, 0.0]), np.array([9.0, 9.0, 9.0]))
    above = SensorViews(looking((0, 0, 5.0), (0.01, 0, 0))[None], (50.0, 40.0), 8.0)
    new = box((0.2, 0.1, 0), (0.6, 0.5, 0.4))
    before, after = (
        scanned(above, boxes, room=ground, pixels=(320, 240), noise=0.001, seed=seed)
        for seed, boxes in ((1, []), (2, [new]))
    )
    assert share(after, before, grown(new)) < 0.3


def test_no_segments_and_nothing_to_compare_with():
    cloud = room(CARTON, seed=1)
    none = np.full(len(cloud), -1)
    everything = np.ones(len(cloud), bool)
    assert unobserved_shares(cloud, none, everything, cloud).shape == (0,)
    all_one = np.zeros(len(cloud), int)
    assert unobserved_shares(cloud, all_one, ~everything, cloud).tolist() == [0]
    assert unobserved_shares(cloud, all_one, everything, np.zeros((0, 3))).tolist() == [0]
    # Segments of one and of two points, far from everything.
    stray = np.concatenate([cloud, [[9, 9, 9.0], [9, 9, 9.01], [-9, 0, 0]]])
    labels = np.array([-1] * len(cloud) + [0, 0, 1])
    shares = unobserved_shares(stray, labels, labels < 0, cloud)
    assert ((shares >= 0) & (shares <= 1)).all()


@pytest.mark.slow
@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_motion_and_order_change_nothing(surveys, seed):
    full, empty, labels, unchanged = surveys
    generator = np.random.default_rng(seed)
    rotation, shift = Rotation.random(random_state=int(seed)).as_matrix(), generator.normal(0, 10, 3)
    order, others = generator.permutation(len(full)), generator.permutation(len(empty))
    here = unobserved_shares(full, labels, unchanged, empty)
    there = unobserved_shares(
        full[order] @ rotation.T + shift,
        labels[order],
        unchanged[order],
        empty[others] @ rotation.T + shift,
    )
    # The voxels lie otherwise.
    np.testing.assert_allclose(here, there, atol=0.15)
    assert ((here > NOT_OBSERVED) == (there > NOT_OBSERVED)).all()


@pytest.fixture(scope="module")
def surveys():
    """The carton as segment 0, the floor that came out where another box had been as segment 1."""
    gone = box((-0.4, -0.3, 0), (0.3, 0.3, 0.3))
    full, empty = room(CARTON, seed=1), room(gone, seed=2)
    distant = cKDTree(empty).query(full)[0] > REACH
    floor = full[:, 2] < 0.02
    labels = np.where(distant & ~floor, 0, np.where(distant, 1, -1))
    return full, empty, labels, ~distant


def test_each_segment_has_its_own_share(surveys):
    first, second = unobserved_shares(*surveys[:1], surveys[2], surveys[3], surveys[1])
    assert first < 0.3
    assert second > 0.9


def test_the_settings_reach_the_planes_and_the_edge_of_the_coverage(surveys):
    full, empty, labels, unchanged = surveys
    nothing_continues = ContinuationSettings(
        min_width=1e3, far_width=1e3, coverage_edge=CoverageEdgeSettings(max_occluded=-1.0)
    )
    shares = unobserved_shares(full, labels, unchanged, empty, nothing_continues)
    assert shares.tolist() == [0, 0]


def test_the_bare_floor_of_the_other_survey_shows_below_an_object(surveys):
    """And not below the floor that came out where a box had been: there the other survey has none."""
    full, empty, labels, unchanged = surveys
    reference = ReferenceSurfaces.of(full[unchanged], empty, TOLERANCE, SPACING)
    thing, floor = (Continuation(full[labels == label], reference) for label in (0, 1))
    assert thing.shown > 0.4
    assert floor.shown < 0.1


def test_the_bare_floor_shows_below_what_is_as_narrow_as_two_spacings():
    """The floor of its own cloud is within reach of all of it, on either side."""
    board = box((-0.2, 0.1, 0), (0.4, 2 * SPACING, 0.1))
    full, empty = room(board, seed=1, noise=0.002), room(seed=2, noise=0.002)
    lower, upper = grown(board, 0.005)
    inside = ((full > lower) & (full < upper) & (full[:, [2]] > 0.03)).all(axis=1)
    reference = ReferenceSurfaces.of(full[~inside], empty, 0.01, SPACING)
    assert Continuation(full[inside], reference).shown > 0.6
    # The floor itself, beside it, is bare in neither cloud.
    shift = np.array([0, 0.2, 0])
    beside = ((full > lower + shift) & (full < upper + shift)).all(axis=1)
    reference = ReferenceSurfaces.of(full[~beside & ~inside], empty, 0.01, SPACING)
    assert Continuation(full[beside], reference).shown < 0.2
    assert Continuation(full[inside], reference, ContinuationSettings(bare=0.0)).shown < 0.3
