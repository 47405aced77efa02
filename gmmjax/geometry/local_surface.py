"""A scanned surface: the plane through the neighbourhood of each point of a cloud."""

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import ConvexHull, cKDTree

from gmmjax.geometry.neighbours import nearest_neighbours
from gmmjax.geometry.rigid import rotated, transformed

# Neighbours that a plane goes through, and those whose mean stands for a point: averages see offsets below the noise.
PLANE_NEIGHBOURS = 16
MEAN_NEIGHBOURS = 8


@dataclasses.dataclass(frozen=True)
class ScanLineSettings:
    """Settings for points whose nearest neighbours form a scan line, such as a scanner's on a distant floor.

    The plane goes through more of them there, where these are flat and fill what they surround. The values come from
    development on the halls of docs/results.md.

    Attributes:
        slenderness: width by length of the neighbours, up to which they are a row: their plane may be turned about it.
            0: no neighbours are a row; 1: all are.
        neighbours: number of nearest neighbours that the plane goes through in place of a row. Few: the next lines are
            not among them; many: planes of what is far away. 0: rows stay.
        flatness: largest standard deviation of these from their plane, by that along their width. 0: rows stay; 1: the
            plane of a cable is that of the clutter around it.
        cells: number of cells along either axis of their plane, within one and a half standard deviations.
        filled: fraction of these cells with points, at least. 0: any two lines, such as a post and a beam, make a plane
            through no face of either; 1: lines that are far from each other make none.
    """

    slenderness: float = 0.2
    neighbours: int = 64
    flatness: float = 0.03
    cells: int = 4
    filled: float = 0.65


class Heights(NamedTuple):
    """Positions with respect to planes of a surface, in the unit of its points.

    Attributes:
        above: distance of each from its plane, signed as its normal.
        beside: from the centre of the points that the plane goes through, along the plane.
    """

    above: Float64[np.ndarray, " m"]
    beside: Float64[np.ndarray, " m"]


@dataclasses.dataclass(frozen=True, eq=False)
class LocalSurface:
    """A cloud with the plane through each point's nearest neighbours.

    Attributes:
        points: of the cloud.
        tree: of the points.
        neighbours: of each point, the point itself first.
        centres: mean of these neighbours.
        normals: unit normal of their plane, in no particular sense.
        variances: principal variances of these neighbours, the least first.
        counts: how many neighbours each plane goes through: more than these where they are a row.
    """

    points: Float64[np.ndarray, "n 3"]
    tree: cKDTree
    neighbours: Int[np.ndarray, "n k"]
    centres: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    variances: Float64[np.ndarray, "n 3"]
    counts: Int[np.ndarray, " n"]

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        neighbours: int = PLANE_NEIGHBOURS,
        tree: cKDTree | None = None,
        *,
        rows: ScanLineSettings = ScanLineSettings(),
        chunk: int = 4_000_000,
    ) -> "LocalSurface":
        """The surface of a cloud of at least one point, with planes through this number of nearest neighbours.

        Args:
            points: of the cloud.
            neighbours: of each point, itself counted.
            tree: of the points; None: it is made.
            rows: which neighbours are a row, and what the plane goes through there.
            chunk: neighbours through which planes are computed at a time: bounds the memory, about 40 bytes each, and
                does not change the planes.
        """
        tree = cKDTree(points) if tree is None else tree
        indices = nearest_neighbours(tree, points, neighbours)[1]
        step = max(1, chunk // indices.shape[1])
        # `take` is several times as fast as an index array in brackets.
        parts = [local_planes(points.take(own, axis=0)) for own in _chunks(indices, step)]
        planes = LocalPlanes(*(np.concatenate(values) for values in zip(*parts, strict=True)))
        counts = np.full(len(points), indices.shape[1])
        if indices.shape[1] < rows.neighbours:
            on_scan_lines = np.flatnonzero(_slender(planes.variances, rows.slenderness))
            for chosen in _chunks(on_scan_lines, max(1, chunk // rows.neighbours)):
                wide = nearest_neighbours(tree, points[chosen], rows.neighbours)[1]
                across, surface = _planes_across(points.take(wide, axis=0), rows)
                counts[chosen[surface]] = wide.shape[1]
                for values, others in zip(planes, across, strict=True):
                    values[chosen[surface]] = others[surface]
        # Half of the memory of a surface are these numbers, and no cloud in memory has two thousand million points.
        return cls(points, tree, indices.astype(np.int32), *planes, counts)

    def __len__(self) -> int:
        return len(self.points)

    def groups(self, chosen: Int[np.ndarray, " c"]) -> Float64[np.ndarray, "c k 3"]:
        """The nearest neighbours whose mean stands for a point, for some of the points."""
        return self.points.take(self.neighbours[chosen, :MEAN_NEIGHBOURS], axis=0)

    def means(self, chosen: Int[np.ndarray, " c"]) -> Float64[np.ndarray, "c 3"]:
        """The local means of some of the points."""
        return self.groups(chosen).mean(axis=1)

    def nearest(self, places: Float64[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
        """The point of the surface next to each place."""
        return nearest_neighbours(self.tree, places, 1)[1][:, 0]

    def spacing(self, chosen: Int[np.ndarray, " c"]) -> Float64[np.ndarray, " c"]:
        """Distance of neighbouring points on the surface at some of the points, by the spread of the neighbours."""
        # k points that fill a disc of radius r evenly are r sqrt(pi / k) apart, with a spread of r / sqrt 2.
        spread = self.variances[chosen, 1:].sum(axis=1)
        return np.asarray(np.sqrt(2 * np.pi / self.counts[chosen] * spread))

    def heights(self, places: Float64[np.ndarray, "m 3"], chosen: Int[np.ndarray, " m"]) -> Heights:
        """Positions with respect to the planes of some of the points, one each.

        Args:
            places: as many as points are chosen.
            chosen: indices of points.
        """
        apart = places - self.centres.take(chosen, axis=0)
        above = (apart * self.normals.take(chosen, axis=0)).sum(axis=1)
        return Heights(above, np.sqrt(np.maximum((apart**2).sum(axis=1) - above**2, 0.0)))

    def reach(self, chosen: Int[np.ndarray, " c"]) -> Float64[np.ndarray, " c"]:
        """Extent of the planes of some of the points from their centres, across their narrow direction."""
        # An even disc has a standard deviation of half its radius along each axis.
        return np.asarray(2 * np.sqrt(self.variances[chosen, 1]))

    def tilts(self, chosen: Int[np.ndarray, " c"]) -> Float64[np.ndarray, " c"]:
        """The standard deviation of the normals of some of the points, in radians, at most 1.

        The variance of the normal of k points with the variances l1 < l2 < l3 is l1 l2 / k (l2 - l1)^2 towards the
        middle axis, for many points (Anderson 1963, Asymptotic theory for principal component analysis).
        """
        least, middle = self.variances[chosen, 0], self.variances[chosen, 1]
        determined = self.counts[chosen] * (middle - least) ** 2
        at_most = np.maximum(np.maximum(determined, least * middle), np.finfo(np.float64).tiny)
        return np.asarray(np.sqrt(least * middle / at_most))

    def on_scan_lines(self, chosen: Int[np.ndarray, " c"], slenderness: float) -> Bool[np.ndarray, " c"]:
        """Mask of the points whose planes are of a single scan line, about which their rotation is not determined.

        Args:
            chosen: indices of points.
            slenderness: width by length of what a plane goes through, up to which it is a row.
        """
        return _slender(self.variances[chosen], slenderness)

    @functools.cached_property
    def all_means(self) -> Float64[np.ndarray, "n 3"]:
        """The local means of all points."""
        return self.means(np.arange(len(self)))

    @functools.cached_property
    def nearest_distance(self) -> float:
        """Median distance of a point to its nearest neighbour."""
        nearest = self.points[self.neighbours[:, min(1, self.neighbours.shape[1] - 1)]]
        return float(np.median(np.linalg.norm(nearest - self.points, axis=1)))

    @functools.cached_property
    def thickness(self) -> float:
        """Standard deviation of the neighbours from their plane, the median over the points."""
        return float(np.sqrt(np.median(self.variances[:, 0])))

    @functools.cached_property
    def hull(self) -> ConvexHull:
        """The convex hull of the local means."""
        # Joggled, so that a flat surface has one, too.
        return ConvexHull(self.all_means, qhull_options="QJ")

    def beyond_hull(self, places: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
        """Signed distance of each place to the convex hull of the local means; negative inside."""
        return np.asarray((places @ self.hull.equations[:, :3].T + self.hull.equations[:, 3]).max(axis=1))

    def moved(self, transform: Float64[np.ndarray, "4 4"]) -> "LocalSurface":
        """The surface after a rigid transform."""
        points = transformed(self.points, transform)
        normals = rotated(self.normals, transform)
        centres = transformed(self.centres, transform)
        return dataclasses.replace(self, points=points, tree=cKDTree(points), centres=centres, normals=normals)


class LocalPlanes(NamedTuple):
    """The planes through groups of points.

    Attributes:
        centres: of the groups.
        normals: unit normals, in no particular sense.
        variances: principal variances of the groups, the least first.
    """

    centres: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    variances: Float64[np.ndarray, "n 3"]


def local_planes(groups: Float64[np.ndarray, "n k 3"]) -> LocalPlanes:
    """The plane through each group of points."""
    return _principal(groups)[0]


def _principal(groups: Float64[np.ndarray, "n k 3"]) -> tuple[LocalPlanes, Float64[np.ndarray, "n 3 3"]]:
    """The plane through each group of points, and its principal axes as columns, that of the least variance first."""
    centres = groups.mean(axis=1)
    centred = groups - centres[:, None]
    variances, axes = np.linalg.eigh(centred.swapaxes(1, 2) @ centred / groups.shape[1])
    return LocalPlanes(centres, axes[:, :, 0], np.maximum(variances, 0)), axes


def _planes_across(
    groups: Float64[np.ndarray, "m k 3"], settings: ScanLineSettings
) -> tuple[LocalPlanes, Bool[np.ndarray, " m"]]:
    """The planes through the many neighbours of points in rows, and which of these planes are surfaces."""
    planes, axes = _principal(groups)
    least, middle, _ = planes.variances.T
    flat = ~_slender(planes.variances, settings.slenderness) & (least <= settings.flatness**2 * middle)
    deviations = np.sqrt(np.maximum(planes.variances[:, None, 1:], np.finfo(np.float64).tiny))
    in_plane = (groups - planes.centres[:, None]) @ axes[:, :, 1:] / deviations
    return planes, flat & (_filled(in_plane, settings.cells) >= settings.filled)


def _filled(in_plane: Float64[np.ndarray, "m k 2"], cells: int) -> Float64[np.ndarray, " m"]:
    """Fraction of the square cells, within one and a half standard deviations, that have some of the points.

    Args:
        in_plane: the points of each group along the axes of its plane, in standard deviations; those beyond count in
            the cells at the rim.
        cells: number along either axis.
    """
    column, row = np.clip(cells * (in_plane + 1.5) / 3, 0, cells - 1).astype(int).transpose(2, 0, 1)
    occupied = np.zeros((len(in_plane), cells**2), bool)
    occupied[np.arange(len(in_plane))[:, None], cells * row + column] = True
    return np.asarray(occupied.mean(axis=1))


def _chunks(values: np.ndarray, step: int) -> list[np.ndarray]:
    """The values, so many at a time; one part of none where there are none."""
    return [values[first : first + step] for first in range(0, max(len(values), 1), step)]


def _slender(variances: Float64[np.ndarray, "n 3"], slenderness: float) -> Bool[np.ndarray, " n"]:
    """Mask of the groups of points whose principal variances are those of a scan line."""
    return np.asarray(variances[:, 1] <= slenderness**2 * variances[:, 2])


def evenly_chosen(count: int, size: int) -> Int[np.ndarray, " m"]:
    """The indices of at most a given number of points, evenly spaced in their order."""
    return np.linspace(0, count - 1, min(size, count)).astype(int)
