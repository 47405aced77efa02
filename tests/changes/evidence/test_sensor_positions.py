"""What the position of a scanner alone says, compared with its pose, field of view and range."""

import numpy as np
import pytest

from gmmjax.changes.evidence.free_space import Observed, observation
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.evidence.view_checks import check_views
from gmmjax.clouds import SensorViews
from gmmjax.scenes.families.halls import halls


@pytest.fixture(scope="module")
def scene():
    """A hall in metres, scanned from a single station in either survey."""
    return halls(np.random.default_rng(48))


@pytest.mark.slow
def test_the_positions_of_a_scanner_tell_nearly_what_its_poses_do(scene):
    points, places = scene.clouds.before, scene.clouds.after[::5]
    views = scene.views.before
    derived = SensorViews.from_positions(points, views.poses[:, :3, 3])
    assert check_views("--sensor-before", ScanVisibility.of(points, derived)) is None
    known, found, none = (
        observation(places, ScanVisibility.of(points, own), margin=0.1, offset=0.05) for own in (views, derived, None)
    )
    assert (known == found).mean() > 0.99
    free = known == Observed.free
    assert free.sum() > 40 and (found[free] == Observed.free).mean() > 0.9
    assert not (none == Observed.free).any()


def test_a_wrong_position_contradicts_the_cloud(scene):
    """Outside of the hall, whose walls hide it."""
    points = scene.clouds.before
    lower, upper = points.min(axis=0), points.max(axis=0)
    wrong = SensorViews.from_positions(points, upper + 0.5 * (upper - lower))
    told = check_views("--sensor-before", ScanVisibility.of(points, wrong))
    assert told is not None and "hidden by others" in told
