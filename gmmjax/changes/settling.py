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


def settled(
    means: Float[np.ndarray, "n 3"],
    target: LocalSurface,
    start: Float[np.ndarray, "4 4"],
    first_reach: float,
    last_reach: float,
    steps: int,
    least_information: float | None = None,
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
        least_information: mean squared cosine, over the points, between the normals and a direction of motion, below
            which there is no motion in that direction, such as along a plane. None: such motions are only damped.
    """
    transform = start
    for step in range(steps):
        placed = moved_points(means, transform)
        distances, nearest = nearest_neighbours(target.tree, placed, 1)
        there = nearest[:, 0]
        normals = target.normals[there]
        offsets = ((placed - target.centres[there]) * normals).sum(axis=1)
        reach = max(last_reach, first_reach * SHRINKING**step)
        weights = _weights(offsets / reach) * _weights(distances[:, 0] / (SIDEWAYS * reach))
        transform = _small_motion(placed, normals, offsets, weights, least_information) @ transform
        moved_by = np.sqrt(((moved_points(means, transform) - placed) ** 2).sum(axis=1).mean())
        if reach == last_reach and moved_by < STANDSTILL * last_reach:
            break
    return transform


def _weights(residuals: np.ndarray) -> np.ndarray:
    return 1 / (1 + residuals**2) ** 2


def _small_motion(
    points: np.ndarray, normals: np.ndarray, offsets: np.ndarray, weights: np.ndarray, least_information: float | None
) -> np.ndarray:
    """The motion that takes the offsets away in weighted least squares, linear in its angles."""
    centre = points.mean(axis=0)
    size = max(float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean())), np.finfo(np.float64).tiny)
    # Angles in units of the size, so that the damping weighs turns and shifts alike.
    rows = np.concatenate([np.cross((points - centre) / size, normals), normals], axis=1)
    normal_matrix = rows.T @ (weights[:, None] * rows)
    gradient = -rows.T @ (weights * offsets)
    total = max(weights.sum(), 1e-12)
    if least_information is None:
        solution = np.linalg.solve(normal_matrix + DAMPING * total * np.eye(6), gradient)
    else:
        information, directions = np.linalg.eigh(normal_matrix)
        determined = directions[:, information > max(least_information, np.finfo(np.float64).eps) * total]
        solution = determined @ np.linalg.solve(determined.T @ normal_matrix @ determined, determined.T @ gradient)
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(solution[:3] / size).as_matrix()
    transform[:3, 3] = solution[3:] + centre - transform[:3, :3] @ centre
    return transform
