"""Candidate rigid transforms between two scanned objects: coarse ICP from many rotations, then point-to-plane ICP.

The numbers come from development on the scenes of docs/results.md.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.prepare.resolution import usual_spacing
from gmmjax.geometry import (
    LocalSurface,
    evenly_chosen,
    point_to_plane_icp,
    rigid_transform,
    rotation_about,
    transformed,
)
from gmmjax.pair import Pair

# Point-to-point ICP: points of either object at most, steps from every start, the best starts that are continued, and
# their further steps. A start with fewer pairs of closest points is abandoned.
COARSE_SAMPLE, FIRST_STEPS, CONTINUED, LAST_STEPS, FEWEST_PAIRS = 150, 5, 24, 8, 6
# Largest distance of closest points in its first step, in root mean square radii: from any start, and from a near one.
FIRST_DISTANCE, FIRST_DISTANCE_NEAR = 1.0, 0.3
# Transforms that bring no point further apart are one, in largest distances of closest points in the last step.
DUPLICATE = 0.5
# Point-to-plane ICP: local means at most; reaches of the first step from a coarse and from a good start, and of the
# last steps, in standard deviations of the noise.
SAMPLE, FIRST_REACH, REFINED_FIRST_REACH, LAST_REACH = 350, 16.0, 4.0, 3.0


def rigid_matches(
    parts: Pair[LocalSurface], noise: float, count: int, starts: Float[np.ndarray, "s 4 4"] | None = None
) -> list[Float[np.ndarray, "4 4"]]:
    """Search the most promising transforms from one object to another, the best first.

    Args:
        parts: both objects.
        noise: standard deviation of the offset between local means of one surface, which see offsets far below the
            noise of a point.
        count: number of transforms, at most.
        starts: transforms that one is near to; None: centroid onto centroid, in any orientation.
    """
    points, first_distance = parts.map(lambda part: part.points), FIRST_DISTANCE_NEAR
    if starts is None:
        first_distance, means = FIRST_DISTANCE, points.map(lambda own: own.mean(axis=0))
        # The rotations of the icosahedron: the identity, and 59 others that are spread evenly.
        rotations = Rotation.create_group("I").as_matrix()
        starts = np.stack([rotation_about(rotation, *means) for rotation in rotations])
    coarse = _coarse_matches(points, starts, first_distance, count)
    return [refined(parts, start, noise, FIRST_REACH) for start in coarse]


def refined(
    parts: Pair[LocalSurface],
    start: Float[np.ndarray, "4 4"],
    noise: float,
    first_reach: float = REFINED_FIRST_REACH,
    sample: int = SAMPLE,
    moving: Int[np.ndarray, " m"] | None = None,
) -> Float[np.ndarray, "4 4"]:
    """Refine a transform between two objects by point-to-plane ICP on local means.

    Args:
        parts: both objects.
        start: transform from the first to the second.
        noise: of `rigid_matches`.
        first_reach: reach of the first step, in standard deviations of the noise.
        sample: number of local means, at most.
        moving: indices of the points of the first object that move; None: all.
    """
    moving = np.arange(len(parts.before)) if moving is None else moving
    means = parts.before.means(moving[evenly_chosen(len(moving), sample)])
    return point_to_plane_icp(means, parts.after, start, first_reach * noise, LAST_REACH * noise)


def best_starts(
    moving: Pair[Float[np.ndarray, "_ 3"]],
    objects: Pair[LocalSurface],
    starts: Float[np.ndarray, "s 4 4"],
    count: int,
) -> list[Float[np.ndarray, "4 4"]]:
    """Search the best distinct motions, by point-to-point ICP, of objects of which only some points are known to move.

    Args:
        moving: the points of either object that move.
        objects: what they may be a part of, before and after the motion.
        starts: transforms to start from.
        count: number of motions, at most.
    """
    few = moving.map(lambda points: points[evenly_chosen(len(points), COARSE_SAMPLE)])
    last = 2 * max(own.nearest_distance for own in objects)
    search = _CoarseSearch(few.before, objects.after.points, objects.after.tree, last)
    back = _CoarseSearch(few.after, objects.before.points, objects.before.tree, last)
    first = FIRST_DISTANCE_NEAR * float(np.sqrt(np.concatenate([*few]).var(axis=0).sum()))
    coarse = np.concatenate([starts, search.continued(starts, first, 0, FIRST_STEPS)])
    remaining = search.remaining(coarse) + back.remaining(np.linalg.inv(coarse))
    return _without_duplicates(coarse[np.argsort(remaining, kind="stable")], few.before, DUPLICATE * last, count)


def _coarse_matches(
    points: Pair[Float[np.ndarray, "_ 3"]], starts: Float[np.ndarray, "s 4 4"], first_distance: float, count: int
) -> list[Float[np.ndarray, "4 4"]]:
    """The distinct results of point-to-point ICP from all starts, the best first."""
    few = points.map(lambda own: own[evenly_chosen(len(own), COARSE_SAMPLE)])
    last = 2 * max(usual_spacing(own) for own in few)
    first = first_distance * float(np.sqrt(few.after.var(axis=0).sum()))
    search = _CoarseSearch(few.before, few.after, cKDTree(few.after), last)
    coarse = search.best_first(search.continued(starts, first, 0, FIRST_STEPS))[:CONTINUED]
    coarse = search.best_first(search.continued(coarse, first, FIRST_STEPS, LAST_STEPS))
    return _without_duplicates(coarse, few.before, DUPLICATE * last, count)


class _CoarseSearch(NamedTuple):
    """Point-to-point ICP from many starts at once.

    Attributes:
        source: points that are moved.
        target: points that stay.
        tree: of the target.
        last: least limit of the distance of closest points.
    """

    source: Float[np.ndarray, "n 3"]
    target: Float[np.ndarray, "m 3"]
    tree: cKDTree
    last: float

    def continued(
        self, transforms: Float[np.ndarray, "s 4 4"], first: float, done: int, steps: int
    ) -> Float[np.ndarray, "s 4 4"]:
        """The transforms after more steps, on pairs within a distance that shrinks from the first to the last one."""
        for step in range(done, done + steps):
            distances, nearest = self._closest(transforms, max(self.last, first * 0.5 ** (step / 2)))
            near = np.isfinite(distances)
            fitted = _min_squares_transforms(self.source, self.target[np.where(near, nearest, 0)], near.astype(float))
            transforms = np.where((near.sum(axis=1) >= FEWEST_PAIRS)[:, None, None], fitted, transforms)
        return transforms

    def best_first(self, transforms: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, "s 4 4"]:
        """The transforms by the mean distance of closest points that each leaves in both directions.

        Backwards, the target's points are looked up in the source: the distances are the same there.
        """
        there = self.remaining(transforms)
        offsets = self.target[None] - transforms[:, None, :3, 3]
        moved_back = np.einsum("sji,smj->smi", transforms[:, :3, :3], offsets)
        back = cKDTree(self.source).query(moved_back, distance_upper_bound=self.last)[0]
        return transforms[np.argsort(there + np.minimum(back, self.last).mean(axis=1), kind="stable")]

    def remaining(self, transforms: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, " s"]:
        """The mean distance of the source's points from the target after each transform, at most the last limit."""
        return np.asarray(np.minimum(self._closest(transforms, self.last)[0], self.last).mean(axis=1))

    def _closest(
        self, transforms: Float[np.ndarray, "s 4 4"], limit: float
    ) -> tuple[Float[np.ndarray, "s n"], Int[np.ndarray, "s n"]]:
        placed = np.einsum("sij,nj->sni", transforms[:, :3, :3], self.source) + transforms[:, None, :3, 3]
        return self.tree.query(placed, distance_upper_bound=limit)


def _min_squares_transforms(
    source: Float[np.ndarray, "n 3"], goals: Float[np.ndarray, "s n 3"], weights: Float[np.ndarray, "s n"]
) -> Float[np.ndarray, "s 4 4"]:
    """The rigid transforms of the same points to many sets of goals, of which some have no weight (Kabsch 1976)."""
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
    apart: float,
    count: int,
) -> list[Float[np.ndarray, "4 4"]]:
    """The first transforms that bring some point further than this from where every one before them brings it."""
    # A rigid transform is determined by three points; a dozen, evenly chosen, are hardly in one line.
    few = points[evenly_chosen(len(points), 12)]
    kept: list[np.ndarray] = []
    places = np.empty((0, *few.shape))
    for transform in transforms:
        placed = transformed(few, transform)
        if (np.linalg.norm(placed - places, axis=2).max(axis=1) > apart).all():
            kept.append(transform)
            places = np.concatenate([places, placed[None]])
        if len(kept) == count:
            break
    return kept
