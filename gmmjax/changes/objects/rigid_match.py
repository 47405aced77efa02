"""Rigid motions that may lay one scanned object onto another: closest points from many turns, then settled."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.geometry.icp import IcpSettings, point_to_plane_icp
from gmmjax.geometry.local_surface import LocalSurface, evenly_chosen
from gmmjax.geometry.neighbours import nearest_neighbours
from gmmjax.geometry.rigid import least_squares_transform, rigid_transform, transformed

# Points that are laid onto the other object: at first, and to settle.
COARSE_SAMPLE, FINE_SAMPLE = 200, 500
COARSE_STEPS = 12
FEWEST = 6
# Starts: turns about each axis of the frame by so many steps of a full turn.
TURNS = 12
# How far the closest points may be at first, by the size of the object: anywhere, or where the motion is roughly known.
ANYWHERE, ABOUT = 1.0, 0.3
# Motions that bring no point further apart than this share of the closest points' last reach are one.
SAME_MOTION = 0.5
# In standard deviations of the offsets.
FIRST_REACH, LAST_REACH = 16.0, 3.0
# The best are settled once more, on more points.
LAST_SAMPLE, LAST_FIRST_REACH, LAST_ICP = 2000, 4.0, IcpSettings(steps=10)


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
    to_origin = rigid_transform(translation=-source.points.mean(axis=0))
    back = rigid_transform(translation=target.points.mean(axis=0))
    turns = [rigid_transform(turn) for turn in _turns()]
    return _promising(source, target, [back @ turn @ to_origin for turn in turns], ANYWHERE, noise, count)


def matches_about(
    source: LocalSurface, target: LocalSurface, motions: Sequence[Float[np.ndarray, "4 4"]], noise: float, count: int
) -> list[Float[np.ndarray, "4 4"]]:
    """As `rigid_matches`, but only motions about those given.

    Args:
        source: the first object.
        target: the second.
        motions: where to start.
        noise: of `rigid_matches`.
        count: of motions.
    """
    return _promising(source, target, motions, ABOUT, noise, count)


def settled_match(
    source: LocalSurface, target: LocalSurface, motion: Float[np.ndarray, "4 4"], noise: float
) -> Float[np.ndarray, "4 4"]:
    """One of these motions, settled on more of the points."""
    means = source.means(evenly_chosen(len(source), LAST_SAMPLE))
    return point_to_plane_icp(means, target, motion, LAST_FIRST_REACH * noise, LAST_REACH * noise, LAST_ICP)


def _promising(
    source: LocalSurface,
    target: LocalSurface,
    motions: Sequence[np.ndarray],
    first_reach: float,
    noise: float,
    count: int,
) -> list[Float[np.ndarray, "4 4"]]:
    """Closest points from all motions; those that bring either object nearest to the other, settled."""
    few = [surface.points[evenly_chosen(len(surface), COARSE_SAMPLE)] for surface in (source, target)]
    trees = cKDTree(few[0]), cKDTree(few[1])
    reach = 2 * max(float(np.median(nearest_neighbours(tree, tree.data, 2)[0][:, -1])) for tree in trees)
    size = first_reach * float(np.sqrt(((few[1] - few[1].mean(axis=0)) ** 2).sum(axis=1).mean()))
    starts = [_closest_points(few[0], few[1], trees[1], motion, reach, size) for motion in motions]
    starts = _distinct(sorted(starts, key=lambda start: start.distance), few[0], SAME_MOTION * reach)
    means, reaches = source.means(evenly_chosen(len(source), FINE_SAMPLE)), (FIRST_REACH * noise, LAST_REACH * noise)
    return [point_to_plane_icp(means, target, start.transform, *reaches) for start in starts[:count]]


def _distinct(starts: Sequence[_Start], points: np.ndarray, apart: float) -> list[_Start]:
    """The starts that bring some point further apart than this from where the ones before them bring it."""
    few = points[evenly_chosen(len(points), 12)]
    kept: list[_Start] = []
    places: list[np.ndarray] = []
    for start in starts:
        placed = transformed(few, start.transform)
        if all(np.linalg.norm(placed - other, axis=1).max() > apart for other in places):
            kept.append(start)
            places.append(placed)
    return kept


def _closest_points(
    source: np.ndarray, target: np.ndarray, tree: cKDTree, motion: np.ndarray, reach: float, size: float
) -> _Start:
    """Closest points, kept where they are within a reach that shrinks from the given size to the points' spacing."""
    transform = motion
    for step in range(COARSE_STEPS):
        placed = transformed(source, transform)
        distances, nearest = tree.query(placed, distance_upper_bound=max(reach, size * 0.5 ** (step / 2)))
        near = np.isfinite(distances)
        if near.sum() < FEWEST:
            return _Start(transform, 2 * reach)
        transform = least_squares_transform(source[near], target[nearest[near]])
    placed = transformed(source, transform)
    there, back = tree.query(placed)[0], cKDTree(placed).query(target)[0]
    return _Start(transform, float(sum(np.minimum(distances, reach).mean() for distances in (there, back))))


def _turns() -> list[np.ndarray]:
    angles = np.arange(1, TURNS) * 2 * np.pi / TURNS
    turned = [Rotation.from_rotvec(angle * axis).as_matrix() for axis in np.eye(3) for angle in angles]
    return [np.eye(3), *turned]
