"""Candidate rigid transforms between two scanned objects: coarse ICP from many rotations, then point-to-plane ICP."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.prepare.resolution import usual_spacing
from gmmjax.geometry import (
    IcpSettings,
    LocalSurface,
    evenly_chosen,
    point_to_plane_icp,
    rigid_transform,
    transformed,
)
from gmmjax.pair import Pair


@dataclasses.dataclass(frozen=True)
class RigidMatchSettings:
    """How transforms between two objects are searched.

    All values are empirical: they come from development on the scenes of docs/results.md. Reaches of
    point-to-plane ICP are in standard deviations of the offset between local means of one surface.

    Attributes:
        coarse_sample: number of points of either object, at most, in the point-to-point ICP from every start.
        first_steps: number of its steps from every start. 0: the starts are ranked as they are.
        kept: number of starts, the best, that are continued. As many as there are starts: all of them.
        last_steps: number of steps of those.
        fewest_correspondences: a start with fewer pairs of closest points is abandoned. 0: none is.
        orientations: rotations, spread evenly over all there are, that a search starts from where nothing is known. 1:
            only the objects' present orientation.
        first_distance: largest distance of closest points in the first coarse step, in root mean square radii of the
            target. Infinite: no limit.
        first_distance_near: the same where the transform is roughly known.
        duplicate: transforms that bring no point further apart than this, in the limit of the distance of closest
            points in the last coarse step, are duplicates; the best of them is kept. 0: all are kept.
        equal: transforms that bring no point further apart than this after point-to-plane ICP are one, in standard
            deviations of the noise. 0: all are kept.
        sample: number of local means, at most, in the point-to-plane ICP of the most promising transforms.
        first_reach: of its first step.
        last_reach: of its last steps, and of those of the refinement.
        icp: how it proceeds.
        refined_sample: number of local means, at most, in the refinement of a transform.
        refined_first_reach: of the refinement's first step.
        refined_icp: how the refinement proceeds.
    """

    coarse_sample: int = 150
    first_steps: int = 5
    kept: int = 24
    last_steps: int = 8
    fewest_correspondences: int = 6
    orientations: int = 72
    first_distance: float = 1.0
    first_distance_near: float = 0.3
    duplicate: float = 0.5
    equal: float = 2.0
    sample: int = 350
    first_reach: float = 16.0
    last_reach: float = 3.0
    icp: IcpSettings = IcpSettings()
    refined_sample: int = 2000
    refined_first_reach: float = 4.0
    refined_icp: IcpSettings = IcpSettings(steps=10)


class Search(NamedTuple):
    """What a search for transforms starts from.

    Attributes:
        points: of either object by which the starts are compared: all, or those of the tops.
        starts: transforms [s, 4, 4] from the first object to the second.
        whole: whether the points are those of the whole objects; a start that brings the tops together is nearly right.
    """

    points: Pair[Float[np.ndarray, "_ 3"]]
    starts: Float[np.ndarray, "s 4 4"]
    whole: bool = True


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
    starts = back @ rigid_transform(_orientations(settings.orientations)) @ to_origin
    coarse = _coarse_matches(Pair(source.points, target.points), starts, settings.first_distance, count, settings)
    return _fine_matches(source, target, coarse, settings.first_reach * noise, noise, settings)


def rigid_matches_near(
    source: LocalSurface,
    target: LocalSurface,
    searches: Sequence[Search],
    noise: float,
    count: int,
    settings: RigidMatchSettings = RigidMatchSettings(),
) -> list[Float[np.ndarray, "4 4"]]:
    """As `rigid_matches`, but only from the given transforms and near them.

    Args:
        source: the first object.
        target: the second.
        searches: what they start from.
        noise: of `rigid_matches`.
        count: number of transforms of each search, at most.
        settings: how they are searched.
    """
    found: list[np.ndarray] = []
    for search in searches:
        coarse = _coarse_matches(search.points, search.starts, settings.first_distance_near, count, settings)
        first = settings.first_reach if search.whole else settings.refined_first_reach
        found += _fine_matches(source, target, coarse, first * noise, noise, settings)
    return _without_duplicates(found, source.points, settings.equal * noise)


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


def best_starts(
    moving: Pair[Float[np.ndarray, "_ 3"]],
    things: Pair[LocalSurface],
    starts: Float[np.ndarray, "s 4 4"],
    count: int,
    settings: RigidMatchSettings = RigidMatchSettings(),
) -> list[Float[np.ndarray, "4 4"]]:
    """The best distinct motions, after point-to-point ICP, of objects of which only some points are known to move.

    Args:
        moving: the points of either object that move.
        things: what they may be a part of, before and after the motion.
        starts: transforms to start from.
        count: number of motions, at most.
        settings: how they are searched.
    """
    few = moving.map(lambda points: points[evenly_chosen(len(points), settings.coarse_sample)])
    last = 2 * max(thing.nearest_distance for thing in things)
    first = settings.first_distance_near * float(np.sqrt(np.concatenate([*few]).var(axis=0).sum()))
    search = _CoarseSearch(few.before, things.after.points, things.after.tree, last, settings)
    back = _CoarseSearch(few.after, things.before.points, things.before.tree, last, settings)

    def ranked(transforms: np.ndarray) -> np.ndarray:
        left = search.left(transforms) + back.left(np.linalg.inv(transforms))
        return transforms[np.argsort(left, kind="stable")]

    coarse = np.concatenate([starts, search.continued(starts, first, 0, settings.first_steps)])
    return _without_duplicates(ranked(coarse), few.before, settings.duplicate * last, count)


def _coarse_matches(
    points: Pair[Float[np.ndarray, "_ 3"]],
    starts: Float[np.ndarray, "s 4 4"],
    first_distance: float,
    count: int,
    settings: RigidMatchSettings,
) -> list[Float[np.ndarray, "4 4"]]:
    """The distinct results of point-to-point ICP from all starts, the best first."""
    few = points.map(lambda own: own[evenly_chosen(len(own), settings.coarse_sample)])
    last = 2 * max(usual_spacing(own) for own in few)
    first = first_distance * float(np.sqrt(few.after.var(axis=0).sum()))
    search = _CoarseSearch(few.before, few.after, cKDTree(few.after), last, settings)
    coarse = search.continued(starts, first, 0, settings.first_steps)
    coarse = coarse[np.argsort(search.distances(coarse), kind="stable")[: settings.kept]]
    coarse = search.continued(coarse, first, settings.first_steps, settings.last_steps)
    coarse = coarse[np.argsort(search.distances(coarse), kind="stable")]
    return _without_duplicates(coarse, few.before, settings.duplicate * last, count)


def _fine_matches(
    source: LocalSurface,
    target: LocalSurface,
    starts: Sequence[Float[np.ndarray, "4 4"]],
    first_reach: float,
    noise: float,
    settings: RigidMatchSettings,
) -> list[Float[np.ndarray, "4 4"]]:
    """Point-to-plane ICP on local means from every start."""
    means, last = source.means(evenly_chosen(len(source), settings.sample)), settings.last_reach * noise
    return [point_to_plane_icp(means, target, start, first_reach, last, settings.icp) for start in starts]


class _CoarseSearch(NamedTuple):
    """Point-to-point ICP from many starts at once.

    Attributes:
        source: points that are moved.
        target: points that stay.
        tree: of the target.
        last: least limit of the distance of closest points.
        settings: how it proceeds.
    """

    source: Float[np.ndarray, "n 3"]
    target: Float[np.ndarray, "m 3"]
    tree: cKDTree
    last: float
    settings: RigidMatchSettings

    def continued(
        self, transforms: Float[np.ndarray, "s 4 4"], first: float, done: int, steps: int
    ) -> Float[np.ndarray, "s 4 4"]:
        """The transforms after more steps, on pairs within a distance that shrinks from the first to the last one."""
        for step in range(done, done + steps):
            distances, nearest = self._closest(transforms, max(self.last, first * 0.5 ** (step / 2)))
            near = np.isfinite(distances)
            goals = self.target[np.where(near, nearest, 0)]
            fitted = _least_squares_transforms(self.source, goals, near.astype(float))
            enough = near.sum(axis=1) >= self.settings.fewest_correspondences
            transforms = np.where(enough[:, None, None], fitted, transforms)
        return transforms

    def distances(self, transforms: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, " s"]:
        """The mean distance of closest points that each transform leaves, at most the last limit, in both directions.

        Backwards, the target's points are looked up in the source: the distances are the same there.
        """
        there = self.left(transforms)
        rotations = transforms[:, :3, :3]
        moved_back = np.einsum("sji,smj->smi", rotations, self.target[None] - transforms[:, None, :3, 3])
        back = cKDTree(self.source).query(moved_back, distance_upper_bound=self.last)[0]
        return np.asarray(there + np.minimum(back, self.last).mean(axis=1))

    def left(self, transforms: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, " s"]:
        """The mean distance of the source's points from the target after each transform, at most the last limit."""
        return np.asarray(np.minimum(self._closest(transforms, self.last)[0], self.last).mean(axis=1))

    def _closest(
        self, transforms: Float[np.ndarray, "s 4 4"], limit: float = np.inf
    ) -> tuple[Float[np.ndarray, "s n"], Int[np.ndarray, "s n"]]:
        placed = np.einsum("sij,nj->sni", transforms[:, :3, :3], self.source) + transforms[:, None, :3, 3]
        return self.tree.query(placed, distance_upper_bound=limit)


def _least_squares_transforms(
    source: Float[np.ndarray, "n 3"], goals: Float[np.ndarray, "s n 3"], weights: Float[np.ndarray, "s n"]
) -> Float[np.ndarray, "s 4 4"]:
    """`least_squares_transform` of the same points to many sets of goals, of which some have no weight."""
    total = np.maximum(weights.sum(axis=1), 1.0)[:, None]
    start, goal = weights @ source / total, np.einsum("sn,sni->si", weights, goals) / total
    centred = (goals - goal[:, None]) * weights[..., None]
    left, _, right = np.linalg.svd(np.einsum("sni,snj->sij", centred, source[None] - start[:, None]))
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    rotation = left @ right
    return rigid_transform(rotation, goal - np.einsum("sij,sj->si", rotation, start))


def _without_duplicates(
    transforms: Sequence[Float[np.ndarray, "4 4"]] | Float[np.ndarray, "s 4 4"],
    points: Float[np.ndarray, "n 3"],
    largest_distance: float,
    count: int | None = None,
) -> list[Float[np.ndarray, "4 4"]]:
    """The first transforms that bring some point further than this from where every one before them brings it."""
    # A rigid transform is determined by three points; a dozen, evenly chosen, are hardly in one line.
    few = points[evenly_chosen(len(points), 12)]
    kept: list[np.ndarray] = []
    places = np.empty((0, *few.shape))
    for transform in transforms:
        placed = transformed(few, transform)
        if (np.linalg.norm(placed - places, axis=2).max(axis=1) > largest_distance).all():
            kept.append(transform)
            places = np.concatenate([places, placed[None]])
        if len(kept) == count:
            break
    return kept


def _orientations(count: int) -> Float[np.ndarray, "r 3 3"]:
    """The identity, and rotations that are spread evenly over all orientations (Alexa 2022)."""
    steps = np.arange(count - 1) + 0.5
    inner, outer = np.sqrt(steps / max(count - 1, 1)), np.sqrt(1 - steps / max(count - 1, 1))
    # The golden ratio's kin for quaternions: sqrt 2, and the positive root of x^4 = x + 4.
    first, second = 2 * np.pi * steps / np.sqrt(2), 2 * np.pi * steps / 1.533751168755204288118041
    quaternions = np.stack(
        [inner * np.sin(first), inner * np.cos(first), outer * np.sin(second), outer * np.cos(second)], axis=1
    )
    rotations = Rotation.from_quat(quaternions).as_matrix() if count > 1 else np.zeros((0, 3, 3))
    return np.concatenate([np.eye(3)[None], rotations])
