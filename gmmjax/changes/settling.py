"""Small rigid motions that lay one surface onto another: iterated closest points along the normals."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.clouds.local_surface import LocalSurface, moved_points
from gmmjax.clouds.neighbours import nearest_neighbours

# The reach of the residuals shrinks by this factor a step, from the first to the last.
SHRINKING = 0.75
# A motion that nothing determines, such as one along a wall, is not made.
DAMPING = 1e-2
# Settled: the last step moved the points by no more than this share of the last reach, on average.
STANDSTILL = 0.02
# A point is kept apart from the surface sideways by this many reaches at most.
SIDEWAYS = 4.0
# Cosine above which two steps go in one direction, and may be lengthened.
ALIGNED = 0.9


def settled(
    means: Float[np.ndarray, "n 3"],
    target: LocalSurface,
    start: Float[np.ndarray, "4 4"],
    first_reach: float,
    last_reach: float,
    steps: int,
    damping: float = DAMPING,
    extrapolation: float = 1.0,
) -> Float[np.ndarray, "4 4"]:
    """The rigid motion that lays one surface onto another, from a start that is nearly right.

    Local means of the one are held against the planes of the nearest points of the other (Chen and Medioni 1992). The
    weights of Geman and McClure, whose scale shrinks from step to step, leave out what has no counterpart.

    Args:
        means: local means of the surface that is moved.
        target: the surface that stays.
        start: motion to start from.
        first_reach: offset at which a point has a quarter of its weight, in the first step.
        last_reach: the same in the last steps; some standard deviations of the offsets.
        steps: how many at the most; fewer where the source stands still.
        damping: a direction of motion that only this fraction of the points determines is damped by half.
        extrapolation: factor by which a step is lengthened, at most, where steps in one direction shrink slowly (Besl
            and McKay 1992, accelerated ICP). 1: no step is.
    """
    transform = start
    previous = None
    for step in range(steps):
        placed = moved_points(means, transform)
        distances, nearest = nearest_neighbours(target.tree, placed, 1)
        there = nearest[:, 0]
        normals = target.normals[there]
        offsets = ((placed - target.centres[there]) * normals).sum(axis=1)
        reach = max(last_reach, first_reach * SHRINKING**step)
        weights = _weights(offsets / reach) * _weights(distances[:, 0] / (SIDEWAYS * reach))
        motion = _small_motion(placed, normals, offsets, weights, damping)
        factor = min(extrapolation, _remaining(previous, motion)) if reach == last_reach else 1.0
        # After a long step the next one tells nothing of how they shrink.
        previous = motion if factor == 1.0 else None
        transform = _motion(factor * motion, placed.mean(axis=0), _size(placed)) @ transform
        moved_by = np.sqrt(((moved_points(means, transform) - placed) ** 2).sum(axis=1).mean())
        if reach == last_reach and moved_by < STANDSTILL * last_reach:
            break
    return transform


def _weights(residuals: np.ndarray) -> np.ndarray:
    return 1 / (1 + residuals**2) ** 2


def determined_part(
    transform: Float[np.ndarray, "4 4"],
    means: Float[np.ndarray, "n 3"],
    target: LocalSurface,
    reach: float,
    least_information: float,
) -> Float[np.ndarray, "4 4"]:
    """A small rigid motion without what the normals do not determine, such as a translation along a plane.

    Args:
        transform: the motion, linear in its angles.
        means: local means of the surface that is moved.
        target: the surface that stays.
        reach: offset at which a point has a quarter of its weight.
        least_information: mean squared cosine, over the points, between the normals and a direction of motion, below
            which the direction is not determined.
    """
    placed = moved_points(means, transform)
    there = nearest_neighbours(target.tree, placed, 1)[1][:, 0]
    normals = target.normals[there]
    weights = _weights(((placed - target.centres[there]) * normals).sum(axis=1) / reach)
    centre, size = means.mean(axis=0), _size(means)
    rows = _rows(means, normals, centre, size)
    information, directions = np.linalg.eigh(rows.T @ (weights[:, None] * rows))
    determined = directions[:, information > least_information * max(weights.sum(), 1e-12)]
    moved_centre = moved_points(centre[None], transform)[0]
    motion = np.concatenate([size * Rotation.from_matrix(transform[:3, :3]).as_rotvec(), moved_centre - centre])
    return _motion(determined @ (determined.T @ motion), centre, size)


def _small_motion(
    points: np.ndarray, normals: np.ndarray, offsets: np.ndarray, weights: np.ndarray, damping: float
) -> np.ndarray:
    """Angles, times the size, and translation that take the offsets away in weighted least squares."""
    centre, size = points.mean(axis=0), _size(points)
    rows = _rows(points, normals, centre, size)
    normal_matrix = rows.T @ (weights[:, None] * rows)
    ridge = damping * max(weights.sum(), 1e-12) * np.eye(6)
    return np.asarray(np.linalg.solve(normal_matrix + ridge, -rows.T @ (weights * offsets)))


def _remaining(previous: np.ndarray | None, motion: np.ndarray) -> float:
    """By what factor a step would reach where a geometric series of such steps ends; 1 where they are none."""
    if previous is None:
        return 1.0
    lengths = np.linalg.norm(previous), np.linalg.norm(motion)
    if min(lengths) == 0 or previous @ motion < ALIGNED * lengths[0] * lengths[1]:
        return 1.0
    return float(1 / max(1 - lengths[1] / lengths[0], np.finfo(np.float64).eps))


def _size(points: np.ndarray) -> float:
    """Root mean square distance of the points from their centre."""
    return max(float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())), np.finfo(np.float64).tiny)


def _rows(points: np.ndarray, normals: np.ndarray, centre: np.ndarray, size: float) -> np.ndarray:
    """Derivatives of the offsets by a motion: angles about the centre, times the size, and the translation."""
    return np.concatenate([np.cross((points - centre) / size, normals), normals], axis=1)


def _motion(parameters: np.ndarray, centre: np.ndarray, size: float) -> np.ndarray:
    """The transform of these parameters."""
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(parameters[:3] / size).as_matrix()
    transform[:3, 3] = parameters[3:] + centre - transform[:3, :3] @ centre
    return transform
