"""Free space: whether a survey observed that the places of another cloud's points are empty."""

import dataclasses
import enum
import functools

import numpy as np
from jaxtyping import Bool, Float64, Int8

from gmmjax.clouds import SensorViews
from gmmjax.geometry import DepthImage, DepthImageSettings, Frustum, LocalSurface, frustums


@dataclasses.dataclass(frozen=True)
class FreeSpaceSettings:
    """What the points of a survey occlude.

    Attributes:
        spacing_neighbour: the distance to this nearest neighbour is the spacing of points on a surface: exact for 4 on
            a square grid, and right on average for points at random. Fewer: surfaces have holes to see through.
        widest_spacing: largest spacing of a point, in median spacings. Larger: isolated points occlude much of a view.
        outlier_distance: a point whose spacing exceeds this many times the median spacing of its neighbours is an
            outlier, such as the flying pixels of a depth camera at the edges of objects, and occludes nothing.
            Infinite: outliers occlude; 1: half of the points of a surface occlude nothing.
        images: the size of the depth images and of their bins.
    """

    spacing_neighbour: int = 4
    widest_spacing: float = 3.0
    outlier_distance: float = 2.0
    images: DepthImageSettings = DepthImageSettings()


class Observed(enum.IntEnum):
    """What a survey observed at a place."""

    unobserved = -1
    """Nothing: occluded, outside every field of view, or without a return."""

    surface = 0
    """A surface."""

    free = 1
    """Free space: a view saw a surface behind the place."""


@dataclasses.dataclass(frozen=True, eq=False)
class Survey:
    """One cloud with the views it was taken from; what is computed from them is cached.

    Attributes:
        surface: the cloud, with the planes through the points' neighbourhoods.
        views: where it was taken from, or None where that is not known.
        settings: what its points occlude.
    """

    surface: LocalSurface
    views: SensorViews | None = None
    settings: FreeSpaceSettings = FreeSpaceSettings()
    _images: dict[int, list[tuple[Frustum, DepthImage]]] = dataclasses.field(
        default_factory=dict, init=False, repr=False
    )

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        views: SensorViews | None = None,
        settings: FreeSpaceSettings = FreeSpaceSettings(),
    ) -> "Survey":
        """The survey of a cloud of at least one point, whose planes are computed."""
        return cls(LocalSurface.of(points), views, settings)

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """The points of the cloud."""
        return self.surface.points

    @functools.cached_property
    def spacing(self) -> Float64[np.ndarray, " n"]:
        """Distance of each point to its neighbours on the surface; isolated points have a bounded one."""
        distances = self._neighbour_distances
        return np.asarray(np.minimum(distances, self.settings.widest_spacing * np.median(distances)))

    @functools.cached_property
    def outliers(self) -> Bool[np.ndarray, " n"]:
        """Which points belong to no surface."""
        distances = self._neighbour_distances
        if self.surface.neighbours.shape[1] < 2:
            return np.zeros(len(distances), bool)
        around = np.median(distances[self.surface.neighbours[:, 1:]], axis=1)
        return np.asarray(distances > self.settings.outlier_distance * around)

    @functools.cached_property
    def _neighbour_distances(self) -> Float64[np.ndarray, " n"]:
        neighbour = min(self.settings.spacing_neighbour, self.surface.neighbours.shape[1] - 1)
        neighbours = self.points[self.surface.neighbours[:, neighbour]]
        return np.asarray(np.linalg.norm(neighbours - self.points, axis=1))

    def images(self, view: int) -> list[tuple[Frustum, DepthImage]]:
        """The depth images of a view, without outliers."""
        assert self.views is not None
        if view not in self._images:
            points = self.views.in_camera(self.points[~self.outliers], view)
            spacing, settings = self.spacing[~self.outliers], self.settings.images
            self._images[view] = [
                (frustum, DepthImage.of(points, spacing, frustum, settings))
                for frustum in frustums(self.views.field_of_view, settings)
            ]
        return self._images[view]


def observation(points: Float64[np.ndarray, "n 3"], survey: Survey, margin: float) -> Int8[np.ndarray, " n"]:
    """What a survey observed at the places of points of another one.

    Where its cloud has a point within the margin there is a surface. A place farther from it is free when at least one
    view saw past it: it lies in the field of view and range, the cloud has a surface behind it in the same direction,
    by more than the margin, and nothing in front of it in that direction or those next to it. The distance to the
    surface, not the depth along the ray, is compared with the margin, so that a slightly misregistered surface seen at
    a grazing angle is not taken for free space.

    Args:
        points: the places, of the one cloud.
        survey: of the other cloud; without views it has only its surfaces.
        margin: largest displacement of a surface by noise and registration error, in the unit of the clouds.

    Returns:
        A value of `Observed` for each of the points.
    """
    result = np.full(len(points), Observed.unobserved, np.int8)
    if not len(points):
        return result
    near = np.isfinite(survey.surface.tree.query(points, distance_upper_bound=margin, workers=-1)[0])
    result[near] = Observed.surface
    open_places = np.flatnonzero(~near)
    for view in range(0 if survey.views is None else len(survey.views)):
        free = _in_free_space(points[open_places], survey, view, margin)
        result[open_places[free]] = Observed.free
        open_places = open_places[~free]
    return result


def _in_free_space(
    points: Float64[np.ndarray, "n 3"], survey: Survey, view: int, margin: float
) -> Bool[np.ndarray, " n"]:
    """Which of the points, none of them near the surface, are in the free space of one view."""
    free = np.zeros(len(points), bool)
    assert survey.views is not None
    places = survey.views.in_camera(points, view)
    visible = np.flatnonzero(survey.views.in_field_of_view(places))
    if not len(visible):
        return free
    for frustum, image in survey.images(view):
        inside, directions, ranges = frustum.project(places[visible])
        behind, in_front = image.nearest(directions)
        free[visible[inside]] = np.isfinite(behind) & (behind > ranges + margin) & (in_front > ranges)
    return free
