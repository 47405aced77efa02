import numpy as np
import pytest

from gmmjax.changes.objects.cloud_changes import CloudChanges, change_of, merged, merged_rejected, rejected_of
from gmmjax.pair import Pair
from tests.changes.explained import explanation
from tests.changes.scanned_objects import box

EXTENT = (0.4, 0.3, 0.2)


def one_change(kind, probability, *, points=40, changed=slice(None)):
    """The changes of a cloud, some points of which are one change."""
    cloud = box(0, EXTENT)[:points]
    labels = np.full(points, -1)
    labels[changed] = 0
    own = np.where(labels == 0, probability, 0.0)
    return CloudChanges(own, labels, [change_of(cloud[labels == 0], kind, probability, 8.0)])


def test_a_change_has_the_moments_and_the_box_of_its_points():
    points = box(0, EXTENT)
    change = change_of(points, "appeared", 0.9, 7.0)
    assert (change.kind, change.probability, change.significance) == ("appeared", 0.9, 7.0)
    assert change.point_count == len(points) and change.partner is None
    np.testing.assert_allclose(change.mean, points.mean(axis=0))
    np.testing.assert_allclose(change.covariance, np.cov(points.T, bias=True))
    np.testing.assert_allclose(change.box.extent, EXTENT, atol=0.06)


def test_merging_sorts_by_probability_and_size():
    gone = one_change("disappeared", 0.6, points=80, changed=slice(40))
    new = one_change("appeared", 0.9, points=80, changed=slice(40, 80))
    items, labels = merged(Pair(gone, new))
    assert [item.kind for item in items] == ["appeared", "disappeared"]
    np.testing.assert_array_equal(labels.before, np.repeat([1, -1], 40))
    np.testing.assert_array_equal(labels.after, np.repeat([-1, 0], 40))
    # Of equally probable changes the larger one is first.
    large, small = one_change("disappeared", 0.6, points=80), one_change("appeared", 0.6, changed=slice(30))
    assert [item.kind for item in merged(Pair(large, small))[0]] == ["disappeared", "appeared"]
    assert [item.kind for item in merged(Pair(small, large))[0]] == ["disappeared", "appeared"]


def test_merging_nothing_gives_nothing():
    nothing = CloudChanges(np.zeros(80), np.full(80, -1), [])
    items, labels = merged(Pair(nothing, nothing))
    assert items == ()
    assert (labels.before == -1).all() and (labels.after == -1).all()


def test_a_confidence_lowers_points_and_changes_alike():
    own = one_change("appeared", 0.8, changed=slice(20))
    lowered = own.with_confidence(0.5)
    np.testing.assert_array_equal(lowered.probability, 0.5 * own.probability)
    assert lowered.items[0].probability == pytest.approx(0.4)
    np.testing.assert_array_equal(lowered.labels, own.labels)
    assert own.items[0].probability == 0.8


def test_a_rejected_candidate_has_the_verdict_and_the_box_of_its_points():
    points = box(0, EXTENT)
    unchanged = rejected_of(points, "appeared", explanation(0.2, 0.5))
    assert (unchanged.kind, unchanged.reason, unchanged.probability) == ("appeared", "unchanged", 0.2)
    assert unchanged.point_count == len(points)
    np.testing.assert_allclose(unchanged.mean, points.mean(axis=0))
    np.testing.assert_allclose(unchanged.box.extent, EXTENT, atol=0.06)
    assert rejected_of(points, "appeared", explanation(0.2, 0.3)).reason == "not observed"


def test_rejected_candidates_of_both_clouds_are_one_list_most_probable_and_largest_first():
    cloud = box(0, EXTENT)
    gone = [rejected_of(cloud[:count], "disappeared", explanation(share)) for count, share in ((20, 0.1), (30, 0.3))]
    new = [rejected_of(cloud[:count], "appeared", explanation(share)) for count, share in ((20, 0.2), (40, 0.3))]
    nothing = CloudChanges(np.zeros(80), np.full(80, -1), [])
    both = Pair(nothing._replace(rejected=tuple(gone)), nothing._replace(rejected=tuple(new)))
    found = merged_rejected(both)
    assert [(one.probability, one.point_count) for one in found] == [(0.3, 40), (0.3, 30), (0.2, 20), (0.1, 20)]
    lowered = both.before.with_confidence(0.5).rejected
    assert [one.probability for one in lowered] == [0.05, 0.15]
    assert lowered[0].explanation == gone[0].explanation
    assert both.before.none().rejected == ()
