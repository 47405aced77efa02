"""The usual detectors, for comparison: cloud-to-cloud distance, voxel occupancy and M3C2, with density clusters.

All look at the clouds at the resolution that ours works at, and derive their lengths from the clouds by one rule each.
"""

import abc
import dataclasses
import importlib.util
import logging
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from gmmjax.changes import (
    NAMES,
    AbstractDetector,
    Detection,
    Progress,
    ResolutionSettings,
    Scan,
    WorkingPair,
    silent,
    working_pair,
)
from gmmjax.clouds import PointCloud, as_points
from gmmjax.errors import InputError
from gmmjax.geometry import MEDIAN_TO_DEVIATION, density_clusters
from gmmjax.pair import Pair, each


class Scale(NamedTuple):
    """The lengths of a pair of clouds.

    Attributes:
        spacing: median distance of a point to its nearest neighbour in its own cloud, in the sparser cloud.
        reach: median distance of a point to its nearest neighbour in the other cloud, of the cloud in which less
            changed, or the spacing where that is larger: spacing, noise and misregistration together.
    """

    spacing: float
    reach: float


class Compared(NamedTuple):
    """Two clouds as the peers look at them.

    Attributes:
        pair: at the working resolution.
        points: of the clouds at that resolution.
        scale: what lengths mean in the pair.
    """

    pair: WorkingPair
    points: Pair[Float[np.ndarray, "_ 3"]]
    scale: Scale


@dataclasses.dataclass(frozen=True)
class AbstractPeer(AbstractDetector):
    """Points that differ from the other cloud, in density clusters.

    Lengths are in units of the clouds' reach, which `Scale` describes. Each is the one of a coarse series that gave the
    best F1 over artificial scenes, simulated rooms and real scans together (docs/results.md): one that suits a single
    kind of scene better is worse on the others.

    Attributes:
        cluster_radius: within which points are neighbours, in spacings (the radius of DBSCAN).
        cluster_neighbours: of a core point, itself counted (the minimum of DBSCAN).
        smallest_cluster: number of points of a change, at least.
        resolution: that the clouds are compared at.
    """

    cluster_radius: float = 5.0
    cluster_neighbours: int = 8
    smallest_cluster: int = 20
    resolution: ResolutionSettings = ResolutionSettings()

    @abc.abstractmethod
    def measured(self, compared: Compared) -> Any:
        """Measure the difference of every point: the costly part, which no threshold enters.

        Args:
            compared: both clouds.
        """

    @abc.abstractmethod
    def differing(self, measured: Any, scale: Scale) -> Pair[Bool[np.ndarray, " _"]]:
        """The points of either cloud that the other one has not.

        Args:
            measured: see there.
            scale: what lengths mean in the pair.
        """

    def compared(self, scans: Pair[Scan]) -> Compared:
        """Both clouds at the working resolution.

        Args:
            scans: in one frame.
        """
        pair = working_pair(coordinates(scans), settings=self.resolution)
        return Compared(pair, pair.clouds.map(lambda cloud: cloud.points), _scale(pair))

    def detect(self, scans: Pair[Scan], report: Progress = silent) -> Detection:
        """The clusters of the points that differ, at the working resolution, carried over to all points."""
        compared = self.compared(scans)
        return self.segments(compared, self.measured(compared))

    def segments(self, compared: Compared, measured: Any) -> Detection:
        """`detect` where both clouds were compared and measured before.

        Args:
            compared: both clouds.
            measured: in them, by a peer with the same settings up to its thresholds.
        """
        pair, differ = compared.pair, self.differing(measured, compared.scale)
        labels = each(lambda own, differs: self._clusters(own, differs, pair.spacing), compared.points, differ)
        labels.after[labels.after >= 0] += labels.before.max(initial=-1) + 1
        return Detection(*each(lambda own, cloud: own[cloud.member], labels, pair.clouds))

    def _clusters(self, points: np.ndarray, differ: np.ndarray, spacing: float) -> Int[np.ndarray, " n"]:
        labels = np.full(len(points), -1)
        labels[differ] = density_clusters(points[differ], self.cluster_radius * spacing, self.cluster_neighbours)
        counts = np.bincount(labels[labels >= 0], minlength=1)
        kept = np.flatnonzero(counts >= self.smallest_cluster)
        return np.where(np.isin(labels, kept), np.searchsorted(kept, labels), -1)


@dataclasses.dataclass(frozen=True)
class CloudToCloudDetector(AbstractPeer):
    """Points whose nearest neighbour in the other cloud is further than this (Girardeau-Montaut et al. 2005).

    Attributes:
        distance: to it, in reaches.
    """

    distance: float = 6.0

    def measured(self, compared: Compared) -> Pair[Float[np.ndarray, " _"]]:
        """The distance of each point to its nearest neighbour in the other cloud."""
        points = compared.points
        return each(lambda own, other: cKDTree(other).query(own, workers=-1)[0], points, points.swapped)

    def differing(self, measured: Pair[Float[np.ndarray, " _"]], scale: Scale) -> Pair[Bool[np.ndarray, " _"]]:
        """The points without a near neighbour in the other cloud."""
        return measured.map(lambda distances: distances >= self.distance * scale.reach)


@dataclasses.dataclass(frozen=True)
class VoxelDetector(AbstractPeer):
    """Points in voxels in which the other cloud has none (the octree difference of Kammerl 2012).

    Attributes:
        leaf: edge of the voxels, in reaches.
    """

    leaf: float = 10.0

    def measured(self, compared: Compared) -> Pair[Int[np.ndarray, " _"]]:
        """The number of each point's voxel; the same in both clouds."""
        points = compared.points
        origin = np.minimum(*points.map(lambda cloud: cloud.min(axis=0)))
        voxels = np.floor((np.concatenate([*points]) - origin) / (self.leaf * compared.scale.reach)).astype(np.int64)
        numbers = np.unique(voxels, axis=0, return_inverse=True)[1].ravel()
        return Pair(*np.split(numbers, [len(points.before)]))

    def differing(self, measured: Pair[Int[np.ndarray, " _"]], scale: Scale) -> Pair[Bool[np.ndarray, " _"]]:
        """The points in voxels that are empty in the other cloud."""
        return each(lambda own, other: ~np.isin(own, other), measured, measured.swapped)


class M3C2Distances(NamedTuple):
    """M3C2 distances of the points of one cloud to the other.

    Attributes:
        distances: along the normal; NaN where the other cloud is not in the cylinder.
        detectable: level of detection by roughness alone.
    """

    distances: Float[np.ndarray, " n"]
    detectable: Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class M3C2Detector(AbstractPeer):
    """Points with a significant M3C2 distance, or without the other cloud in their cylinder (Lague et al. 2013).

    The registration error in the level of detection is the robust standard deviation of the distances themselves.

    Attributes:
        cylinder: radius of the cylinders, in reaches.
        normals: radius of the neighbourhoods that the normals are taken from, in reaches.
        longest: half length of the cylinders, in reaches.
        registration: level of detection, in standard deviations of the registration error times 1.96.
    """

    cylinder: float = 3.0
    normals: float = 5.0
    longest: float = 30.0
    registration: float = 3.0

    def detect(self, scans: Pair[Scan], report: Progress = silent) -> Detection:
        """Detect changes.

        Raises:
            InputError: py4dgeo is not installed.
        """
        if not has_m3c2():
            raise InputError("m3c2: py4dgeo is not installed; pip install '.[peers]', or leave this method out")
        return super().detect(scans, report)

    def measured(self, compared: Compared) -> Pair[M3C2Distances]:
        """The M3C2 distances of either cloud to the other."""
        points, reach = compared.points, compared.scale.reach
        return each(lambda own, other: self._distances(own, other, reach), points, points.swapped)

    def differing(self, measured: Pair[M3C2Distances], scale: Scale) -> Pair[Bool[np.ndarray, " _"]]:
        """The points whose distance exceeds its level of detection, or is not known."""
        return measured.map(self._significant)

    def _distances(self, own: np.ndarray, other: np.ndarray, reach: float) -> M3C2Distances:
        import py4dgeo

        # It logs to standard output and to a file in the working directory.
        logging.getLogger("py4dgeo").setLevel(logging.ERROR)
        algorithm = py4dgeo.M3C2(
            epochs=(py4dgeo.Epoch(own), py4dgeo.Epoch(other)),
            corepoints=own,
            cyl_radius=self.cylinder * reach,
            normal_radii=(self.normals * reach,),
            max_distance=self.longest * reach,
            registration_error=0.0,
        )
        distances, uncertainties = algorithm.run()
        return M3C2Distances(distances, uncertainties["lodetection"])

    def _significant(self, measured: M3C2Distances) -> np.ndarray:
        distances = measured.distances
        nowhere = np.isnan(distances)
        error = MEDIAN_TO_DEVIATION * np.median(np.abs(distances[~nowhere])) if not nowhere.all() else 0.0
        detectable = measured.detectable + self.registration * 1.96 * error
        return np.asarray(nowhere | (np.abs(distances) > detectable))


def has_m3c2() -> bool:
    """True where py4dgeo is installed."""
    return importlib.util.find_spec("py4dgeo") is not None


PEERS: Mapping[str, AbstractPeer] = {"c2c": CloudToCloudDetector(), "voxels": VoxelDetector(), "m3c2": M3C2Detector()}


def coordinates(scans: Pair[Scan]) -> Pair[Float[np.ndarray, "_ 3"]]:
    """The points of both clouds."""
    return each(_points, NAMES, scans)


def _points(name: str, scan: Scan) -> np.ndarray:
    return scan.cloud.points if isinstance(scan.cloud, PointCloud) else as_points(scan.cloud, name)


def _scale(pair: WorkingPair) -> Scale:
    trees = pair.clouds.map(lambda cloud: cKDTree(cloud.points))
    distances = each(lambda own, other: other.query(own.data, workers=-1)[0], trees, trees.swapped)
    return Scale(pair.spacing, max(pair.spacing, min(float(np.median(own)) for own in distances)))
