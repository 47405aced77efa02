"""What one adds to gmmjax: a detector is a class, a ground cost and the reader of a file format are functions."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError, PointCloud, detect_changes, read_cloud
from gmmjax.changes import (
    DETECTORS,
    FACTS,
    AbstractDetector,
    Detection,
    GreedyDetector,
    TransportDetector,
    Verdicts,
    write_verdicts,
)
from gmmjax.changes.config import METHODS
from gmmjax.changes.detectors.separate import AbstractSeparateDetector, over_pairs
from gmmjax.changes.evidence.facts import Fact
from gmmjax.changes.progress import silent
from gmmjax.clouds import READERS
from gmmjax.evaluation import evaluate, score_pair
from gmmjax.evaluation.detectors import EvidenceDetector, on_pairs
from gmmjax.mixtures import GaussianMixture
from gmmjax.pair import Pair
from gmmjax.scenes import random_scene
from gmmjax.transport import earth_movers_distance
from gmmjax.transport.ground_cost import distance_of_means
from tests.changes.evidence.verdicts import verdict
from tests.evaluation.scenes import box_pair, source

# The scene and the settings of the tests of separate mixtures, which compile the same fits.
CONFIG = DetectionConfig(restarts=2)


@dataclasses.dataclass(frozen=True)
class HeightDetector(AbstractDetector):
    """Everything above a height has changed."""

    height: float = 0.1

    def detect(self, scans, report=silent):
        return Detection(*scans.map(lambda scan: np.where(scan.cloud[:, 2] > self.height, 0, -1)))


@dataclasses.dataclass(frozen=True)
class NearestMeanDetector(AbstractSeparateDetector):
    """A Gaussian has changed where no mean of the other mixture is within reach."""

    reach: float = 1.0

    def compare(self, mixtures, points):
        def compared(before, after):
            both = before.live[:, None] & after.live[None]
            distances = jnp.where(both, distance_of_means(before, after), jnp.inf)
            gone = before.live & (distances.min(axis=1) > self.reach)
            new = after.live & (distances.min(axis=0) > self.reach)
            return gone, new, earth_movers_distance(before, after).cost, jnp.array(True)

        return over_pairs(compared)(*mixtures)


def compared(detector, mixtures, ground_cost):
    """What a detector says of one pair of mixtures, with a ground cost or its own."""
    own = {} if ground_cost is None else {"ground_cost": ground_cost}
    restarts = mixtures.map(lambda mixture: jax.tree.map(lambda leaf: leaf[None], mixture))
    with jax.enable_x64(True):
        of_pairs = detector(DetectionConfig(penalty=0.5), **own).compare(restarts, Pair(500.0, 500.0))
    return [np.asarray(part)[0, 0] for part in of_pairs]


def doubled(before, after):
    """Twice the thesis's ground cost."""
    return 2 * distance_of_means(before, after)


def in_plan_view(before, after):
    """Distances of the means on the map, whatever their heights."""
    return jnp.linalg.norm(before.means[:, None, :2] - after.means[None, :, :2], axis=-1)


@pytest.fixture(scope="module")
def scene():
    return random_scene(jax.random.key(11), appeared=1, disappeared=1, points=250)


@pytest.fixture
def mixtures():
    """Two Gaussians; then a third one, high above the first, has a part of its weight."""
    means = np.array([[0.0, 0, 0], [4, 0, 0], [0, 0, 6]])
    weights = Pair(np.array([0.3, 0.7, 0]), np.array([0.2, 0.7, 0.1]))
    return weights.map(lambda own: GaussianMixture(own, means, np.stack([0.01 * np.eye(3)] * 3), own > 0))


def test_a_detector_is_scored_like_the_others():
    own = on_pairs(HeightDetector())
    evaluation = evaluate({"height": own, "too high": on_pairs(HeightDetector(1.0))}, [source(box_pair())])
    assert {row.detector: row.scores.f1 for row in evaluation.rows} == {"height": 1.0, "too high": 0.0}


def test_a_detector_can_be_put_to_the_evidence_test():
    pair = box_pair()
    found, kept = (on_pairs(own)(pair) for own in (HeightDetector(), EvidenceDetector(HeightDetector())))
    # The top of a box that the other survey has not is evident; the evidence adds nothing.
    assert (kept.labels_after >= 0).any()
    np.testing.assert_array_equal(kept.labels_after[kept.labels_after >= 0], found.labels_after[kept.labels_after >= 0])


@pytest.mark.slow
@pytest.mark.usefixtures("as_users")
def test_a_method_is_a_class_and_its_name(scene, monkeypatch):
    with pytest.raises(InputError, match="method='nearest' is unknown"):
        detect_changes(scene.before, scene.after, method="nearest")
    monkeypatch.setattr("gmmjax.changes.config.METHODS", (*METHODS, "nearest"))
    monkeypatch.setattr("gmmjax.changes.detect.DETECTORS", {**DETECTORS, "nearest": NearestMeanDetector})
    changes = detect_changes(scene.before, scene.after, method="nearest", config=CONFIG)
    scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
    assert scores.f1 == 1 and changes.config.method == "nearest"


@pytest.mark.parametrize(("ground_cost", "expected"), [("euclidean", 0.6), (doubled, 1.2), (in_plan_view, 0.0)])
def test_a_ground_cost_of_the_distance_is_a_function(mixtures, ground_cost, expected):
    assert float(earth_movers_distance(*mixtures, ground_cost=ground_cost).cost) == pytest.approx(expected)


@pytest.mark.slow
@pytest.mark.parametrize("detector", [GreedyDetector, TransportDetector])
def test_a_ground_cost_of_a_detector_is_a_function(mixtures, detector):
    """In space the third Gaussian is new; on the map nothing changed."""
    (gone, new), (none_gone, none_new) = (compared(detector, mixtures, cost)[:2] for cost in (None, in_plan_view))
    np.testing.assert_array_equal([gone, new], [[False] * 3, [False, False, True]])
    assert not none_gone.any() and not none_new.any()


def test_algorithm_1_finds_the_same_at_twice_the_distance(mixtures):
    once, twice = (compared(GreedyDetector, mixtures, cost) for cost in (None, doubled))
    np.testing.assert_array_equal(once[:2], twice[:2])
    assert (once[2], twice[2]) == pytest.approx((0.6, 1.2))


def test_a_file_format_is_a_function_and_its_ending(tmp_path, monkeypatch):
    def open_raw(path):
        return PointCloud.from_rows(np.fromfile(path, np.float32).reshape(-1, 3), source=str(path))

    points = np.array([[1.0, 2, 3], [4, 5, 6]], np.float32)
    points.tofile(tmp_path / "cloud.raw")
    with pytest.raises(InputError, match=r"the ending '\.raw' is of no known format"):
        read_cloud(tmp_path / "cloud.raw")
    monkeypatch.setattr("gmmjax.clouds.reading.READERS", {**READERS, ".raw": open_raw})
    np.testing.assert_array_equal(read_cloud(tmp_path / "cloud.raw").points, points)


@pytest.mark.slow
def test_a_fact_is_a_function_of_a_candidate_and_an_entry(monkeypatch, tmp_path):
    """With a verdict that asks for nothing else, what it says decides, and the explanation names it."""

    def height(candidate):
        return float(candidate.points[:, 2].max())

    monkeypatch.setitem(FACTS, "height", Fact(height, "it is {:.1f} m high", "ratio", 1))
    model = verdict({"height": 100.0}, bias=(-100.0 * np.log1p(0.1), -50.0))
    write_verdicts(tmp_path / "mine.json", Verdicts(model, verdict({}, poses=True)), {})
    pair = box_pair()
    config = DetectionConfig(restarts=1, verdict=str(tmp_path / "mine.json"))
    changes = detect_changes(pair.before.points, pair.after.points, config=config)
    assert len(changes) > 0
    for change in changes:
        assert change.explanation.contributions[0].fact == "height"
        assert change.explanation.contributions[0].sentence.startswith("it is 0.")
