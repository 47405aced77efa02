import numpy as np
import pytest

from gmmjax import DetectionConfig
from gmmjax.changes.objects.cloud_changes import CloudChanges, change_of
from gmmjax.changes.objects.pair_changes import PairChanges
from gmmjax.changes.prepare.checking import CheckedCloud
from gmmjax.pair import Pair
from tests.changes.explained import rejected

POINTS = np.random.default_rng(0).normal(size=(30, 3))


def cloud_changes(kind, probability):
    """The first twenty of thirty points are a change."""
    labels = np.repeat([0, -1], [20, 10])
    return CloudChanges(
        np.where(labels == 0, probability, 0.1), labels, [change_of(POINTS[:20], kind, probability, 8.0)]
    )


@pytest.fixture
def found():
    """A disappeared and a more probable appeared change; the last points were not observed."""
    unobserved = np.repeat([False, True], [25, 5])
    changes = Pair(cloud_changes("disappeared", 0.6), cloud_changes("appeared", 0.9))
    return PairChanges(changes, Pair(unobserved, ~unobserved))


@pytest.mark.parametrize("kinds", ["disappeared", "appeared"])
def test_changes_of_the_kind_that_is_not_looked_for_are_left_out(found, kinds):
    kept = found.of_kinds(kinds)
    items, labels = kept.merged()
    assert [item.kind for item in items] == [kinds]
    own, other = (labels.before, labels.after) if kinds == "disappeared" else (labels.after, labels.before)
    np.testing.assert_array_equal(own, np.repeat([0, -1], [20, 10]))
    assert (other == -1).all()
    without = kept.changes.after if kinds == "disappeared" else kept.changes.before
    assert not without.probability.any()


def test_both_kinds_are_kept(found):
    assert [item.kind for item in found.of_kinds("both").merged()[0]] == ["appeared", "disappeared"]


def test_confidence_multiplies_all_probabilities(found):
    lowered = found.with_confidence(0.5)
    for own, given in zip(lowered.changes, found.changes, strict=True):
        np.testing.assert_allclose(own.probability, 0.5 * given.probability)
        assert own.items[0].probability == pytest.approx(0.5 * given.items[0].probability)
        np.testing.assert_array_equal(own.labels, given.labels)
    np.testing.assert_array_equal(
        found.with_confidence(1.0).changes.before.probability, found.changes.before.probability
    )


def test_merged_labels_refer_to_the_list_with_the_most_probable_first(found):
    items, labels = found.merged()
    assert [item.probability for item in items] == [0.9, 0.6]
    np.testing.assert_array_equal(labels.before, np.repeat([1, -1], [20, 10]))
    np.testing.assert_array_equal(labels.after, np.repeat([0, -1], [20, 10]))


def test_every_row_that_was_given_has_a_value(found):
    """Of 34 rows before the last four are not used; those after are used in reverse order."""
    clouds = Pair(
        CheckedCloud(POINTS, np.arange(30), given=34, cropped=4),
        CheckedCloud(POINTS, np.arange(30)[::-1], given=30, cropped=0),
    )
    items, labels = found.merged()
    with_rejected = found.changes.after._replace(rejected=(rejected("appeared"),))
    found = found._replace(changes=Pair(found.changes.before, with_rejected))
    changes = found.record(clouds, items, labels, 0.25, DetectionConfig(), {"spacing": 0.1})
    np.testing.assert_array_equal(changes.labels_before, np.repeat([1, -1], [20, 14]))
    np.testing.assert_array_equal(changes.labels_after, np.repeat([-1, 0], [10, 20]))
    np.testing.assert_array_equal(changes.probability_before, np.repeat([0.6, 0.1, 0.0], [20, 10, 4]))
    np.testing.assert_array_equal(changes.probability_after, np.repeat([0.1, 0.9], [10, 20]))
    np.testing.assert_array_equal(changes.unobserved_before, np.repeat([False, True, False], [25, 5, 4]))
    np.testing.assert_array_equal(changes.unobserved_after, np.repeat([False, True], [5, 25]))
    assert changes.items == items and changes.emd == 0.25 and changes.diagnostics == {"spacing": 0.1}
    assert [one.kind for one in changes.rejected] == ["appeared"]
    assert found.of_kinds("disappeared").record(clouds, (), labels, 0.0, DetectionConfig(), {}).rejected == ()
    assert not changes.registration.applied


def test_points_that_joined_a_change_have_its_probability_and_were_observed(found):
    items, labels = found.merged()
    grown = labels.map(np.copy)
    grown.before[20:27] = 1
    changes = found.grown_to(items, grown)
    np.testing.assert_array_equal(changes.changes.before.probability, np.repeat([0.6, 0.1], [27, 3]))
    np.testing.assert_array_equal(changes.changes.after.probability, found.changes.after.probability)
    np.testing.assert_array_equal(changes.unobserved.before, np.repeat([False, True], [27, 3]))
