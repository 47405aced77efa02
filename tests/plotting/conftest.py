import dataclasses

import matplotlib
import numpy as np
import pytest

from gmmjax.changes import Changes, DetectionConfig, Registration
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from tests.reporting.conftest import change


@pytest.fixture(autouse=True)
def only_the_axes(monkeypatch):
    """No plot opens a window, changes matplotlib's settings, or leaves the figures of a test open."""
    matplotlib.use("agg")
    from matplotlib import pyplot

    def show(*arguments, **options):
        raise AssertionError("a plot calls show")

    monkeypatch.setattr(pyplot, "show", show)
    before = dict(matplotlib.rcParams)
    yield
    assert dict(matplotlib.rcParams) == before
    pyplot.close("all")


@pytest.fixture(scope="module")
def changes():
    """A floor of 4 by 3 m with a box that is gone and one that is new, in metres."""
    random = np.random.default_rng(0)
    floor = np.c_[random.uniform([0, 0], [4, 3], (900, 2)), random.normal(scale=0.002, size=900)]

    def box(corner):
        return random.uniform(corner, np.array(corner) + 0.4, (100, 3))

    before = PointCloud.from_rows(np.concatenate([floor, box((1, 1, 0))]), source="scans/first.ply")
    after = PointCloud.from_rows(np.concatenate([floor, box((3, 2, 0))]) + np.array([0.5, 0, 0]))
    labels = Pair(np.repeat([-1, 0], [900, 100]), np.repeat([-1, 1], [900, 100]))
    motion = np.eye(4)
    motion[0, 3] = -0.5
    items = change("disappeared", before.points[900:]), change("appeared", after.points[900:] - np.array([0.5, 0, 0]))
    return Changes(
        labels_before=labels.before,
        labels_after=labels.after,
        probability_before=(labels.before >= 0) * 0.9,
        probability_after=(labels.after >= 0) * 0.9,
        unobserved_before=np.zeros(1000, bool),
        unobserved_after=np.zeros(1000, bool),
        items=items,
        emd=0.5,
        config=DetectionConfig(),
        diagnostics={},
        registration=Registration(motion, True, 0.5, 0.002, 0.4, 0.9),
        distance_after=np.where(labels.after >= 0, np.nan, random.normal(scale=0.01, size=1000)),
        unit="m",
        clouds=Pair(before, after),
    )


@pytest.fixture
def forgetful(changes):
    """The same changes as they are read from a folder, without their clouds."""
    return dataclasses.replace(changes, clouds=None)
