"""Candidate rigid transforms between two scanned objects: coarse ICP from many rotations, then point-to-plane ICP."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.prepare.resolution import usual_spacing
from gmmjax.geometry import (
    IcpSettings,
    LocalSurface,
    evenly_chosen,
    least_squares_transform,
    point_to_plane_icp,
    rigid_transform,
    transformed,
)


@dataclasses.dataclass(frozen=True)
class RigidMatchSettings:
    """How transforms between two objects are searched.

    All values are empirical: they come from development on the scenes of docs/results.md. Reaches of
    point-to-plane ICP are in standard deviations of the offset between local means of one surface.

    Attributes:
        coarse_sample: number of points of either object, at most, in the point-to-point ICP from every start.
        coarse_steps: number of its steps. 0: the starts are ranked as they are.
        fewest_correspondences: a start with fewer pairs of closest points is abandoned. 0: none is.
        rotations: starts per full turn about each coordinate axis. 1: only the objects' present orientation.
        first_distance: largest distance of closest points in the first coarse step, in root mean square radii of the
            target. Infinite: no limit.
        first_distance_near: the same where the transform is roughly known.
        duplicate: transforms that bring no point further apart than this, in the limit of the distance of closest
            points in the last coarse step, are duplicates; the best of them is kept. 0: all are kept.
        sample: number of local means, at most, in the point-to-plane ICP of the most promising transforms.
        first_reach: of its first step.
        last_reach: of its last steps, and of those of the refinement.
        icp: how it proceeds.
        refined_sample: number of local means, at most, in the refinement of a transform.
        refined_first_reach: of the refinement's first step.
        refined_icp: how the refinement proceeds.
    """

    coarse_sample: int = 200
    coarse_steps: int = 12
    fewest_correspondences: int = 6
    rotations: int = 12
    first_distance: float = 1.0
    first_distance_near: float = 0.3
    duplicate: float = 0.5
    sample: int = 500
    first_reach: float = 16.0
    last_reach: float = 3.0
    icp: IcpSettings = IcpSettings()
    refined_sample: int = 2000
    refined_first_reach: float = 4.0
    refined_icp: IcpSettings = IcpSettings(steps=10)


class _Start(NamedTuple):
    """A transform, and the mean distance of closest points that it leaves, summed over both objects."""

    transform: Float[np.ndarray, "4 4"]
    distance: float


def rigid_matches(
    source: LocalSurface,
    target: LocalSurface,
    noise: float,
    count: int,
    settings: RigidMatchSettings = RigidMatchSettings(),
) -> list[Float[np.ndarray, "4 4"]]:
    """The most promising transforms from the source to the target, in the order of their closest points' distance.

    The best of many starts are registered by point-to-plane ICP on local means, which see offsets far below the noise
    of a point.

    Args:
        source: the first object.
        target: the second.
        noise: standard deviation of the offset between local means of one surface, the registration error of
            `DetectionLimits`.
        count: number of transforms, at most.
        settings: how they are searched.
    """
    to_origin = rigid_transform(translation=-source.points.mean(axis=0))
    back = rigid_transform(translation=target.points.mean(axis=0))
    starts = [back @ rigid_transform(rotation) @ to_origin for rotation in _rotations(settings.rotations)]
    return _promising(source, target, starts, settings.first_distance, noise, count, settings)


def rigid_matches_near(
    source: LocalSurface,
    target: LocalSurface,
    starts: Sequence[Float[np.ndarray, "4 4"]],
    noise: float,
    count: int,
    settings: RigidMatchSettings = RigidMatchSettings(),
) -> list[Float[np.ndarray, "4 4"]]:
    """As `rigid_matches`, but only from the given transforms and near them.

    Args:
        source: the first object.
        target: the second.
        starts: transforms to start from.
        noise: of `rigid_matches`.
        count: number of transforms, at most.
        settings: how they are searched.
    """
    return _promising(source, target, starts, settings.first_distance_near, noise, count, settings)


def refined_match(
    source: LocalSurface,
    target: LocalSurface,
    transform: Float[np.ndarray, "4 4"],
    noise: float,
    settings: RigidMatchSettings = RigidMatchSettings(),
) -> Float[np.ndarray, "4 4"]:
    """A transform of `rigid_matches`, refined by point-to-plane ICP on more of the points."""
    means = source.means(evenly_chosen(len(source), settings.refined_sample))
    first_reach, last_reach = settings.refined_first_reach * noise, settings.last_reach * noise
    return point_to_plane_icp(means, target, transform, first_reach, last_reach, settings.refined_icp)


def _promising(
    source: LocalSurface,
    target: LocalSurface,
    starts: Sequence[Float[np.ndarray, "4 4"]],
    first_distance: float,
    noise: float,
    count: int,
    settings: RigidMatchSettings,
) -> list[Float[np.ndarray, "4 4"]]:
    """Coarse ICP from all starts; the best distinct results after point-to-plane ICP."""
    few = [surface.points[evenly_chosen(len(surface), settings.coarse_sample)] for surface in (source, target)]
    last = 2 * max(usual_spacing(points) for points in few)
    first = first_distance * float(np.sqrt(((few[1] - few[1].mean(axis=0)) ** 2).sum(axis=1).mean()))
    tree = cKDTree(few[1])
    coarse = [_coarse_icp(few[0], few[1], tree, start, first, last, settings) for start in starts]
    distinct = _without_duplicates(sorted(coarse, key=lambda start: start.distance), few[0], settings.duplicate * last)
    means = source.means(evenly_chosen(len(source), settings.sample))
    reaches = settings.first_reach * noise, settings.last_reach * noise
    return [point_to_plane_icp(means, target, start.transform, *reaches, settings.icp) for start in distinct[:count]]


def _without_duplicates(
    starts: Sequence[_Start], points: Float[np.ndarray, "n 3"], largest_distance: float
) -> list[_Start]:
    """The starts that bring some point further than this from where every start before them brings it."""
    # A rigid transform is determined by three points; a dozen, evenly chosen, are hardly in one line.
    few = points[evenly_chosen(len(points), 12)]
    kept: list[_Start] = []
    places: list[np.ndarray] = []
    for start in starts:
        placed = transformed(few, start.transform)
        if all(np.linalg.norm(placed - other, axis=1).max() > largest_distance for other in places):
            kept.append(start)
            places.append(placed)
    return kept


def _coarse_icp(
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "m 3"],
    tree: cKDTree,
    start: Float[np.ndarray, "4 4"],
    first: float,
    last: float,
    settings: RigidMatchSettings,
) -> _Start:
    """Point-to-point ICP on pairs within a distance that shrinks from the first to the last one."""
    transform = start
    for step in range(settings.coarse_steps):
        placed = transformed(source, transform)
        distances, nearest = tree.query(placed, distance_upper_bound=max(last, first * 0.5 ** (step / 2)))
        near = np.isfinite(distances)
        if near.sum() < settings.fewest_correspondences:
            return _Start(transform, 2 * last)
        transform = least_squares_transform(source[near], target[nearest[near]])
    placed = transformed(source, transform)
    there, back = tree.query(placed)[0], cKDTree(placed).query(target)[0]
    return _Start(transform, float(sum(np.minimum(distances, last).mean() for distances in (there, back))))


def _rotations(per_axis: int) -> list[Float[np.ndarray, "3 3"]]:
    """The identity, and rotations about each coordinate axis in this number of steps a full turn."""
    angles = np.arange(1, per_axis) * 2 * np.pi / per_axis
    rotated = [Rotation.from_rotvec(angle * axis).as_matrix() for axis in np.eye(3) for angle in angles]
    return [np.eye(3), *rotated]
