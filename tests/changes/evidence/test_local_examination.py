"""Scans of a hall: a small box near the scanner has a hundred points, in a few voxels of the registration."""

import dataclasses

import numpy as np
import pytest

from gmmjax.changes import Clock, DetectionConfig, JointDetector, LocalExaminationSettings, Scan, silent
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair
from gmmjax.scenes.laser_scanner import Beam, TripodScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.rigid_motions import upright

HALL = np.array([30.0, 16.0, 6.0])
BOXES = {0: np.array([4.0, 1.5, 0.1]), 1: np.array([-3.0, -4.0, 0.12])}
CONFIG = DetectionConfig(registration="never", kinds="both", restarts=1, max_components=12)


def between(lower, upper, label=-1):
    lower, upper = np.array(lower, float), np.array(upper, float)
    return Solid((lower + upper) / 2, upper - lower, label=label)


def hall(boxes):
    """Floor, walls, a row of cupboards, and small boxes on the floor."""
    x, y, z = HALL / 2 * [1, 1, 2]
    solids = [between((-x, -y, -0.2), (x, y, 0))]
    solids += [between((s * x - 0.1, -y, 0), (s * x + 0.1, y, z)) for s in (-1, 1)]
    solids += [between((-x, s * y - 0.1, 0), (x, s * y + 0.1, z)) for s in (-1, 1)]
    solids += [between((along, y - 0.8, 0), (along + 1.5, y - 0.1, 2.0)) for along in (-10.0, -4.0, 3.0, 9.0)]
    for label in boxes:
        centre = BOXES[label]
        half = np.array([0.2, 0.15, centre[2]])
        solids.append(between(centre - half, centre + half, label))
    return solids


def survey(boxes, seed):
    """Points, and the number of the box that each is of."""
    random = np.random.default_rng(seed)
    scanner = TripodScanner(
        Beam(noise=0.002, growth=0.0, mixed=0.0, lost=0.0), rays=170_000, lowest=-60.0, highest=30.0
    )
    pose = upright(np.array([0.0, 0.0, 1.7]), 0.3)
    recording = scanner.recording(hall(boxes), pose[None], random)
    return recording.points, recording.labels


@pytest.fixture(scope="module")
def surveys():
    return Pair(survey([0], 1), survey([1], 2))


@pytest.fixture(scope="module")
def found(surveys):
    return JointDetector(CONFIG).changes(surveys.map(lambda own: Scan(own[0])))


@pytest.mark.slow
def test_what_is_smaller_than_a_voxel_of_the_registration_is_found(found, surveys):
    assert [change.kind for change in sorted(found, key=lambda own: own.kind)] == ["appeared", "disappeared"]
    assert found.diagnostics["voxel_size"] > 0.05
    sides = zip((found.labels_before, found.labels_after), surveys, (0, 1), strict=True)
    for labels, (_, truth), box in sides:
        assert (truth == box).sum() > 80
        assert (labels[truth == box] >= 0).mean() > 0.65
        # Voxels at its foot are of box and floor.
        assert (labels[truth < 0] >= 0).sum() < 0.15 * (truth == box).sum()


@pytest.mark.slow
def test_what_a_station_sees_past_is_told_by_the_scan_itself(surveys):
    station = [(0.0, 0.0, 1.7)]
    scans = surveys.map(lambda own: Scan(own[0], SensorViews.from_positions(own[0], station)))
    prepared = JointDetector(CONFIG).prepared(scans, Clock(silent))
    for scan, survey in zip(scans, prepared.surveys, strict=True):
        assert len(survey.sighted.points) > 2 * 50_000
        assert np.isin(survey.sighted.points, scan.cloud).all()
    unknown = prepared.without_views().surveys
    assert unknown.before.sighted is None and unknown.before.views is None


@pytest.mark.slow
def test_the_registration_s_own_voxels_show_less(found, surveys):
    """Else the test above would show nothing."""
    of_boxes = Pair(surveys.before[1] == 0, surveys.after[1] == 1)

    def labelled(changes):
        sides = zip((changes.labels_before, changes.labels_after), of_boxes, strict=True)
        return sum(int((labels[own] >= 0).sum()) for labels, own in sides)

    coarse = dataclasses.replace(JointDetector(CONFIG), resolution=None)
    assert labelled(coarse.changes(surveys.map(lambda own: Scan(own[0])))) < labelled(found)


@pytest.mark.slow
def test_what_is_examined_in_batches_is_found_as_together(found, surveys):
    """Where the boxes are far from each other, and each batch sees the surroundings that both have."""
    alone = dataclasses.replace(JointDetector(CONFIG), examination=LocalExaminationSettings(max_together=1))
    again = alone.changes(surveys.map(lambda own: Scan(own[0])))
    assert len(again) == len(found)
    for side in ("before", "after"):
        labels, others = (np.asarray(getattr(own, f"labels_{side}")) >= 0 for own in (found, again))
        assert (labels & others).sum() > 0.9 * (labels | others).sum()


def test_sizes_are_those_of_the_boxes(found):
    """But for a voxel of box and floor at the foot."""
    for change in found:
        assert np.sort(change.box.extent)[::-1][:2] == pytest.approx([0.4, 0.3], abs=0.2)
        box = BOXES[1 if change.kind == "appeared" else 0]
        np.testing.assert_allclose(change.box.centre[:2], box[:2], atol=0.15)
