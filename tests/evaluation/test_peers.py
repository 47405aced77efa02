import sys

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes import Scan
from gmmjax.changes.prepare.resolution import ResolutionSettings, working_pair
from gmmjax.evaluation import peers
from gmmjax.evaluation.peers import PEERS, CloudToCloudDetector, M3C2Detector, VoxelDetector
from gmmjax.pair import Pair
from tests.evaluation.scenes import floor_with_box


@pytest.fixture(scope="module")
def scene():
    return floor_with_box()


def peer_labels(detector, before, after):
    found = detector.detect(Pair(Scan(before), Scan(after)))
    return found.labels_before, found.labels_after


@pytest.mark.parametrize("detector", [CloudToCloudDetector(), VoxelDetector()])
@pytest.mark.parametrize("unit", [1.0, 1000.0], ids=["m", "mm"])
def test_a_box_is_found_in_any_unit(scene, detector, unit):
    before, after, truth = scene
    labels_before, labels_after = peer_labels(detector, unit * before, unit * after)
    assert (labels_before == -1).all()
    assert set(labels_after) == {-1, 0}
    assert (labels_after[truth >= 0] == 0).mean() > 0.7
    assert (labels_after[truth < 0] == -1).all()


@pytest.mark.parametrize("detector", [CloudToCloudDetector(), VoxelDetector()])
def test_time_can_be_turned_back(scene, detector):
    before, after, _ = scene
    forward, backward = peer_labels(detector, before, after), peer_labels(detector, after, before)
    np.testing.assert_array_equal(forward[1] >= 0, backward[0] >= 0)


def test_changes_of_the_two_clouds_have_numbers_of_their_own(scene):
    _, after, truth = scene
    labels = peer_labels(CloudToCloudDetector(), after, after + np.where(truth >= 0, 0.3, 0)[:, None])
    found = [set(own) - {-1} for own in labels]
    assert found[0] and found[1] and found[0].isdisjoint(found[1])


def test_stray_points_are_no_change(scene):
    before, _, _ = scene
    stray = np.concatenate([before, np.random.default_rng(1).uniform(0.5, 5, (30, 3))])
    assert (peer_labels(CloudToCloudDetector(), before, stray)[1] == -1).all()


def test_m3c2_finds_the_box(scene):
    pytest.importorskip("py4dgeo")
    before, after, truth = scene
    labels_before, labels_after = peer_labels(M3C2Detector(), before, after)
    below = (np.abs(before[:, :2] - 0.5) < 0.25).all(axis=1)
    assert (labels_before[~below] >= 0).mean() < 0.02
    assert (labels_after[truth >= 0] >= 0).mean() > 0.5


def test_m3c2_says_what_it_needs(scene, monkeypatch):
    monkeypatch.setitem(sys.modules, "py4dgeo", None)
    monkeypatch.setattr(peers, "has_m3c2", lambda: False)
    with pytest.raises(InputError, match=r"pip install '\.\[peers\]'"):
        peer_labels(M3C2Detector(), *scene[:2])


def test_every_peer_has_a_name():
    assert list(PEERS) == ["c2c", "voxels", "m3c2"]


def test_a_clump_of_a_few_points_is_no_change(scene):
    before, _, _ = scene
    generator = np.random.default_rng(1)
    clumps = [0.01 * generator.standard_normal((count, 3)) + [0.5, 0.5, height] for count, height in ((15, 1), (25, 2))]
    labels = peer_labels(CloudToCloudDetector(), before, np.concatenate([before, *clumps]))[1]
    assert (labels[-40:-25] == -1).all() and (labels[-25:] == 0).all()


def test_every_point_of_a_large_cloud_is_labelled(scene):
    before, after, truth = scene
    few = ResolutionSettings(voxels=1500)
    labels_before, labels_after = peer_labels(CloudToCloudDetector(resolution=few), before, after)
    assert len(labels_before) == len(before) > 1500
    assert len(working_pair(Pair(before, after), settings=few).clouds.before.points) <= 1500
    assert (labels_after[truth >= 0] == 0).mean() > 0.7 and (labels_after[truth < 0] == -1).all()
