"""The usual detectors, for comparison: cloud-to-cloud distance, voxel occupancy and M3C2, with density clusters.

All look at the clouds at the resolution that ours works at, and derive their lengths from the clouds by one rule each.
"""

import importlib.util
import logging
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.prepare.resolution import WorkingPair, working_pair
from gmmjax.errors import InputError
from gmmjax.geometry.density_clusters import density_clusters

# Lengths in units of the clouds' reach, which `Scale` describes. Each is the one of a coarse series that gave the best
# F1 over artificial scenes, simulated rooms and real scans together (docs/results.md): one that suits a single kind of
# scene better is worse on the others.
DISTANCE = 6.0
LEAF = 10.0
CYLINDER = 3.0
NORMALS = 5.0
LONGEST = 30.0
REGISTRATION = 3.0
# Clusters: points within so many spacings of each other, with so many neighbours each, and so many in all.
CLUSTER_RADIUS = 5.0
CLUSTER_NEIGHBOURS = 8
SMALLEST_CLUSTER = 20
MEDIAN_TO_DEVIATION = 1.4826


class Scale(NamedTuple):
    """What lengths mean in a pair of clouds.

    Attributes:
        spacing: median distance of a point to its nearest neighbour in its own cloud, in the sparser cloud.
        reach: median distance of a point to its nearest neighbour in the other cloud, of the cloud in which less
            changed, or the spacing where that is larger: spacing, noise and misregistration together.
    """

    spacing: float
    reach: float


Candidates = Callable[[np.ndarray, np.ndarray, Scale], tuple[np.ndarray, np.ndarray]]
"""From the points of both clouds and their scale to those of each that differ."""


def cloud_to_cloud(
    before: Float[np.ndarray, "n0 3"], after: Float[np.ndarray, "n1 3"], scale: Scale
) -> tuple[Bool[np.ndarray, " n0"], Bool[np.ndarray, " n1"]]:
    """Points whose nearest neighbour in the other cloud is further than 6 reaches (Girardeau-Montaut et al. 2005)."""
    limit = DISTANCE * scale.reach
    return _alone(before, cKDTree(after), limit), _alone(after, cKDTree(before), limit)


def _alone(points: np.ndarray, other: cKDTree, limit: float) -> np.ndarray:
    """The points that have none of the other cloud within the limit."""
    return np.isinf(other.query(points, distance_upper_bound=limit, workers=-1)[0])


def voxel_occupancy(
    before: Float[np.ndarray, "n0 3"], after: Float[np.ndarray, "n1 3"], scale: Scale
) -> tuple[Bool[np.ndarray, " n0"], Bool[np.ndarray, " n1"]]:
    """Points in voxels, 10 reaches wide, in which the other cloud has none (the octree difference of Kammerl 2012)."""
    leaf = LEAF * scale.reach
    origin = np.minimum(before.min(axis=0), after.min(axis=0))
    voxels = np.floor((np.concatenate([before, after]) - origin) / leaf).astype(np.int64)
    _, number = np.unique(voxels, axis=0, return_inverse=True)
    number_before, number_after = np.split(number.ravel(), [len(before)])
    return ~np.isin(number_before, number_after), ~np.isin(number_after, number_before)


def has_m3c2() -> bool:
    """Whether py4dgeo is installed."""
    return importlib.util.find_spec("py4dgeo") is not None


def m3c2(
    before: Float[np.ndarray, "n0 3"], after: Float[np.ndarray, "n1 3"], scale: Scale
) -> tuple[Bool[np.ndarray, " n0"], Bool[np.ndarray, " n1"]]:
    """Points with a significant M3C2 distance, or without the other cloud in their cylinder (Lague et al. 2013).

    The registration error in the level of detection is the robust standard deviation of the distances themselves.

    Raises:
        InputError: py4dgeo is not installed.
    """
    if not has_m3c2():
        raise InputError("m3c2: py4dgeo is not installed; pip install '.[peers]', or leave this method out")
    return _significant(before, after, scale), _significant(after, before, scale)


def _significant(points: np.ndarray, other: np.ndarray, scale: Scale) -> np.ndarray:
    import py4dgeo

    # It logs to standard output and to a file in the working directory.
    logging.getLogger("py4dgeo").setLevel(logging.ERROR)
    algorithm = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(points), py4dgeo.Epoch(other)),
        corepoints=points,
        cyl_radius=CYLINDER * scale.reach,
        normal_radii=(NORMALS * scale.reach,),
        max_distance=LONGEST * scale.reach,
        registration_error=0.0,
    )
    distances, uncertainties = algorithm.run()
    nowhere = np.isnan(distances)
    registration = MEDIAN_TO_DEVIATION * np.median(np.abs(distances[~nowhere])) if not nowhere.all() else 0.0
    detectable = uncertainties["lodetection"] + REGISTRATION * 1.96 * registration
    return nowhere | (np.abs(distances) > detectable)


PEERS: Mapping[str, Candidates] = {"c2c": cloud_to_cloud, "voxels": voxel_occupancy, "m3c2": m3c2}


def peer_labels(
    candidates: Candidates, before: Float[np.ndarray, "n0 3"], after: Float[np.ndarray, "n1 3"]
) -> tuple[Int[np.ndarray, " n0"], Int[np.ndarray, " n1"]]:
    """The clusters of the points that differ, at the working resolution, carried over to all points.

    Args:
        candidates: the peer.
        before: points of the before cloud, in any unit.
        after: points of the after cloud, in the same unit.

    Returns:
        Per point of each cloud -1 or the number of its change; those of the after cloud count on.
    """
    pair = working_pair(before, after, DetectionConfig())
    clouds = pair.before.points, pair.after.points
    differ = candidates(*clouds, _scale(pair))
    labels_before, labels_after = (
        _clusters(points, own, pair.spacing) for points, own in zip(clouds, differ, strict=True)
    )
    labels_after[labels_after >= 0] += labels_before.max(initial=-1) + 1
    return labels_before[pair.before.member], labels_after[pair.after.member]


def _scale(pair: WorkingPair) -> Scale:
    trees = cKDTree(pair.before.points), cKDTree(pair.after.points)
    distances = [trees[1 - side].query(trees[side].data, workers=-1)[0] for side in (0, 1)]
    return Scale(pair.spacing, max(pair.spacing, min(float(np.median(own)) for own in distances)))


def _clusters(points: np.ndarray, differ: np.ndarray, spacing: float) -> np.ndarray:
    labels = np.full(len(points), -1)
    labels[differ] = density_clusters(points[differ], CLUSTER_RADIUS * spacing, CLUSTER_NEIGHBOURS)
    counts = np.bincount(labels[labels >= 0], minlength=1)
    kept = np.flatnonzero(counts >= SMALLEST_CLUSTER)
    return np.where(np.isin(labels, kept), np.searchsorted(kept, labels), -1)
