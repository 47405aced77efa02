"""The sign of a volume: right, or none, in whatever frame a scan is given and without any poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax import detect_changes
from gmmjax.clouds import SensorViews

SIDE, HEIGHT = 12.0, 0.8
HIGH_ABOVE = np.array([0.0, 0.0, 30.0])


def ground(seed, change, height, walls=()):
    """Ground about the origin, raised by a height where something is changed, with upright walls around it."""
    random = np.random.default_rng(seed)
    xy = random.uniform(-SIDE / 2, SIDE / 2, (9000, 2))
    z = 0.2 * np.sin(xy[:, 0] / 3) + height * change(xy)
    return np.concatenate([np.c_[xy, z], *walls]) + random.normal(0, 0.01, (len(xy) + sum(map(len, walls)), 3))


def cone(xy):
    return np.clip(1 - np.hypot(*(xy - [1.0, -0.5]).T) / 2, 0, 1)


def block(xy):
    return (np.abs(xy - [1.0, -0.5]) < 1.2).all(axis=1).astype(float)


def sides_of_block(seed, height):
    random = np.random.default_rng(seed)
    along, up = random.uniform(-1.2, 1.2, 600), random.uniform(0, 1, 600) * height
    across = np.repeat([-1.2, 1.2], 300)
    x, y = np.where(np.arange(600) % 2, (along, across), (across, along)) + np.array([[1.0], [-0.5]])
    return np.c_[x, y, up + 0.2 * np.sin(x / 3)]


def changed(change, height):
    walls = [sides_of_block(3, height)] if change is block else []
    return ground(1, change, 0.0), ground(2, change, height, walls)


def frame(axis, degrees, shift):
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix(), np.array(shift)


# Surveys, z up; then a camera that looks down along z, an oblique one, and a frame with y up.
SURVEYS = {"corner": frame("x", 0, [6.0, 6.0, 1.0]), "projected": frame("x", 0, [5e5, 5.2e6, 300.0])}
CAMERAS = {
    "forward": frame("x", 180, [0.0, 0.0, 15.0]),
    "oblique": frame("x", 140, [0.0, 2.0, 15.0]),
    "y up": frame("x", -90, [0.0, 0.0, 0.0]),
}


def found_volume(change, height, frame, **settings):
    motion, shift = frame
    clouds = [cloud @ motion.T + shift for cloud in changed(change, height)]
    totals = detect_changes(*clouds, restarts=1, **settings).volume_totals()
    return totals.gained, totals.lost, totals.unsigned


def true_volume(change, height):
    side = np.linspace(-SIDE / 2, SIDE / 2, 1201)
    return abs(height) * change(np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)).mean() * SIDE**2


@pytest.mark.slow
@pytest.mark.parametrize("height", [HEIGHT, -HEIGHT])
@pytest.mark.parametrize(("change", "place"), [(cone, "projected"), (block, "corner")])
def test_a_pile_on_surveyed_ground_is_gained_and_a_pit_is_lost(change, place, height):
    gained, lost, unsigned = found_volume(change, height, SURVEYS[place])
    expected = true_volume(change, height)
    np.testing.assert_allclose((gained, lost) if height > 0 else (lost, gained), (expected, 0), atol=0.1 * expected)
    assert unsigned == 0


@pytest.mark.slow
@pytest.mark.parametrize("place", CAMERAS)
@pytest.mark.parametrize(("change", "height"), [(cone, HEIGHT), (block, -HEIGHT)])
def test_without_any_hint_of_the_free_side_a_volume_has_no_sign(change, height, place):
    gained, lost, unsigned = found_volume(change, height, CAMERAS[place])
    assert (gained, lost) == (0, 0)
    assert unsigned == pytest.approx(true_volume(change, height), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("height", [HEIGHT, -HEIGHT])
def test_a_sensor_gives_the_volume_its_sign_in_any_frame(height):
    motion, shift = CAMERAS["oblique"]
    views = SensorViews.from_positions(changed(cone, 0.0)[0] @ motion.T + shift, HIGH_ABOVE @ motion.T + shift)
    gained, lost, unsigned = found_volume(cone, height, CAMERAS["oblique"], views_before=views, views_after=views)
    assert unsigned == 0 and (gained > 0) == (height > 0) and (lost > 0) == (height < 0)


@pytest.mark.slow
def test_height_does_not_tell_the_free_side_of_a_ceiling():
    """A hall whose ceiling came down in one place, seen from below."""
    random = np.random.default_rng(4)
    scans = []
    for depth in (0.0, 0.3):
        plan = random.uniform(-SIDE / 2, SIDE / 2, (2, 8000, 2))
        ceiling = 3 - depth * cone(plan[1])
        scans.append(np.concatenate([np.c_[plan[0], np.zeros(8000)], np.c_[plan[1], ceiling]]))
        scans[-1] += random.normal(0, 0.004, scans[-1].shape)
    totals = detect_changes(*scans, restarts=1).volume_totals()
    assert (totals.gained, totals.lost) == (0, 0) and totals.unsigned > 0
