import dataclasses

import numpy as np
import pytest

from gmmjax import DetectionConfig, detect_changes
from gmmjax.changes.candidates import Candidates
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.detectors.joint import JointDetector
from gmmjax.changes.differences import DetectionLimits, DifferenceSettings, LocalDifference
from gmmjax.changes.evidence.examination import (
    EvidenceSettings,
    Examined,
    continuing,
    examined,
    hidden_parts,
    not_seen_empty,
    renumbered,
    unexamined,
    without_evidence,
)
from gmmjax.changes.evidence.free_space import Observed, Survey
from gmmjax.changes.evidence.view_checks import ViewCheckSettings
from gmmjax.clouds import SensorViews
from gmmjax.errors import InputWarning
from gmmjax.evaluation import score_pair
from gmmjax.pair import Pair
from tests.changes.rooms import around, box, scanned

CONFIG = DetectionConfig(restarts=1)
SETTINGS = {"voxel": 0.012, "noise": 0.004}
STAYING = [box((0.2, 0.3, 0), (0.3, 0.3, 0.3))]


def detected(extra, *, poses=True, seed_views=(8, 8), config=CONFIG):
    """A room before and after something was put on its floor."""
    views = around(seed_views[0]), around(seed_views[1])
    before = scanned(views[0], STAYING, **SETTINGS)
    after = scanned(views[1], [*STAYING, *extra], **SETTINGS)
    given = {"views_before": views[0], "views_after": views[1]} if poses else {}
    return before, after, detect_changes(before, after, config=config, **given)


def inside(points, centre, size, margin=0.015):
    """Which points lie in a box that stands at `centre`."""
    lower, upper = box(centre, size)
    lower, upper = lower - margin, upper + margin
    return ((points >= lower) & (points <= upper)).all(axis=1)


@pytest.mark.parametrize("poses", [True, False])
@pytest.mark.parametrize(
    ("name", "centre", "size"),
    [
        ("usual", (-0.5, -0.4, 0), (0.3, 0.3, 0.3)),
        ("small", (-0.5, -0.4, 0), (0.09, 0.09, 0.1)),
        ("thin", (-0.5, -0.4, 0), (0.4, 0.3, 0.03)),
    ],
)
def test_finds_usual_small_and_thin_objects(name, centre, size, poses):
    """The small one has fewer than 150 of some 50,000 points, the thin one is no thicker than two tolerances."""
    before, after, changes = detected([box(centre, size)], poses=poses)
    truth = np.where(inside(after, centre, size) & (after[:, 2] > 0.012), 0, -1)
    scores = score_pair(changes.labels_before, changes.labels_after, np.full(len(before), -1), truth)
    assert scores.f1 == 1, name
    assert [change.kind for change in changes.items] == ["appeared"]


@pytest.mark.parametrize("poses", [True, False])
def test_nothing_new_is_no_change(poses):
    assert detected([], poses=poses)[2].items == ()


def test_what_only_one_survey_saw_is_unobserved():
    """Four places see less than eight: the rest is new to the eye, and did not change."""
    changes = detected([], seed_views=(2, 8))[2]
    assert changes.items == ()
    assert changes.unobserved_after.mean() > changes.unobserved_before.mean()


def test_without_evidence_it_is_reported_all_the_same():
    changes = detected([], seed_views=(2, 8), config=dataclasses.replace(CONFIG, evidence=False))[2]
    assert len(changes.items) > 0
    assert not changes.unobserved_after.any()


def test_the_detector_passes_its_settings_to_the_surveys():
    """Views that may not leave a single point outside contradict every cloud, before anything is fitted."""
    views = around(4)
    scans = Pair(*(Scan(scanned(views, STAYING, seed=seed, **SETTINGS), views) for seed in (0, 1)))
    evidence = EvidenceSettings(view_checks=ViewCheckSettings(most_outside=-1.0))
    detector = dataclasses.replace(JointDetector(DetectionConfig(restarts=1, registration="never")), evidence=evidence)
    with pytest.raises(InputWarning, match=r"views_before: .* not used as evidence"):
        detector.changes(scans)


SPACING = 0.02
LIMITS = DetectionLimits(SPACING, 0.01, 0.002, distance=0.06, offset=0.02, settings=DifferenceSettings())
FREE, SURFACE, UNOBSERVED = Observed.free, Observed.surface, Observed.unobserved
# A camera 2 above the middle of the floor.
FROM_ABOVE = SensorViews([[[1, 0, 0, 1], [0, -1, 0, 1], [0, 0, -1, 2], [0, 0, 0, 1]]], (53.0, 53.0), 3.0)


def plane(lower, upper, height, seed=0):
    """A grid of points of a horizontal rectangle, a little noisy."""
    x, y = (
        grid.ravel() for grid in np.meshgrid(*(np.arange(*side, SPACING) for side in zip(lower, upper, strict=True)))
    )
    points = np.column_stack([x, y, np.full_like(x, height)])
    return points + 0.001 * np.random.default_rng(seed).standard_normal(points.shape)


def cube(centre, size, seed=1):
    """The top and the sides of a cube that stands on the floor."""
    centre, half = np.array([*centre, size / 2]), size / 2
    face = plane((-half, -half), (half, half), half, seed)
    sides = [face @ turned for turned in (np.eye(3), np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]])]
    sides += [-side for side in sides[1:]]
    points = np.concatenate(sides) + centre
    return points[points[:, 2] > 0.03]


def in_square(points, centre, size):
    return (np.abs(points[:, :2] - centre) < size / 2).all(axis=1)


def candidates_of(points, labels, offset=0.0):
    none = np.zeros(len(points))
    difference = LocalDifference(none, none + offset, none, none, none)
    return Candidates(points, difference, np.where(labels >= 0, 1.0, 0.2)[None], labels)


@pytest.fixture(scope="module")
def uncovered():
    """A floor in two surveys, of which the other one has a hole, and the points in the hole as a candidate."""
    floor = plane((0, 0), (2, 2), 0.0)
    hole = in_square(floor, (1, 1), 0.5)
    return floor, np.where(hole, 0, -1), plane((0, 0), (2, 2), 0.0, 5)[~hole]


def test_what_was_occluded_continues_the_floor_and_an_object_does_not(uncovered):
    floor, labels, other = uncovered
    np.testing.assert_array_equal(continuing(floor, labels, other, LIMITS), labels == 0)
    both = np.concatenate([floor, cube((0.4, 0.4), 0.4)])
    labels = np.where(np.arange(len(both)) < len(floor), -1, 0)
    assert not continuing(both, labels, other, LIMITS).any()


def test_an_object_and_what_it_occluded_are_judged_separately_in_one_candidate(uncovered):
    floor, labels, other = uncovered
    both = np.concatenate([floor, cube((0.4, 0.4), 0.4)])
    labels = np.append(labels, np.zeros(len(both) - len(floor), int))
    on_floor = (labels == 0) & (np.arange(len(both)) < len(floor))
    dropped = continuing(both, labels, other, LIMITS)
    assert dropped[on_floor].mean() > 0.95 and dropped[~on_floor].mean() < 0.02
    whole = continuing(both, labels, other, LIMITS, EvidenceSettings(share_of_piece=1.0))
    assert not whole.any()


@pytest.mark.parametrize(
    ("free", "surface", "unobserved", "offset", "kept"),
    [
        (60, 40, 0, 0.0, True),
        (40, 60, 0, 0.0, False),
        (40, 60, 0, 0.018, True),
        (12, 8, 80, 0.0, True),
        (8, 0, 92, 0.0, False),
        (0, 0, 100, 0.0, False),
        (0, 34, 66, 0.018, False),
        (0, 36, 64, 0.018, True),
    ],
    ids=[
        "most is empty",
        "most is a surface",
        "that is off",
        "most of what was observed is empty",
        "too few points are",
        "nothing was observed",
        "too little is off for a thin object",
        "enough is off",
    ],
)
def test_a_candidate_must_be_in_free_space_or_off_the_other_surface(free, surface, unobserved, offset, kept):
    points = plane((0, 0), (0.2, 0.2), 5.0)
    observed = np.repeat(np.array([FREE, SURFACE, UNOBSERVED], np.int8), [free, surface, unobserved])
    own = candidates_of(points, np.zeros(len(points), int), offset)
    np.testing.assert_array_equal(not_seen_empty(own, observed, plane((0, 0), (1, 1), 0.0), LIMITS), not kept)


def test_a_thin_candidate_must_not_continue_the_floor(uncovered):
    floor, labels, other = uncovered
    own, observed = candidates_of(floor, labels, offset=0.018), np.full(len(floor), SURFACE, np.int8)
    np.testing.assert_array_equal(not_seen_empty(own, observed, other, LIMITS), labels == 0)


def test_hidden_parts_are_clusters_of_the_unobserved_points_of_candidates():
    points = np.concatenate([plane((0, 0), (0.2, 0.2), 0.0) + np.array([side, 0, 0]) for side in range(3)])
    labels = np.repeat([0, 0, -1], 100)
    observed = np.tile(np.repeat(np.array([UNOBSERVED, FREE], np.int8), 50), 3)
    parts = hidden_parts(points, labels, observed, LIMITS)
    np.testing.assert_array_equal(parts, np.repeat([0, -1, 1, -1, -1, -1], 50))


def test_labels_are_renumbered_without_gaps():
    assert renumbered(np.array([4, -1, 2, 4])).tolist() == [1, -1, 0, 1]
    assert renumbered(np.array([-1, -1])).tolist() == [-1, -1]


def test_what_turns_out_unobserved_is_no_candidate():
    own = Examined(np.array([0, 1, 1, -1]), np.full((2, 4), 0.8), np.array([False, False, False, True]))
    left = own.without(np.array([True, False, False, False]))
    assert left.labels.tolist() == [-1, 0, 0, -1] and left.unobserved.tolist() == [True, False, False, True]
    np.testing.assert_array_equal(left.probability, np.tile([0, 0.8, 0.8, 0.8], (2, 1)))


def test_with_views_the_object_is_kept_and_what_nobody_observed_is_not():
    """From above the middle of a floor: a cube that came, and floor beyond the field of view."""
    other = Survey.of(plane((0, 0), (2, 2), 0.0), FROM_ABOVE)
    thing, far = cube((1, 1), 0.4), plane((4, 0), (4.5, 0.5), 0.0)
    points = np.concatenate([thing, far])
    rejected, unobserved = without_evidence(
        candidates_of(points, np.where(np.arange(len(points)) < len(thing), 0, 1)), other, LIMITS
    )
    # Near the floor a few points are neither on it nor far enough in front of it.
    assert not rejected[: len(thing)].any() and unobserved[: len(thing)].mean() < 0.02
    assert rejected[len(thing) :].all() and unobserved[len(thing) :].all()


def test_with_views_an_object_is_kept_without_the_floor_that_was_occluded(uncovered):
    """One candidate is a cube that came, and floor where the other survey has a hole."""
    floor, labels, other = uncovered
    points = np.concatenate([floor, cube((1.0, 0.4), 0.3)])
    labels = np.append(labels, np.zeros(len(points) - len(floor), int))
    occluded = (labels == 0) & (np.arange(len(points)) < len(floor))
    rejected, unobserved = without_evidence(candidates_of(points, labels), Survey.of(other, FROM_ABOVE), LIMITS)
    # At the rim of the hole points of the other cloud are near.
    assert rejected[occluded].mean() > 0.5 and unobserved[occluded & rejected].all()
    assert not rejected[len(floor) :].any()


def test_without_views_a_floor_that_was_occluded_is_unobserved_in_its_own_cloud(uncovered):
    floor, labels, other = uncovered
    own = Pair(candidates_of(floor, labels), candidates_of(other, np.full(len(other), -1)))
    surveys = own.map(lambda cloud: Survey.of(cloud.points))
    found = examined(own, surveys, LIMITS)
    assert (found.before.labels == -1).all() and (found.after.labels == -1).all()
    np.testing.assert_array_equal(found.before.unobserved, labels == 0)
    np.testing.assert_array_equal(found.before.probability[0], np.where(labels == 0, 0.0, 0.2))
    unproven = unexamined(own)
    np.testing.assert_array_equal(unproven.before.labels, labels)
    assert not unproven.before.unobserved.any()
