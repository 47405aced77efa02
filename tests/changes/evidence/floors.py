"""Floors with and without a hole, cubes on them, and their candidates."""

import numpy as np

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits, DifferenceSettings, LocalDifference
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair

SPACING = 0.02
LIMITS = DetectionLimits(SPACING, 0.01, 0.002, distance=0.06, offset=0.02, settings=DifferenceSettings())
# A camera 2 above the middle of the floor.
FROM_ABOVE = SensorViews([[[1, 0, 0, 1], [0, -1, 0, 1], [0, 0, -1, 2], [0, 0, 0, 1]]], (53.0, 53.0), 3.0)


def plane(lower, upper, height, seed=0):
    """A grid of points of a horizontal rectangle, a little noisy."""
    x, y = (
        grid.ravel() for grid in np.meshgrid(*(np.arange(*side, SPACING) for side in zip(lower, upper, strict=True)))
    )
    points = np.column_stack([x, y, np.full_like(x, height)])
    return points + 0.001 * np.random.default_rng(seed).standard_normal(points.shape)


def cube(centre, size, seed=1):
    """The top and the sides of a cube that stands on the floor."""
    centre, half = np.array([*centre, size / 2]), size / 2
    face = plane((-half, -half), (half, half), half, seed)
    sides = [face @ turned for turned in (np.eye(3), np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]])]
    sides += [-side for side in sides[1:]]
    points = np.concatenate(sides) + centre
    return points[points[:, 2] > 0.03]


def in_square(points, centre, size):
    return (np.abs(points[:, :2] - centre) < size / 2).all(axis=1)


def candidates_of(points, labels, observed=None):
    near = np.full(len(points), 0.001)
    difference = LocalDifference(np.where(labels >= 0, 0.1, 0.001), *[near] * 3, near + SPACING, near, near)
    looks_changed = np.where(labels >= 0, 1.0, 0.2)
    excess = RestartValues(1, lambda restart, rows: looks_changed[rows])
    return Candidates(points, difference, excess, looks_changed, labels, observed)


def surveys_of(pair, *views):
    """Both clouds as surveys; of the after cloud with these views."""
    return Pair(ScanVisibility.of(pair.before.points), ScanVisibility.of(pair.after.points, *views))


def nothing_of(points):
    return candidates_of(points, np.full(len(points), -1))
