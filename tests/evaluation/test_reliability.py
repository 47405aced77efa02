import json

import numpy as np
import pytest
from sklearn.calibration import calibration_curve
from sklearn.metrics import brier_score_loss

from gmmjax import DetectionConfig
from gmmjax.evaluation import LabelledCloud, LabelledPair, detector
from gmmjax.evaluation.reliability import NOTHING, Reliability, ReliabilityRecord
from tests.evaluation.test_detectors import SCENE


@pytest.fixture(scope="module")
def drawn():
    generator = np.random.default_rng(0)
    probability = generator.uniform(0, 1, 20_000)
    return probability, generator.uniform(0, 1, 20_000) < probability


def test_probabilities_that_are_right_have_no_calibration_error(drawn):
    curve = Reliability.of(*drawn)
    assert curve.calibration_error < 0.01
    assert curve.brier == pytest.approx(1 / 6, abs=0.01)


def test_equals_scikit_learn(drawn):
    probability, truth = drawn
    curve = Reliability.of(probability**2, truth)
    shares, means = calibration_curve(truth, probability**2, n_bins=10)
    np.testing.assert_allclose([part["share_true"] for part in curve.to_dict()["bins"]], shares)
    np.testing.assert_allclose([part["mean_probability"] for part in curve.to_dict()["bins"]], means)
    assert curve.brier == pytest.approx(brier_score_loss(truth, probability**2))


def test_sure_and_wrong_is_the_worst():
    curve = Reliability.of(np.ones(5), np.zeros(5, bool))
    assert curve.brier == curve.calibration_error == 1
    assert curve.to_dict()["bins"] == [{"from": 0.9, "to": 1.0, "count": 5, "mean_probability": 1.0, "share_true": 0.0}]


def test_curves_add_up(drawn):
    probability, truth = drawn
    parts = Reliability.of(probability[:99], truth[:99]) + Reliability.of(probability[99:], truth[99:]) + NOTHING
    assert parts.brier == pytest.approx(Reliability.of(*drawn).brier)
    np.testing.assert_array_equal(parts.count, Reliability.of(*drawn).count)


def test_nothing_has_no_score():
    assert NOTHING.brier is NOTHING.calibration_error is None
    assert NOTHING.to_dict()["bins"] == []


@pytest.fixture(scope="module")
def record():
    record = ReliabilityRecord()
    record.add("transport", SCENE, detector("transport", DetectionConfig(restarts=2))(SCENE))
    record.add("c2c", SCENE, detector("c2c")(SCENE))
    return record


@pytest.mark.slow
def test_our_detections_are_gathered_and_the_peers_have_no_probabilities(record):
    assert list(record.points) == ["transport"]
    assert record.points["transport"].count.sum() == len(SCENE.before.points) + len(SCENE.after.points)
    assert record.changes["transport"].count.sum() == record.changes["transport"].true.sum() == 2
    assert record.points["transport"].brier < 0.05


def test_what_is_not_counted_is_left_out(record):
    before = LabelledCloud(SCENE.before.points, SCENE.before.truth, not_counted=frozenset({0}))
    pair = LabelledPair("one less", before, SCENE.after)
    other = ReliabilityRecord()
    other.add("transport", pair, detector("transport", DetectionConfig(restarts=2))(SCENE))
    assert other.changes["transport"].count.sum() == 1
    assert other.points["transport"].count.sum() == record.points["transport"].count.sum() - 500


def test_tables(record):
    content = json.loads(record.to_json())
    assert content["transport"]["changes"]["count"] == 2
