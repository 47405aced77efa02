"""What one survey knows of the places where the other one has points."""

import dataclasses
import enum
import functools

import numpy as np
from jaxtyping import Bool, Float64, Int8

from gmmjax.clouds import SensorViews
from gmmjax.geometry.depth_image import Camera, DepthImage, cameras
from gmmjax.geometry.local_surface import LocalSurface

# The distance to this neighbour is the spacing of points on a surface: exact on a square grid, and right on average
# for points strewn at random.
SPACING_NEIGHBOUR = 4
# Sparse points must not hide more than this many times what a usual point hides.
WIDEST_SPACING = 3.0
# A point that is so many times further from those around it than they are from each other floats in the air: it is an
# outlier, such as the pixels that a depth camera puts between the two sides of an edge, and hides nothing.
STRAY = 2.0


class Observed(enum.IntEnum):
    """What a survey knows of a place."""

    unobserved = -1
    """Nothing: hidden, outside every field of view, or without a return."""

    surface = 0
    """It has a surface there."""

    free = 1
    """It looked through the place at something behind: nothing was there."""


@dataclasses.dataclass(frozen=True, eq=False)
class Survey:
    """One cloud, and where it was seen from; what is derived from them is kept, for the next question.

    Attributes:
        surface: the cloud, with the planes through the points' neighbourhoods.
        views: where it was taken from, or None where that is not known.
    """

    surface: LocalSurface
    views: SensorViews | None = None
    _images: dict[int, list[tuple[Camera, DepthImage]]] = dataclasses.field(
        default_factory=dict, init=False, repr=False
    )

    @classmethod
    def of(cls, points: Float64[np.ndarray, "n 3"], views: SensorViews | None = None) -> "Survey":
        """The survey of a cloud of at least one point, whose planes are computed."""
        return cls(LocalSurface.of(points), views)

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """The points of the cloud."""
        return self.surface.points

    @functools.cached_property
    def spacing(self) -> Float64[np.ndarray, " n"]:
        """Of each point from those beside it."""
        return point_spacing(self.surface)

    @functools.cached_property
    def stray(self) -> Bool[np.ndarray, " n"]:
        """Which points belong to no surface."""
        distances = _neighbour_distances(self.surface)
        if self.surface.neighbours.shape[1] < 2:
            return np.zeros(len(distances), bool)
        around = np.median(distances[self.surface.neighbours[:, 1:]], axis=1)
        return np.asarray(distances > STRAY * around)

    def images(self, view: int) -> list[tuple[Camera, DepthImage]]:
        """What a view sees of the cloud."""
        assert self.views is not None
        if view not in self._images:
            points = self.views.in_camera(self.points[~self.stray], view)
            spacing = self.spacing[~self.stray]
            self._images[view] = [
                (camera, DepthImage.of(points, spacing, camera)) for camera in cameras(self.views.field_of_view)
            ]
        return self._images[view]


def observation(points: Float64[np.ndarray, "n 3"], survey: Survey, margin: float) -> Int8[np.ndarray, " n"]:
    """What a survey knows of the places of points of another one.

    Where its cloud has a point within the margin there is a surface. A place further from it is free when at
    least one view looked past it: it lies in the field of view and range, the cloud has a surface behind it in
    the same direction, by more than the margin, and nothing in front of it in that direction or those next to it.
    The distance to the surface, not the depth along the ray, is held against the margin, so that a surface seen
    at a grazing angle is not taken for free space when it is a little misregistered.

    Args:
        points: the places, of the one cloud.
        survey: of the other cloud; one without views knows only its surfaces.
        margin: how far a surface may be displaced by noise and registration, in the unit of the clouds.

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
        free = _seen_through(points[open_places], survey, view, margin)
        result[open_places[free]] = Observed.free
        open_places = open_places[~free]
    return result


def point_spacing(surface: LocalSurface) -> Float64[np.ndarray, " n"]:
    """Distance of each point of a cloud to those beside it on the surface; stray points get that of the others."""
    distances = _neighbour_distances(surface)
    return np.asarray(np.minimum(distances, WIDEST_SPACING * np.median(distances)))


def _neighbour_distances(surface: LocalSurface) -> Float64[np.ndarray, " n"]:
    neighbour = min(SPACING_NEIGHBOUR, surface.neighbours.shape[1] - 1)
    return np.asarray(np.linalg.norm(surface.points[surface.neighbours[:, neighbour]] - surface.points, axis=1))


def _seen_through(
    points: Float64[np.ndarray, "n 3"], survey: Survey, view: int, margin: float
) -> Bool[np.ndarray, " n"]:
    """The points, none of them near the surface, that one view looked past."""
    free = np.zeros(len(points), bool)
    assert survey.views is not None
    places = survey.views.in_camera(points, view)
    visible = np.flatnonzero(survey.views.in_field_of_view(places))
    if not len(visible):
        return free
    for camera, image in survey.images(view):
        inside, directions, ranges = camera.seen(places[visible])
        behind, in_front = image.nearest(directions)
        free[visible[inside]] = np.isfinite(behind) & (behind > ranges + margin) & (in_front > ranges)
    return free
