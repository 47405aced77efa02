"""Moved objects: what disappeared here and appeared there is one object when the one can be laid onto the other."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.change import Change
from gmmjax.changes.local_difference import local_difference
from gmmjax.changes.settling import moved_points, settled

# Points of a change that are laid onto another change: at first, to settle, and that they are held against.
COARSE_SAMPLE, FINE_SAMPLE, MOST_POINTS = 200, 800, 4000
COARSE_STEPS, FINE_STEPS, SETTLED = 12, 12, 3
FEWEST = 6
# Starts of the registration: turns about each axis of the frame by so many steps of a full turn.
TURNS = 8
# A point lies on the other object when it is off it by no more than so many standard deviations of local means.
ON_IT = 3.0
FIRST_REACH = 16.0
# And when it has a point of the other within so many spacings.
BESIDE = 2.5
# The same object: at least this share of the points of either lies on the other one.
LEAST_SHARE = 0.93
# And their sizes differ, on average over so many directions, by fewer than so many spacings; the outermost points,
# which may be stray, left out.
DIRECTIONS, OUTERMOST, MOST_SIZE_DIFFERENCE = 48, 0.03, 2.5
# Objects whose longest extents or point counts differ by more than this factor are not tried.
MOST_EXTENT_RATIO = 1.4
MOST_COUNT_RATIO = 4.0


class Match(NamedTuple):
    """How well one set of points lies on another.

    Attributes:
        transform: rigid motion [4, 4] from the first to the second.
        share: the smaller of the shares of either set that lies on the other one.
    """

    transform: Float[np.ndarray, "4 4"]
    share: float


def with_moved(
    items: tuple[Change, ...],
    before: Float[np.ndarray, "n0 3"],
    after: Float[np.ndarray, "n1 3"],
    labels_before: Int[np.ndarray, " n0"],
    labels_after: Int[np.ndarray, " n1"],
    noise: float,
) -> tuple[Change, ...]:
    """The changes, where every pair of a disappeared and an appeared one that are one object has become "moved".

    Args:
        items: the changes of both clouds.
        before: points of the before cloud.
        after: points of the after cloud, aligned to it.
        labels_before: the change of each point of the before cloud, or -1.
        labels_after: the same for the after cloud.
        noise: of `rigid_match`.
    """
    gone = [index for index, change in enumerate(items) if change.kind == "disappeared"]
    new = [index for index, change in enumerate(items) if change.kind == "appeared"]
    if not gone or not new:
        return items
    matches = {
        (i, j): rigid_match(before[labels_before == i], after[labels_after == j], noise)
        for i in gone
        for j in new
        if _alike(items[i], items[j])
    }
    shares = np.array([[matches[i, j].share if (i, j) in matches else 0.0 for j in new] for i in gone])
    moved = list(items)
    for row, column in zip(*linear_sum_assignment(-shares), strict=True):
        i, j = gone[row], new[column]
        if shares[row, column] >= LEAST_SHARE:
            transform = matches[i, j].transform
            moved[i] = dataclasses.replace(items[i], kind="moved", partner=j, transform=transform)
            moved[j] = dataclasses.replace(items[j], kind="moved", partner=i, transform=transform)
    return tuple(moved)


def _alike(gone: Change, new: Change) -> bool:
    extents = np.array([gone.box.extent[0], new.box.extent[0]])
    counts = np.array([gone.points, new.points])
    return bool(extents.max() <= MOST_EXTENT_RATIO * extents.min() and counts.max() <= MOST_COUNT_RATIO * counts.min())


def rigid_match(source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "m 3"], noise: float) -> Match:
    """Lays one set of points onto another, and says how well it lies.

    Closest points from many turns first; the best few are then settled along the normals, where averages of neighbours
    see offsets far below the noise of a point.

    Args:
        source: points of the first.
        target: points of the second.
        noise: standard deviation of the offset between local means of one surface, as in `DifferenceScale`.
    """
    source_centre, target_centre = source.mean(axis=0), target.mean(axis=0)
    source, target = _sample(source - source_centre, MOST_POINTS), _sample(target - target_centre, MOST_POINTS)
    coarse = _coarse_matches(_sample(source, COARSE_SAMPLE), _sample(target, COARSE_SAMPLE))
    matches = [_settled(source, target, start.transform, noise) for start in coarse]
    best = max(matches, key=lambda match: match.share)
    transform = best.transform.copy()
    transform[:3, 3] += target_centre - transform[:3, :3] @ source_centre
    return Match(transform, best.share)


def _coarse_matches(source: np.ndarray, target: np.ndarray) -> list[Match]:
    """The best few of closest points from all starts, by the share of points that lie near each other."""
    tree = cKDTree(target)
    spacing = _spacing(source, target)
    size = float(np.sqrt((target**2).sum(axis=1).mean()))
    matches = [_closest_points(source, target, tree, start, spacing, size) for start in _starts()]
    return sorted(matches, key=lambda match: -match.share)[:SETTLED]


def _closest_points(
    source: np.ndarray, target: np.ndarray, tree: cKDTree, start: np.ndarray, spacing: float, size: float
) -> Match:
    """Closest points, kept where they are within a reach that shrinks from the object's size to the points' spacing."""
    transform = np.eye(4)
    transform[:3, :3] = start
    for step in range(COARSE_STEPS):
        placed = moved_points(source, transform)
        distances, nearest = tree.query(placed, distance_upper_bound=max(2 * spacing, size * 0.5 ** (step / 2)))
        near = np.isfinite(distances)
        if near.sum() < FEWEST:
            return Match(transform, 0.0)
        transform = _kabsch(source[near], target[nearest[near]])
    placed = moved_points(source, transform)
    there = np.minimum(tree.query(placed)[0], 2 * spacing).mean()
    back = np.minimum(cKDTree(placed).query(target)[0], 2 * spacing).mean()
    return Match(transform, 1 - max(there, back) / (2 * spacing))


def _settled(source: np.ndarray, target: np.ndarray, start: np.ndarray, noise: float) -> Match:
    """Settles along the normals; then counts who lies on whom."""
    fine = _sample(source, FINE_SAMPLE), _sample(target, FINE_SAMPLE)
    transform = settled(*fine, start, FIRST_REACH * noise, ON_IT * noise, FINE_STEPS)
    placed = moved_points(source, transform)
    tree, placed_tree = cKDTree(target), cKDTree(placed)
    there = local_difference(_sample(placed, FINE_SAMPLE), placed_tree, tree)
    back = local_difference(fine[1], tree, placed_tree)
    reach = BESIDE * _spacing(placed, target)
    lies = [(side.offset < ON_IT * np.maximum(noise, side.noise)) & (side.distance < reach) for side in (there, back)]
    alike = size_difference(placed, target) < MOST_SIZE_DIFFERENCE * _spacing(placed, target)
    return Match(transform, float(min(side.mean() for side in lies)) if alike else 0.0)


def size_difference(one: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "m 3"]) -> float:
    """How much further one set of points reaches than the other, mean over evenly spread directions."""
    height = 1 - (2 * np.arange(DIRECTIONS) + 1) / DIRECTIONS
    # A spiral of Fibonacci's: each turn is the golden angle.
    angle = np.pi * (1 + 5**0.5) * (np.arange(DIRECTIONS) + 0.5)
    radius = np.sqrt(1 - height**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height])
    reaches = [np.quantile(points @ directions, 1 - OUTERMOST, axis=0) for points in (one, other)]
    return float(np.abs(reaches[0] - reaches[1]).mean())


def _kabsch(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The rigid motion of least squares (Kabsch 1976)."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    transform = np.eye(4)
    transform[:3, :3] = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
    transform[:3, 3] = target_mean - transform[:3, :3] @ source_mean
    return transform


def _starts() -> list[np.ndarray]:
    turns = np.arange(1, TURNS) * 2 * np.pi / TURNS
    turned = [Rotation.from_rotvec(angle * axis).as_matrix() for axis in np.eye(3) for angle in turns]
    return [np.eye(3), *turned]


def _sample(points: np.ndarray, size: int) -> np.ndarray:
    return points[np.linspace(0, len(points) - 1, min(size, len(points))).astype(int)]


def _spacing(source: np.ndarray, target: np.ndarray) -> float:
    return float(max(np.median(cKDTree(points).query(points, k=2)[0][:, 1]) for points in (source, target)))
