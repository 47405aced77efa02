"""The resolution that two clouds are compared at, derived from their own points."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from gmmjax._cores import available_cores
from gmmjax.changes.prepare.checking import check_comparable
from gmmjax.clouds import first_of_equals, voxel_grid, voxel_size_for
from gmmjax.geometry import evenly_chosen, local_planes, nearest_neighbours
from gmmjax.pair import Pair


@dataclasses.dataclass(frozen=True)
class ResolutionSettings:
    """Choice of the resolution that clouds are compared at, and of volume or surface.

    Neighbourhoods of a volume are about as thick as wide: the least of the three principal variances is some 0.2 of
    their sum, as long as they hold a small share of the points. On surfaces it is below 0.06 in one of two sizes of
    neighbourhoods: where the sensor's noise is larger than the spacing of a dense cloud, only the larger are flat. Of a
    site of many rooms the voxels are as large as what stands in them: there only neighbourhoods of points are flat.

    Attributes:
        voxels: of either cloud that are compared, at most: two clouds of 50,000 take about two seconds.
        probes: points whose neighbourhoods are looked at.
        neighbours: of the small neighbourhoods.
        large_share: fraction of the points in the large neighbourhoods.
        volume_share: fraction of the sum of the principal variances above which the least of them is that of a volume.
    """

    voxels: int = 50_000
    probes: int = 512
    neighbours: int = 32
    large_share: float = 1 / 128
    volume_share: float = 0.12


@dataclasses.dataclass(frozen=True)
class WorkingCloud:
    """One cloud at the resolution that it is compared at.

    Attributes:
        points: means of the voxels, or the points themselves, equal ones that follow each other once.
        mass: how many points each stands for.
        member: for each point of the cloud the index of its voxel.
        sizes: edge of each voxel, where they differ from place to place; None: they have one size.
    """

    points: Float[np.ndarray, "m 3"]
    mass: Float[np.ndarray, " m"]
    member: Int[np.ndarray, " n"]
    sizes: Float[np.ndarray, " m"] | None = None

    @functools.cached_property
    def tree(self) -> cKDTree:
        """Tree of the points."""
        return cKDTree(self.points)

    def of_working_points(self, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
        """The label of each working point, by the labels of the cloud's points, which are one in a voxel."""
        working = np.empty(len(self.points), int)
        working[self.member] = labels
        return working


@dataclasses.dataclass(frozen=True)
class WorkingPair:
    """Both clouds at one resolution.

    Attributes:
        clouds: before and after.
        voxel_size: edge of the voxels; None: not reduced.
        spacing: median distance of a point to its nearest neighbour, in the sparser cloud; positive.
        volumetric: whether the points fill volumes (artificial Gaussians) and do not lie on surfaces (scans).
    """

    clouds: Pair[WorkingCloud]
    voxel_size: float | None
    spacing: float
    volumetric: bool

    @property
    def finest_voxel_size(self) -> float | None:
        """Edge of the smallest voxel; None: not reduced."""
        smallest = [float(cloud.sizes.min()) for cloud in self.clouds if cloud.sizes is not None and len(cloud.sizes)]
        return min(smallest, default=self.voxel_size)

    def with_after_of(self, points: Float[np.ndarray, "n 3"]) -> "WorkingPair":
        """The pair with an after cloud that is made of all these points, in voxels of the same edge."""
        after = _working_cloud(points, self.voxel_size)
        return dataclasses.replace(self, clouds=Pair(self.clouds.before, after))

    def with_after(self, points: Float[np.ndarray, "m 3"]) -> "WorkingPair":
        """The pair with the after cloud's points moved to these."""
        after = dataclasses.replace(self.clouds.after, points=points)
        return dataclasses.replace(self, clouds=Pair(self.clouds.before, after))


def working_pair(
    points: Pair[Float[np.ndarray, "_ 3"]],
    voxel_size: float | None = None,
    settings: ResolutionSettings = ResolutionSettings(),
) -> WorkingPair:
    """Reduces both clouds to voxels of one size where they have too many points, and looks at what is left.

    Args:
        points: all points that are compared, in any unit.
        voxel_size: edge of the voxels; None: from the clouds.
        settings: how the resolution is chosen where no edge is given.

    Raises:
        InputError: nothing can be compared, because one cloud is far smaller than the other's resolution.
    """
    size = voxel_size or common_voxel_size(points, settings.voxels)
    clouds = points.map(lambda cloud: _working_cloud(cloud, size))
    compared = clouds.map(lambda cloud: cloud.points)
    check_comparable(points, compared, size or 0.0)
    probes = clouds.map(lambda cloud: _probe(cloud, settings))
    spacing = max(spacing for spacing, _ in probes)
    check_comparable(points, compared, spacing)
    thick = min(thickness for _, thickness in probes) > settings.volume_share
    return WorkingPair(clouds, size, spacing, thick and (size is None or _points_are_thick(points, settings)))


def common_voxel_size(points: Pair[Float[np.ndarray, "_ 3"]], max_voxels: int) -> float | None:
    """An edge, nearly the smallest, with which neither cloud has more voxels; None where neither has more points."""
    sizes = [voxel_size_for(cloud, max_voxels) for cloud in points if len(cloud) > max_voxels]
    return _on_a_series(max(sizes), points) if sizes else None


def _on_a_series(size: float, points: Pair[np.ndarray]) -> float:
    """The next of a series of sizes, 9 % apart, that starts from the extent of the clouds, which no rotation changes.

    The number of occupied voxels depends a little on the axes; the resolution that clouds are compared at should not.
    """
    extent = float(np.sqrt(_radius(points.before) * _radius(points.after)))
    return extent * 2 ** (np.ceil(8 * np.log2(size / extent)) / 8)


def _radius(points: np.ndarray) -> float:
    """Root mean square distance of the points from their centre."""
    return float(np.sqrt(points.var(axis=0).sum()))


def usual_spacing(points: Float[np.ndarray, "n 3"], settings: ResolutionSettings = ResolutionSettings()) -> float:
    """Median distance of a point to its nearest neighbour, from a sample; 0 where there is one point only."""
    distances, _ = nearest_neighbours(cKDTree(points), points[evenly_chosen(len(points), settings.probes)], 2)
    return float(np.median(distances[:, -1]))


def _working_cloud(points: np.ndarray, size: float | None) -> WorkingCloud:
    if size is None:
        first = first_of_equals(points)
        member = np.cumsum(first) - 1
        return WorkingCloud(points[first], np.bincount(member).astype(float), member)
    grid = voxel_grid(points, size)
    return WorkingCloud(grid.points, grid.mass, grid.voxel_of_point)


def _probe(cloud: WorkingCloud, settings: ResolutionSettings) -> tuple[float, float]:
    """Median distance to the nearest neighbour, and median thickness of the neighbourhoods of the flatter size."""
    points = cloud.points
    # Regularly spaced rows, so that the same cloud always gives the same scales.
    probes = points[evenly_chosen(len(points), settings.probes)]
    small = min(settings.neighbours, max(2, len(points) // 4))
    large = max(small, int(settings.large_share * len(points)))
    distances, neighbours = cloud.tree.query(probes, k=large, workers=available_cores())
    thickness = min(_thickness(points.take(neighbours[:, :size], axis=0)) for size in {small, large})
    return float(np.median(distances[:, 1])), thickness


def _points_are_thick(points: Pair[np.ndarray], settings: ResolutionSettings) -> bool:
    """True where the small neighbourhoods of the points themselves are those of a volume, in both clouds."""
    return min(_thickness_of_points(cloud, settings) for cloud in points) > settings.volume_share


def _thickness_of_points(cloud: np.ndarray, settings: ResolutionSettings) -> float:
    probes = cloud[evenly_chosen(len(cloud), settings.probes)]
    return _thickness(cloud[nearest_neighbours(cKDTree(cloud), probes, min(settings.neighbours, len(cloud)))[1]])


def _thickness(neighbourhoods: np.ndarray) -> float:
    variances = local_planes(neighbourhoods)[2]
    total = np.maximum(variances.sum(axis=1), np.finfo(np.float64).tiny)
    return float(np.median(variances[:, 0] / total))
