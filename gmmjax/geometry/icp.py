"""Robust point-to-plane ICP: the rigid transform that registers one surface to another from a close start.

Chen and Medioni (1992), with the weights of Geman and McClure, whose scale shrinks from step to step, so that points
without a counterpart lose their influence, and the extrapolation of Besl and McKay (1992, accelerated ICP).
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.geometry.neighbours import nearest_neighbours
from gmmjax.geometry.rigid import rotation_about, transformed


@dataclasses.dataclass(frozen=True)
class IcpSettings:
    """Settings of ICP. A reach is the residual at which a point has a quarter of its weight.

    Attributes:
        steps: at most.
        damping: a direction of motion that only this fraction of the points determines is damped by half, such as a
            translation along a wall. 0: noise moves a plane along itself, without end.
        shrinking: factor from the reach of one step to that of the next, down to the last. 1: it stays the first.
        converged: when the last step moved the points by at most this fraction of the last reach, root mean square.
            0: all steps are made.
        lateral: reach of the distance to the nearest point, in reaches of the offset along the normal. Infinite: points
            far from the surface count as long as they are near its planes.
        extrapolation: largest factor by which a step is lengthened where steps in one direction shrink slowly. 1: none.
        same_direction: cosine between two steps from which on they have one direction. 1: no step is lengthened.
    """

    steps: int = 12
    damping: float = 1e-2
    shrinking: float = 0.75
    converged: float = 0.02
    lateral: float = 4.0
    extrapolation: float = 1.0
    same_direction: float = 0.9


def point_to_plane_icp(
    means: Float[np.ndarray, "n 3"],
    target: LocalSurface,
    start: Float[np.ndarray, "4 4"],
    first_reach: float,
    last_reach: float,
    settings: IcpSettings = IcpSettings(),
) -> Float[np.ndarray, "4 4"]:
    """The rigid transform that brings local means of one surface onto the planes of another one.

    Args:
        means: local means of the surface that is moved.
        target: the surface that stays.
        start: transform to start from.
        first_reach: of the first step, in the unit of the points.
        last_reach: of the last steps; a few standard deviations of the offsets.
        settings: how to proceed.
    """
    transform = start
    previous = None
    for step in range(settings.steps):
        placed = transformed(means, transform)
        distances, nearest = nearest_neighbours(target.tree, placed, 1)
        there = nearest[:, 0]
        normals = target.normals[there]
        offsets = ((placed - target.centres[there]) * normals).sum(axis=1)
        reach = max(last_reach, first_reach * settings.shrinking**step)
        weights = geman_mcclure(offsets / reach) * geman_mcclure(distances[:, 0] / (settings.lateral * reach))
        centre, size = placed.mean(axis=0), _size(placed)
        rows = offset_derivatives(placed, normals, centre, size)
        motion = _gauss_newton_step(rows, offsets, weights, settings.damping)
        factor = min(settings.extrapolation, _extrapolation(previous, motion, settings)) if reach == last_reach else 1.0
        # After a long step the next one tells nothing of how they shrink.
        previous = motion if factor == 1.0 else None
        transform = _transform(factor * motion, centre, size) @ transform
        moved_by = np.sqrt(((transformed(means, transform) - placed) ** 2).sum(axis=1).mean())
        if reach == last_reach and moved_by < settings.converged * last_reach:
            break
    return transform


def determined_part(
    transform: Float[np.ndarray, "4 4"],
    means: Float[np.ndarray, "n 3"],
    target: LocalSurface,
    reach: float,
    min_information: float,
) -> Float[np.ndarray, "4 4"]:
    """A small rigid transform without what the normals do not determine, such as a translation along a plane.

    Args:
        transform: the transform, linear in its angles.
        means: local means of the surface that is moved.
        target: the surface that stays.
        reach: offset at which a point has a quarter of its weight.
        min_information: mean squared cosine, over the points, between the normals and a direction of motion, below
            which the direction is not determined.
    """
    placed = transformed(means, transform)
    there = nearest_neighbours(target.tree, placed, 1)[1][:, 0]
    normals = target.normals[there]
    weights = geman_mcclure(((placed - target.centres[there]) * normals).sum(axis=1) / reach)
    centre, size = means.mean(axis=0), _size(means)
    rows = offset_derivatives(means, normals, centre, size)
    information, directions = np.linalg.eigh(rows.T @ (weights[:, None] * rows))
    determined = directions[:, information > min_information * max(weights.sum(), 1e-12)]
    moved_centre = transformed(centre[None], transform)[0]
    motion = np.concatenate([size * Rotation.from_matrix(transform[:3, :3]).as_rotvec(), moved_centre - centre])
    return _transform(determined @ (determined.T @ motion), centre, size)


def geman_mcclure(residuals: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Weights of residuals in reaches: 1 at 0, a quarter at 1 (Geman and McClure 1987)."""
    return 1 / (1 + residuals**2) ** 2


def offset_derivatives(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, " 3"],
    size: float = 1.0,
) -> Float64[np.ndarray, "n 6"]:
    """Derivatives of the offsets along the normals by a rotation vector, times the size, and a translation."""
    return np.concatenate([np.cross((points - centre) / size, normals), normals], axis=1)


def _gauss_newton_step(rows: np.ndarray, offsets: np.ndarray, weights: np.ndarray, damping: float) -> np.ndarray:
    """Rotation vector, times the size, and translation that cancel the offsets in weighted least squares.

    `rows` are the offsets' derivatives.
    """
    normal_matrix = rows.T @ (weights[:, None] * rows)
    ridge = damping * max(weights.sum(), 1e-12) * np.eye(6)
    return np.asarray(np.linalg.solve(normal_matrix + ridge, -rows.T @ (weights * offsets)))


def _extrapolation(previous: np.ndarray | None, motion: np.ndarray, settings: IcpSettings) -> float:
    """The factor by which a step reaches the limit of a geometric series of such steps; 1 where they are none."""
    if previous is None:
        return 1.0
    lengths = np.linalg.norm(previous), np.linalg.norm(motion)
    if min(lengths) == 0 or previous @ motion < settings.same_direction * lengths[0] * lengths[1]:
        return 1.0
    return float(1 / max(1 - lengths[1] / lengths[0], np.finfo(np.float64).eps))


def _size(points: np.ndarray) -> float:
    """Root mean square distance of the points from their centre."""
    return max(float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())), np.finfo(np.float64).tiny)


def _transform(motion: np.ndarray, centre: np.ndarray, size: float) -> np.ndarray:
    """The transform of a rotation vector about the centre, times the size, and a translation."""
    rotation = Rotation.from_rotvec(motion[:3] / size).as_matrix()
    return rotation_about(rotation, centre, motion[3:] + centre)
