"""Rigid motions that may lay one scanned object onto another: closest points from many turns, then settled."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.settling import settled
from gmmjax.clouds.local_surface import LocalSurface, evenly_chosen, moved_points
from gmmjax.clouds.neighbours import nearest_neighbours

# Points that are laid onto the other object: at first, and to settle.
COARSE_SAMPLE, FINE_SAMPLE = 200, 500
COARSE_STEPS, FINE_STEPS = 12, 12
FEWEST = 6
# Starts: turns about each axis of the frame by so many steps of a full turn.
TURNS = 12
# In standard deviations of the offsets.
FIRST_REACH, LAST_REACH = 16.0, 3.0


# The best are settled once more, on more points.
LAST_SAMPLE, LAST_FIRST_REACH, LAST_STEPS = 2000, 4.0, 10


class _Start(NamedTuple):
    transform: Float[np.ndarray, "4 4"]
    distance: float


def rigid_matches(
    source: LocalSurface, target: LocalSurface, noise: float, count: int
) -> list[Float[np.ndarray, "4 4"]]:
    """The most promising motions from the source to the target, the best by closest points first.

    The best few of many starts are settled along the normals, where averages of neighbours see offsets far below the
    noise of a point.

    Args:
        source: the first object.
        target: the second.
        noise: standard deviation of the offset between local means of one surface, as in `DifferenceScale`.
        count: of motions.
    """
    to_origin, back = np.eye(4), np.eye(4)
    to_origin[:3, 3], back[:3, 3] = -source.points.mean(axis=0), target.points.mean(axis=0)
    few = [surface.points[evenly_chosen(len(surface), COARSE_SAMPLE)] for surface in (source, target)]
    starts = _starts(moved_points(few[0], to_origin), few[1] - back[:3, 3])
    means, reaches = source.means(evenly_chosen(len(source), FINE_SAMPLE)), (FIRST_REACH * noise, LAST_REACH * noise)
    return [
        settled(means, target, back @ start.transform @ to_origin, *reaches, FINE_STEPS) for start in starts[:count]
    ]


def settled_match(
    source: LocalSurface, target: LocalSurface, motion: Float[np.ndarray, "4 4"], noise: float
) -> Float[np.ndarray, "4 4"]:
    """One of these motions, settled on more of the points."""
    means = source.means(evenly_chosen(len(source), LAST_SAMPLE))
    return settled(means, target, motion, LAST_FIRST_REACH * noise, LAST_REACH * noise, LAST_STEPS)


def _starts(source: np.ndarray, target: np.ndarray) -> list[_Start]:
    """Closest points from all turns, those first that bring either set nearest to the other."""
    trees = cKDTree(source), cKDTree(target)
    reach = 2 * max(float(np.median(nearest_neighbours(tree, tree.data, 2)[0][:, -1])) for tree in trees)
    size = float(np.sqrt((target**2).sum(axis=1).mean()))
    starts = [_closest_points(source, target, trees[1], turn, reach, size) for turn in _turns()]
    return sorted(starts, key=lambda start: start.distance)


def _closest_points(
    source: np.ndarray, target: np.ndarray, tree: cKDTree, turn: np.ndarray, reach: float, size: float
) -> _Start:
    """Closest points, kept where they are within a reach that shrinks from the object's size to the points' spacing."""
    transform = np.eye(4)
    transform[:3, :3] = turn
    for step in range(COARSE_STEPS):
        placed = moved_points(source, transform)
        distances, nearest = tree.query(placed, distance_upper_bound=max(reach, size * 0.5 ** (step / 2)))
        near = np.isfinite(distances)
        if near.sum() < FEWEST:
            return _Start(transform, 2 * reach)
        transform = _kabsch(source[near], target[nearest[near]])
    placed = moved_points(source, transform)
    there, back = tree.query(placed)[0], cKDTree(placed).query(target)[0]
    return _Start(transform, float(sum(np.minimum(distances, reach).mean() for distances in (there, back))))


def _kabsch(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The rigid motion of least squares (Kabsch 1976)."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    transform = np.eye(4)
    transform[:3, :3] = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
    transform[:3, 3] = target_mean - transform[:3, :3] @ source_mean
    return transform


def _turns() -> list[np.ndarray]:
    angles = np.arange(1, TURNS) * 2 * np.pi / TURNS
    turned = [Rotation.from_rotvec(angle * axis).as_matrix() for axis in np.eye(3) for angle in angles]
    return [np.eye(3), *turned]
