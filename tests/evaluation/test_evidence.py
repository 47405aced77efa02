import numpy as np
import pytest

from gmmjax import DetectionConfig
from gmmjax.evaluation.evidence import Evidence
from gmmjax.geometry import rigid_transform, transformed
from gmmjax.pair import Pair
from tests.changes.rooms import around, box, scanned


@pytest.fixture(scope="module")
def new_box():
    """A room in which a box appears, the second survey 10 cm off, and which points the box's are."""
    views = around(8)
    before = scanned(views, voxel=0.02, noise=0.001)
    after = scanned(views, [box((0, 0, 0), (0.4, 0.3, 0.4))], voxel=0.02, noise=0.001, seed=1)
    on_box = (after[:, 2] > 0.05) & (np.abs(after[:, :2]) < 0.25).all(axis=1)
    motion = rigid_transform(np.eye(3), np.array([0.1, 0.0, 0.0]))
    scans = Pair(before, transformed(after, motion))
    return Evidence.of(scans, Pair(views, views.moved(motion)), DetectionConfig(restarts=2)), on_box


def test_it_is_that_of_the_registered_clouds(new_box):
    evidence, on_box = new_box
    assert evidence.pair.registration.applied
    places = evidence.surveys.after.views.poses[:, :3, 3]
    np.testing.assert_allclose(places, around(8).poses[:, :3, 3], atol=0.01)
    nothing = np.full(len(evidence.pair.points.before), -1)
    kept = evidence.kept(Pair(nothing, np.where(on_box, 0, 1)))
    assert (kept.before < 0).all()
    assert (kept.after[on_box] == 0).mean() > 0.95
    assert (kept.after[~on_box] < 0).all()


def test_the_mixture_sees_what_is_new(new_box):
    evidence, on_box = new_box
    excess = evidence.excess.after.mean(axis=0)[evidence.pair.working.clouds.after.member]
    assert excess.shape == on_box.shape
    assert excess[on_box].mean() > 0.5 > 0.1 > excess[~on_box].mean()
