import dataclasses

import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError
from gmmjax.evaluation import NAMES, LabelledCloud, LabelledPair, available, detector
from gmmjax.evaluation.gaussians import Condition, gaussian_pair
from gmmjax.evaluation.scores import score_labelled_pair
from tests.changes.rooms import around, box, scanned
from tests.changes.test_record import example
from tests.evaluation.scenes import box_pair

CONFIG = DetectionConfig(restarts=2)
SCENE = gaussian_pair(Condition(1, 1, "low", points=500), 21)


def scores(name, pair, config=CONFIG):
    detection = detector(name, config)(pair)
    return score_labelled_pair(pair, detection.labels_before, detection.labels_after, detection.moved)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["joint", "transport", "transport+evidence", "c2c", "voxels", "c2c+evidence"])
def test_a_gone_and_a_new_gaussian_are_found(name):
    assert scores(name, SCENE).f1 == 1


def test_algorithm_1_finds_no_more_than_there_is():
    assert scores("greedy", SCENE).precision == 1


@pytest.mark.parametrize("name", ["c2c", "voxels"])
def test_the_peers_find_a_box(name):
    assert scores(name, box_pair()).f1 == 1


def test_our_detectors_hand_over_their_record():
    detection = detector("transport", CONFIG)(SCENE)
    assert detection.changes.config.method == "transport" and detection.changes.config.restarts == 2
    assert detector("c2c")(SCENE).changes is None


def test_a_moved_object_is_reported_once_from_before_to_after(monkeypatch):
    record = example()
    (change,) = record.items
    items = dataclasses.replace(change, partner=1), dataclasses.replace(change, partner=0)
    found = dataclasses.replace(
        record, items=items, labels_before=np.repeat([0, -1], 15), labels_after=np.repeat([1, -1], 25)
    )
    monkeypatch.setattr("gmmjax.changes.JointDetector.changes", lambda self, scans, report: found)
    assert detector("joint")(SCENE).moved == ((0, 1),)


def hidden_wall(with_views):
    """A room whose second survey did not see what lies behind a box; the box itself was there both times."""
    views = around(1), around(8)
    boxes = [box((0.2, 0.2, 0), (0.4, 0.4, 0.5))]
    clouds = [scanned(own, boxes, voxel=0.02, noise=0.001) for own in views]
    before, after = (
        LabelledCloud(points, np.full(len(points), -1), views=own if with_views else None)
        for points, own in zip(clouds, views, strict=True)
    )
    return LabelledPair("hidden", before, after)


@pytest.mark.slow
def test_what_the_other_survey_did_not_see_is_no_change():
    """More is seen from eight places than from one: all of it is new, and none of it has changed."""
    pair = hidden_wall(with_views=True)
    assert scores("c2c", pair).false_segments > 0
    assert scores("c2c+evidence", pair).false_segments == 0


@pytest.mark.slow
def test_without_views_walls_that_go_on_are_no_change():
    pair = hidden_wall(with_views=False)
    assert scores("c2c+evidence", pair).false_segments < scores("c2c", pair).false_segments


@pytest.mark.slow
def test_evidence_keeps_what_is_new():
    views = around(8)
    before, after = (
        LabelledCloud(points, np.where(points[:, 2] > 0.05, 0, -1) * is_after - (1 - is_after), views=views)
        for is_after, points in (
            (0, scanned(views, voxel=0.02, noise=0.001)),
            (1, scanned(views, [box((0, 0, 0), (0.4, 0.3, 0.4))], voxel=0.02, noise=0.001, seed=1)),
        )
    )
    inner = (np.abs(after.points[:, :2]) < 0.25).all(axis=1)
    pair = LabelledPair("new", before, dataclasses.replace(after, truth=np.where(inner, after.truth, -1)))
    assert scores("c2c+evidence", pair).f1 == 1


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"'ICP' is unknown; choose from joint, joint-no-evidence, greedy"):
        detector("ICP")


def test_m3c2_is_offered_where_it_is_installed(monkeypatch):
    monkeypatch.setattr("gmmjax.evaluation.detectors.has_m3c2", lambda: True)
    assert available() == NAMES
    assert [name for name in available(evidence=False) if "evidence" in name] == []
    monkeypatch.setattr("gmmjax.evaluation.detectors.has_m3c2", lambda: False)
    assert set(NAMES) - set(available()) == {"m3c2", "m3c2+evidence"}
