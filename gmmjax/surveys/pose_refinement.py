"""Poses of frames, moved a little so that the frames' surfaces lie on each other."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.clouds import voxel_grid
from gmmjax.geometry import (
    LocalSurface,
    evenly_chosen,
    geman_mcclure,
    nearest_neighbours,
    offset_derivatives,
    transformed,
)

# The planes of a frame go through the means of voxels of this size, metres.
VOXEL = 0.03
# A neighbourhood is a plane when it deviates from one by less than this share of its half width.
FLATNESS = 0.2
# Points of a frame that are laid onto another one, and that tell whether the two overlap.
SAMPLE, OVERLAP_SAMPLE = 800, 200
# Two frames overlap when this share of those points is so near to the other frame (metres). Each frame is held against
# those it overlaps most.
MIN_OVERLAP, NEAR, MAX_PARTNERS = 0.1, 0.1, 8
# The offsets at which a pair of points has a quarter of its weight, step by step, metres; points further from each
# other than this number of them are no pair, nor are points whose normals are further apart than this cosine.
REACHES = (0.04, 0.03, 0.02, 0.015, 0.015, 0.01, 0.01)
FARTHEST, ALIKE = 4.0, 0.9
# What the given poses are off by, metres and radians, and how many of the offsets' squares (square metres) a square of
# that is worth. It holds still what no surface determines: the place along a wall, and that of all frames together.
POSE_SHIFT, POSE_TURN, PRIOR_WEIGHT = 0.02, 0.01, 4e-4
# The poses are refined when the usual offset, seen with this reach (metres), falls to this share of what it was.
JUDGED_REACH, NEEDED = 0.02, 0.5
# And no frame is moved or turned further: such a motion corrects no error of a pose. Metres and radians.
MAX_SHIFT, MAX_TURN = 0.1, 0.05


class _Planes(NamedTuple):
    """The flat neighbourhoods of a frame in its own coordinates: centres, unit normals, tree of the centres."""

    centres: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    tree: cKDTree


class _Matches(NamedTuple):
    """Points of one frame on the planes of another one, in the world."""

    places: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    offsets: Float64[np.ndarray, " n"]


def refined_poses(
    clouds: Sequence[Float64[np.ndarray, "_ 3"]], poses: Float64[np.ndarray, "v 4 4"]
) -> Float64[np.ndarray, "v 4 4"]:
    """The poses with which the frames lie on each other, for all frames at once.

    Iterated closest points along the normals (Chen and Medioni 1992) between all pairs of frames that overlap; each
    step is one least-squares problem in all poses, with the weights of Geman and McClure and the given poses as prior.

    Args:
        clouds: of each frame the points in the coordinates of its sensor, metres.
        poses: sensor to world, off by some centimetres and by a degree at the most.

    Returns:
        The poses; the same array where the frames do not lie on each other better afterwards, or where one would have
        to be moved further than poses are off.
    """
    frames = [_planes(cloud) for cloud in clouds]
    pairs = _overlapping_pairs(frames, poses)
    if not pairs:
        return poses
    found = poses
    for reach in REACHES:
        found = _step(frames, pairs, found, poses, reach)
    turns, shifts = _deviations(found, poses)
    small = np.linalg.norm(turns, axis=1).max() < MAX_TURN and np.linalg.norm(shifts, axis=1).max() < MAX_SHIFT
    better = _usual_offset(frames, pairs, found) < NEEDED * _usual_offset(frames, pairs, poses)
    return found if small and better else poses


def _planes(cloud: Float64[np.ndarray, "n 3"]) -> _Planes:
    if not len(cloud):
        return _Planes(cloud, cloud, cKDTree(cloud))
    surface = LocalSurface.of(voxel_grid(cloud, VOXEL).points)
    thickness, width, length = np.sqrt(surface.variances).T
    # What is longer than a neighbourhood of voxels is stray points.
    flat = (thickness < FLATNESS * width) & (length < 4 * VOXEL)
    return _Planes(surface.centres[flat], surface.normals[flat], cKDTree(surface.centres[flat]))


def _overlapping_pairs(frames: Sequence[_Planes], poses: Float64[np.ndarray, "v 4 4"]) -> list[tuple[int, int]]:
    """Each frame with the others that it overlaps most."""
    pairs = []
    for index, frame in enumerate(frames):
        chosen = evenly_chosen(len(frame.centres), OVERLAP_SAMPLE)
        places = transformed(frame.centres[chosen], poses[index])
        overlaps = np.zeros(len(frames))
        for other, planes in enumerate(frames):
            if other != index and len(places):
                distances, _ = planes.tree.query(_in_sensor(places, poses[other]), distance_upper_bound=NEAR)
                overlaps[other] = np.isfinite(distances).mean()
        most = np.argsort(-overlaps, kind="stable")[:MAX_PARTNERS]
        pairs += [(index, int(other)) for other in most if overlaps[other] >= MIN_OVERLAP]
    return pairs


def _matches(
    frames: Sequence[_Planes], pair: tuple[int, int], poses: Float64[np.ndarray, "v 4 4"], reach: float
) -> _Matches:
    """Points of the first frame of a pair with the nearest planes of the second one."""
    first, second = (frames[index] for index in pair)
    own, other = (poses[index] for index in pair)
    chosen = evenly_chosen(len(first.centres), SAMPLE)
    places = transformed(first.centres[chosen], own)
    distances, nearest = nearest_neighbours(second.tree, _in_sensor(places, other), 1)
    normals = second.normals[nearest[:, 0]] @ other[:3, :3].T
    alike = np.abs((normals * (first.normals[chosen] @ own[:3, :3].T)).sum(axis=1)) > ALIKE
    kept = np.flatnonzero(alike & (distances[:, 0] < FARTHEST * reach))
    feet = transformed(second.centres[nearest[kept, 0]], other)
    return _Matches(places[kept], normals[kept], ((places[kept] - feet) * normals[kept]).sum(axis=1))


def _step(
    frames: Sequence[_Planes],
    pairs: Sequence[tuple[int, int]],
    poses: Float64[np.ndarray, "v 4 4"],
    given: Float64[np.ndarray, "v 4 4"],
    reach: float,
) -> Float64[np.ndarray, "v 4 4"]:
    """The poses after one step of Gauss and Newton, linear in the turns about the sensors and in the shifts."""
    count = len(poses)
    matrix, gradient = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    for pair in pairs:
        places, normals, offsets = _matches(frames, pair, poses, reach)
        weights = geman_mcclure(offsets / reach)
        # The offset grows as the first frame moves along the normal, and falls as the second one does.
        slopes = [
            sign * offset_derivatives(places, normals, poses[index, :3, 3])
            for sign, index in zip((1, -1), pair, strict=True)
        ]
        for index, own in zip(pair, slopes, strict=True):
            weighted = (weights[:, None] * own).T
            gradient[index] += weighted @ offsets
            for other, its in zip(pair, slopes, strict=True):
                matrix[index, :, other] += weighted @ its
    prior = np.repeat(PRIOR_WEIGHT / np.square([POSE_TURN, POSE_SHIFT]), 3)
    gradient += prior * np.concatenate(_deviations(poses, given), axis=1)
    matrix = matrix.reshape(6 * count, 6 * count) + np.diag(np.tile(prior, count))
    motions = np.linalg.solve(matrix, -gradient.ravel()).reshape(count, 6)
    moved = poses.copy()
    moved[:, :3, :3] = Rotation.from_rotvec(motions[:, :3]).as_matrix() @ poses[:, :3, :3]
    moved[:, :3, 3] += motions[:, 3:]
    return moved


def _deviations(
    poses: Float64[np.ndarray, "v 4 4"], given: Float64[np.ndarray, "v 4 4"]
) -> tuple[Float64[np.ndarray, "v 3"], Float64[np.ndarray, "v 3"]]:
    """Turns (radians) and shifts from the given poses."""
    turns = Rotation.from_matrix(poses[:, :3, :3] @ given[:, :3, :3].swapaxes(1, 2)).as_rotvec()
    return turns, poses[:, :3, 3] - given[:, :3, 3]


def _usual_offset(
    frames: Sequence[_Planes], pairs: Sequence[tuple[int, int]], poses: Float64[np.ndarray, "v 4 4"]
) -> float:
    offsets = np.concatenate([_matches(frames, pair, poses, JUDGED_REACH).offsets for pair in pairs])
    return float(np.median(np.abs(offsets))) if len(offsets) else np.inf


def _in_sensor(points: Float64[np.ndarray, "n 3"], pose: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "n 3"]:
    return np.asarray((points - pose[:3, 3]) @ pose[:3, :3])
