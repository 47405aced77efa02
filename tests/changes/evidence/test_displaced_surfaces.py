"""Both places of displaced surfaces."""

import dataclasses

import numpy as np
import pytest

from gmmjax.changes.evidence.displaced_surfaces import pair_displaced_surfaces
from gmmjax.changes.evidence.examination import Examined
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.explanation import Explanation
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair, each
from tests.changes.evidence.floors import FROM_ABOVE, LIMITS, SPACING, candidates_of, cube, in_square, plane

CENTRE, EDGE, DEPTH = np.array([1.0, 1.0]), 0.6, 0.75 * SPACING
CHANGE, NONE = Explanation(0.8, 0.15, 0.05, ()), Explanation(0.2, 0.7, 0.1, ())


def eroded(seed):
    """A floor of which a square was lowered by less than the spacing of its points."""
    floor = plane((0, 0), (2, 2), 0.0, seed)
    floor[in_square(floor, CENTRE, EDGE), 2] -= DEPTH
    return floor


def examined(candidate, change):
    """One candidate: a change, or rejected, with all of its points not observed."""
    none = np.zeros(len(candidate), bool)
    labels = np.where(candidate & change, 0, -1)
    probability, rejected = np.array([CHANGE.changed] * int(change)), ((np.flatnonzero(candidate), NONE),)
    shown = (CHANGE,) * int(change)
    return Examined(labels, probability, none * 1.0, none if change else candidate, shown, () if change else rejected)


def both_places(points, candidates, changes, views=None, seen_from=None, **settings):
    own = each(lambda cloud, rows: candidates_of(cloud, np.where(rows, 0, -1)), points, candidates)
    found = each(examined, candidates, changes)
    surveys = points.map(lambda cloud: dataclasses.replace(ScanVisibility.of(cloud, views), seen_from=seen_from))
    return found, pair_displaced_surfaces(found, own, surveys, LIMITS, **settings)


def wider_than_displaced(points, told):
    """Candidates: of the cloud that tells the change what was displaced, of the other one more than that."""
    return each(lambda cloud, change: in_square(cloud, CENTRE, EDGE if change else 2 * EDGE), points, told)


@pytest.fixture(scope="module", params=["before", "after"])
def told_by(request):
    """Which cloud has the lower ground and tells the change, the floors, and their candidates."""
    told = Pair(request.param == "before", request.param == "after")
    points = told.map(lambda lower: eroded(1) if lower else plane((0, 0), (2, 2), 0.0))
    return points, wider_than_displaced(points, told), told


@pytest.mark.parametrize("views", [None, FROM_ABOVE])
def test_what_is_behind_a_displaced_surface_is_hidden(told_by, views):
    points, _, told = told_by
    # The upper ground tells the change: what is below it may be there still.
    upper = told.swapped
    found, shown = both_places(points, wider_than_displaced(points, upper), upper, views)
    for old, new in zip(found, shown, strict=True):
        np.testing.assert_array_equal(new.labels, old.labels)


def test_the_front_is_the_side_of_the_sensor(told_by):
    points, _, told = told_by
    from_below = SensorViews.from_positions(points.before, [(1.0, 1.0, -2.0)])
    upper = told.swapped
    _, shown = both_places(points, wider_than_displaced(points, upper), upper, from_below)
    assert [len(own.probability) for own in shown] == [1, 1]


def test_what_one_cloud_tells_is_a_change_in_both(told_by):
    points, candidates, told = told_by
    found, shown = both_places(points, candidates, told)
    for cloud, tells, old, new in zip(points, told, found, shown, strict=True):
        if tells:
            np.testing.assert_array_equal(new.labels, old.labels)
            continue
        place = in_square(cloud, CENTRE, EDGE)
        assert (new.labels[place] == 0).mean() > 0.95
        assert (new.labels[~in_square(cloud, CENTRE, EDGE + 4 * SPACING)] == -1).all()
        # One event has one probability and one reason; what is left of the candidate is rejected as it was.
        np.testing.assert_array_equal(new.probability, [CHANGE.changed])
        assert new.explanations == (CHANGE,)
        ((rows, why),) = new.rejected
        assert why is NONE
        np.testing.assert_array_equal(np.sort(rows), np.flatnonzero((old.unobserved) & (new.labels < 0)))
        np.testing.assert_array_equal(new.unobserved, old.unobserved & (new.labels < 0))


def test_upside_down_and_seen_from_below_it_is_the_same(told_by):
    """Where no views are known, but the side that the surfaces are seen from is."""
    points, candidates, told = told_by
    _, expected = both_places(*told_by)
    turned = points.map(lambda cloud: cloud * [1, 1, -1])
    below = np.array([[1.0, 1.0, -3.0]])
    _, shown = both_places(turned, candidates, told, seen_from=below)
    for one, other in zip(expected, shown, strict=True):
        np.testing.assert_array_equal(one.labels, other.labels)


def test_a_place_of_fewer_points_is_none(told_by):
    found, shown = both_places(*told_by, smallest=10_000)
    for old, new in zip(found, shown, strict=True):
        np.testing.assert_array_equal(new.labels, old.labels)


def test_a_change_of_the_other_cloud_keeps_its_points(told_by):
    points, candidates, _ = told_by
    _, shown = both_places(points, candidates, Pair(True, True))
    for rows, new in zip(candidates, shown, strict=True):
        np.testing.assert_array_equal(new.labels, np.where(rows, 0, -1))
        assert len(new.probability) == 1


def test_the_floor_below_an_object_is_no_place_of_it():
    floor = plane((0, 0), (2, 2), 0.0)
    points = Pair(floor, np.concatenate([floor[~in_square(floor, CENTRE, 0.3)], cube(CENTRE, 0.3)]))
    candidates = Pair(in_square(floor, CENTRE, 0.3), points.after[:, 2] > 0.01)
    found, shown = both_places(points, candidates, Pair(False, True))
    np.testing.assert_array_equal(shown.before.labels, found.before.labels)
    assert shown.before.rejected == found.before.rejected


def test_a_change_that_is_mostly_an_object_is_no_displaced_surface():
    floor, lower = plane((0, 0), (2, 2), 0.0), plane((0.8, 0.8), (1.2, 1.2), -DEPTH)
    rest = floor[~in_square(floor, CENTRE, 0.4)]
    points = Pair(floor, np.concatenate([rest, lower, cube(CENTRE, 0.3)]))
    candidates = Pair(in_square(floor, CENTRE, 0.4), np.arange(len(points.after)) >= len(rest))
    found, shown = both_places(points, candidates, Pair(False, True))
    np.testing.assert_array_equal(shown.before.labels, found.before.labels)
