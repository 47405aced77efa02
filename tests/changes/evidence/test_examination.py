import dataclasses

import numpy as np
import pytest

from gmmjax import DetectionConfig, detect_changes
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.detectors.joint import JointDetector
from gmmjax.changes.differences import Differences
from gmmjax.changes.evidence.examination import (
    EvidenceSettings,
    examined,
    measured_candidates,
    observed_places,
    renumbered,
    unexamined,
)
from gmmjax.changes.evidence.facts import measured
from gmmjax.changes.evidence.free_space import Observed
from gmmjax.changes.evidence.pieces import PieceSettings
from gmmjax.changes.evidence.verdict_file import Verdicts, shipped_verdicts
from gmmjax.changes.evidence.view_checks import ViewCheckSettings
from gmmjax.errors import InputWarning
from gmmjax.evaluation import score_pair
from gmmjax.pair import Pair
from tests.changes.evidence.floors import (
    FROM_ABOVE,
    LIMITS,
    candidates_of,
    cube,
    in_square,
    nothing_of,
    plane,
    surveys_of,
)
from tests.changes.evidence.verdicts import verdict
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


@pytest.mark.slow
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
    assert scores.recall == 1, name
    assert changes[0].kind == "appeared" and changes[0].probability > 0.85
    # The floor below a thin object may be taken for ground below a deposit, and without poses that below a small one.
    most = {"thin": 0.9, "small": 0.5 if poses else 0.85, "usual": 0.5}[name]
    assert all(change.kind == "disappeared" and change.probability < most for change in changes[1:])


@pytest.mark.slow
@pytest.mark.parametrize("poses", [True, False])
def test_nothing_new_is_no_change(poses):
    assert detected([], poses=poses)[2].items == ()


@pytest.mark.slow
def test_what_only_one_survey_saw_is_unobserved():
    """Four places see less than eight: the rest is new to the eye, and did not change."""
    changes = detected([], seed_views=(2, 8))[2]
    assert changes.items == ()
    assert changes.unobserved_after.mean() > changes.unobserved_before.mean()


@pytest.mark.slow
def test_without_evidence_it_is_reported_all_the_same():
    changes = detected([], seed_views=(2, 8), config=dataclasses.replace(CONFIG, evidence=False))[2]
    assert len(changes.items) > 0
    assert not changes.unobserved_after.any()


def test_the_detector_passes_its_settings_to_the_surveys():
    """Views that may not leave a single point outside contradict every cloud, before anything is fitted."""
    views = around(4)
    scans = Pair(*(Scan(scanned(views, STAYING, seed=seed, **SETTINGS), views) for seed in (0, 1)))
    evidence = EvidenceSettings(view_checks=ViewCheckSettings(max_outside=-1.0))
    detector = dataclasses.replace(JointDetector(DetectionConfig(restarts=1, registration="never")), evidence=evidence)
    with pytest.raises(InputWarning, match=r"views_before: .* not used as evidence"):
        detector.changes(scans)


@pytest.fixture(scope="module")
def uncovered():
    """A floor in two surveys, of which the other one has a hole, and the points in the hole as a candidate."""
    floor = plane((0, 0), (2, 2), 0.0)
    hole = in_square(floor, (1, 1), 0.5)
    return floor, np.where(hole, 0, -1), plane((0, 0), (2, 2), 0.0, 5)[~hole]


@pytest.fixture(scope="module")
def with_object(uncovered):
    """The same with a cube beside the hole, as one candidate with it."""
    floor, labels, other = uncovered
    points = np.concatenate([floor, cube((0.55, 1.0), 0.4)])
    return points, np.append(labels, np.zeros(len(points) - len(floor), int)), other


# Changed is what does not continue a surface, and all else was not observed.
BY_CONTINUATION = Verdicts(
    verdict({"continued": -20.0}, {"continued": 20.0}, bias=(5.0, -5.0)),
    verdict({"seen_free": 20.0}, {"not_seen": 20.0}, poses=True, bias=(-5.0, -5.0)),
)


def test_an_object_and_what_it_occluded_are_judged_by_themselves(with_object):
    points, labels, other = with_object
    on_floor = (labels == 0) & (points[:, 2] < 0.02)
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    found = examined(pair, surveys_of(pair), LIMITS, BY_CONTINUATION).before
    assert (found.labels[on_floor] < 0).mean() > 0.95 and (found.labels[(labels == 0) & ~on_floor] == 0).mean() > 0.95
    assert found.unobserved[on_floor].mean() > 0.95 and not found.unobserved[found.labels == 0].any()
    ((rows, explanation),) = found.rejected
    assert explanation.unobserved > 0.9 and set(rows) <= set(np.flatnonzero(labels == 0))
    assert found.explanations[0].changed == pytest.approx(found.probability[0])
    assert explanation.contributions[0].fact == "continued"


def test_as_one_piece_they_have_one_verdict(with_object):
    points, labels, other = with_object
    settings = EvidenceSettings(pieces=PieceSettings(share=1.0))
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    (piece,), _ = measured_candidates(pair, surveys_of(pair), LIMITS, settings)
    np.testing.assert_array_equal(np.sort(piece.rows), np.flatnonzero(labels == 0))
    assert 0.2 < measured(piece)["continued"] < 0.8


def test_pieces_that_touch_and_are_changes_are_one_change(with_object):
    points, labels, other = with_object
    everything = Verdicts(verdict({}, bias=(3.0, -3.0)), BY_CONTINUATION.poses_given)
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    found = examined(pair, surveys_of(pair), LIMITS, everything).before
    np.testing.assert_array_equal(found.labels, labels)
    assert len(found.probability) == len(found.explanations) == 1 and found.rejected == ()


def test_the_threshold_decides_what_is_a_change(with_object):
    points, labels, other = with_object
    even = Verdicts(verdict({}, bias=(0.0, -20.0)), BY_CONTINUATION.poses_given)
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    assert examined(pair, surveys_of(pair), LIMITS, even, threshold=0.4).before.labels.max() == 0
    rejected = examined(pair, surveys_of(pair), LIMITS, even, threshold=0.6).before
    assert rejected.labels.max() == -1
    # As likely as not, and unchanged where it is no change.
    assert all(explanation.changed == pytest.approx(0.5, abs=1e-6) for _, explanation in rejected.rejected)
    assert not rejected.unobserved.any()


def test_a_candidate_unlike_all_that_was_learned_is_warned_of_by_the_fact(with_object):
    points, labels, other = with_object
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    known = Verdicts(verdict({}, lower=-0.01, upper=0.01), BY_CONTINUATION.poses_given)
    with pytest.warns(InputWarning, match=r"unlike all that the verdict was learned from \(\w+ is [\d.]+ times"):
        examined(pair, surveys_of(pair), LIMITS, known)


def test_the_order_of_the_points_changes_no_verdict(with_object):
    points, labels, other = with_object
    order = np.random.default_rng(0).permutation(len(points))

    def of(points, labels):
        pair = Pair(candidates_of(points, labels), nothing_of(other))
        return examined(pair, surveys_of(pair), LIMITS, shipped_verdicts()).before.labels >= 0

    np.testing.assert_array_equal(of(points, labels)[order], of(points[order], labels[order]))


def test_labels_are_renumbered_without_gaps():
    assert renumbered(np.array([4, -1, 2, 4])).tolist() == [1, -1, 0, 1]
    assert renumbered(np.array([-1, -1])).tolist() == [-1, -1]


def test_with_views_the_object_is_kept_and_what_nobody_observed_is_not():
    """From above the middle of a floor: a cube that came, and floor beyond the field of view."""
    floor = plane((0, 0), (2, 2), 0.0)
    thing, far = cube((1, 1), 0.4), plane((4, 0), (4.5, 0.5), 0.0)
    points = np.concatenate([thing, far])
    is_thing = np.arange(len(points)) < len(thing)
    pair = Pair(candidates_of(points, np.where(is_thing, 0, 1)), nothing_of(floor))
    surveys = surveys_of(pair, FROM_ABOVE)
    differences = Differences(pair.map(lambda own: own.difference), LIMITS)
    observed = observed_places(Pair(points, floor), surveys, differences)
    assert observed.after is None
    assert (observed.before[is_thing] == Observed.free).mean() > 0.9
    assert (observed.before[~is_thing] == Observed.unobserved).all()
    own = pair.before._replace(observed=observed.before)
    found = examined(Pair(own, pair.after), surveys, LIMITS, BY_CONTINUATION).before
    np.testing.assert_array_equal(found.labels, np.where(is_thing, 0, -1))
    assert found.unobserved[~is_thing].all() and not found.unobserved[is_thing].any()


def test_without_evidence_all_candidates_are_changes(uncovered):
    floor, labels, other = uncovered
    found = unexamined(Pair(candidates_of(floor, labels), nothing_of(other))).before
    np.testing.assert_array_equal(found.labels, labels)
    assert found.probability.tolist() == [1.0] and found.explanations == (None,) and found.rejected == ()
    assert not found.unobserved.any()
