"""A survey: a cloud with the views that it was taken from, and what its points hide from these."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree

from gmmjax.changes.evidence.nearest_return import (
    NearestReturnSettings,
    angles_between,
    nearest_return,
    nearest_return_in,
)
from gmmjax.changes.signed_distance import overhead_viewpoint
from gmmjax.clouds import SensorViews
from gmmjax.geometry import DepthImage, DepthImageSettings, Frustum, LocalSurface, frustums


@dataclasses.dataclass(frozen=True)
class FreeSpaceSettings:
    """What the points of a survey occlude, and how far from its surface free space begins.

    Attributes:
        spacing_neighbour: the distance to this nearest neighbour is the spacing of points on a surface: exact for 4 on
            a square grid, and right on average for points at random. Fewer: surfaces have holes to see through.
        widest_spacing: largest spacing of a point, in median spacings; beyond it a point is an outlier, unless it is of
            a sparse surface, or so far from the nearest view that its spacing by angle is not as many times the median
            one. Without views it is not known how far, and no such point is an outlier. Larger: isolated points occlude
            much of a view; 1: bent surfaces occlude less.
        sparse_flatness: as `flatness`, for the surface of such a point. 0: near sparse surfaces do not occlude.
        outlier_distance: a point whose spacing exceeds this many times the median spacing of its neighbours is an
            outlier, such as the flying pixels of a depth camera at the edges of objects, and occludes nothing.
            Infinite: outliers occlude; 1: half of the points of a surface occlude nothing.
        min_indegree: a point is an outlier, too, when it is among the nearest neighbours of less than this fraction
            of as many points as it has neighbours itself (the in-degree of Hautamäki, Kärkkäinen and Fränti 2004, which
            does not depend on the density): outliers beside each other are near to one another, and to nothing else. 0:
            such groups occlude; 0.5: the rims of surfaces occlude nothing.
        max_blocked: number of the eight bins around a direction that may be occluded there, for each size of bins; of
            a surface that continues at least three are. 0: what is left of the outliers occludes three by three bins.
        flatness: largest standard deviation of the points about the plane of their neighbourhood, as a fraction of
            that along it, for the plane to be trusted nearer than the margin. 0: no free space within the margin;
            1: planes through noise and around edges are used.
        images: the size of the depth images and of their bins.
        directions: how finely directions are told apart in scans that are compared at their own resolution.
        tilts: in these, number of standard deviations of the tilt of a plane through the points that a view saw, by
            which a place must be in front of it to be free. 0: noise in a small plane frees the floor beside it. A
            place is behind a plane where it is by as many and by the offset.
        behind: number of spacings by which a place is behind a point of a surface that is not flat. 0: the noise of
            such a surface hides the places on it; infinite: nothing is hidden in clutter.
    """

    spacing_neighbour: int = 4
    widest_spacing: float = 3.0
    outlier_distance: float = 2.0
    min_indegree: float = 0.5
    max_blocked: int = 1
    flatness: float = 0.5
    sparse_flatness: float = 0.15
    images: DepthImageSettings = DepthImageSettings()
    directions: NearestReturnSettings = NearestReturnSettings()
    tilts: float = 2.0
    behind: float = 3.0


@dataclasses.dataclass(frozen=True, eq=False)
class ScanVisibility:
    """One cloud with the views it was taken from; what is computed from them is cached.

    Attributes:
        surface: the cloud, with the planes through the points' neighbourhoods.
        views: where it was taken from, or None where that is not known.
        settings: what its points occlude.
        cell: edge of the cells of directions of which the points are the nearest ones, degrees: their spacing in a view
            is by direction then. None: they are not chosen by direction.
        seen_from: places that the surfaces are seen from where the views are not known; None: from high above.
        sighted: the same survey at the resolution of its lines of sight, which the depth images of its views show;
            None: they show `surface`.
    """

    surface: LocalSurface
    views: SensorViews | None = None
    settings: FreeSpaceSettings = FreeSpaceSettings()
    cell: float | None = None
    seen_from: Float64[np.ndarray, "p 3"] | None = None
    sighted: "ScanVisibility | None" = None
    _images: dict[int, list[tuple[Frustum, DepthImage]]] = dataclasses.field(
        default_factory=dict, init=False, repr=False
    )

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        views: SensorViews | None = None,
        settings: FreeSpaceSettings = FreeSpaceSettings(),
    ) -> "ScanVisibility":
        """The survey of a cloud of at least one point, whose planes are computed."""
        return cls(LocalSurface.of(points), views, settings)

    def without_views(self) -> "ScanVisibility":
        """The survey, where nobody knows where it was taken from."""
        return dataclasses.replace(self, views=None, seen_from=None, sighted=None)

    def with_line_of_sight(self, points: Float64[np.ndarray, "m 3"]) -> "ScanVisibility":
        """The survey whose views show what the scan itself has nearest in each direction; itself without views.

        Args:
            points: of the scan, or those of them that are the nearest ones in some cell of directions.
        """
        if self.views is None:
            return self
        rows, cell = nearest_return(points, self.views, self.settings.directions)
        if not len(rows):
            return self
        sighted = ScanVisibility(LocalSurface.of(points[rows]), self.views, self.settings, cell)
        return dataclasses.replace(self, sighted=sighted)

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """The points of the cloud."""
        return self.surface.points

    @property
    def towards(self) -> Float64[np.ndarray, "p 3"]:
        """Places on the outer side of the surfaces: where the sensor stood, as far as that is known."""
        if self.views is not None:
            return np.asarray(self.views.poses[:, :3, 3])
        return overhead_viewpoint(self.points) if self.seen_from is None else self.seen_from

    @functools.cached_property
    def spacing(self) -> Float64[np.ndarray, " n"]:
        """Distance of each point to its neighbours on the surface; isolated points have a bounded one."""
        distances = self._neighbour_distances
        return np.asarray(np.minimum(distances, self.settings.widest_spacing * np.median(distances)))

    @functools.cached_property
    def outliers(self) -> Bool[np.ndarray, " n"]:
        """Which points belong to no surface."""
        distances, neighbours = self._neighbour_distances, self.surface.neighbours[:, 1:]
        if not neighbours.shape[1]:
            return np.zeros(len(distances), bool)
        isolated = distances > self.settings.outlier_distance * np.median(distances[neighbours], axis=1)
        in_degree = np.bincount(neighbours.ravel(), minlength=len(distances))
        return np.asarray(isolated | self._sparse | (in_degree < self.settings.min_indegree * neighbours.shape[1]))

    @property
    def _sparse(self) -> Bool[np.ndarray, " n"]:
        """Which points, on no flat surface, are farther apart than usual at their range from the nearest view.

        None without views: at any spacing a point may be of a surface far away.
        """
        if self.views is None:
            return np.zeros(len(self.points), bool)
        distances, widest = self._neighbour_distances, self.settings.widest_spacing
        sparse = (distances > widest * np.median(distances)) & ~self._flat(self.settings.sparse_flatness)
        if not sparse.any():
            return np.asarray(sparse)
        ranges = cKDTree(self.views.poses[:, :3, 3]).query(self.points)[0]
        angles = distances / np.maximum(ranges, np.finfo(float).tiny)
        return np.asarray(sparse & (angles > widest * np.median(angles)))

    @functools.cached_property
    def occluders(self) -> Int64[np.ndarray, " m"]:
        """The indices of the points that the depth images show: all but outliers."""
        return np.flatnonzero(~self.outliers)

    @functools.cached_property
    def flat(self) -> Bool[np.ndarray, " n"]:
        """Around which points the surface is flat enough for its plane to be trusted."""
        return self._flat(self.settings.flatness)

    def _flat(self, flatness: float) -> Bool[np.ndarray, " n"]:
        least, middle, _ = self.surface.variances.T
        return np.asarray(least <= flatness**2 * middle)

    @functools.cached_property
    def _neighbour_distances(self) -> Float64[np.ndarray, " n"]:
        neighbour = min(self.settings.spacing_neighbour, self.surface.neighbours.shape[1] - 1)
        neighbours = self.points[self.surface.neighbours[:, neighbour]]
        return np.asarray(np.linalg.norm(neighbours - self.points, axis=1))

    def images(self, view: int) -> list[tuple[Frustum, DepthImage]]:
        """The depth images of a view, without outliers; its points are numbered as in `occluders`."""
        assert self.views is not None
        if view not in self._images:
            points, settings = self.views.in_camera(self.points[self.occluders], view), self.settings.images
            spacing = self.spacing_in(view)
            self._images[view] = [
                (frustum, DepthImage.of(points, spacing, frustum, settings))
                for frustum in frustums(self.views.field_of_view, settings)
            ]
        return self._images[view]

    def spacing_in(self, view: int) -> Float64[np.ndarray, " m"]:
        """Distance of each occluder to its neighbours as one view sees them: on the surface, or by direction."""
        return self.spacing[self.occluders] if self.cell is None else self._spacing_by_direction(view)

    def _spacing_by_direction(self, view: int) -> Float64[np.ndarray, " m"]:
        """Distance of each occluder to its neighbours by direction, across the line of sight.

        It is at least that of the points that no other view is nearer to, which this one has measured: a surface that
        another one has sampled more finely was not seen between its own lines of sight.
        """
        assert self.views is not None and self.cell is not None
        points = self.points[self.occluders]
        places = self.views.in_camera(points, view)
        first = nearest_return_in(points, self.views, view, self.cell)
        if not len(first):
            return self.spacing[self.occluders]
        own = angles_between(places[first], self.settings.spacing_neighbour)
        nearest = cKDTree(self.views.poses[:, :3, 3]).query(points[first])[1] == view
        step = float(np.median(own[nearest] if nearest.any() else own))
        angles = np.full(len(points), step)
        angles[first] = np.clip(own, step, self.settings.widest_spacing * step)
        return np.asarray(angles * np.linalg.norm(places, axis=1))
