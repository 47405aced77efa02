import dataclasses

import numpy as np
import pytest

from gmmjax import DetectionConfig, detect_changes
from gmmjax.evaluation import score_pair
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
