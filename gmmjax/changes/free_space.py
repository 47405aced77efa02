"""What one survey knows of the places where the other one has points."""

import enum

import numpy as np
from jaxtyping import Bool, Float64, Int8
from scipy.spatial import cKDTree

from gmmjax.changes.depth_image import DepthImage, cameras
from gmmjax.clouds import SensorViews, voxel_grid, voxel_size_for

# Clouds with more points are thinned: finer detail than this shows in no depth image.
MOST_POINTS = 120_000
# The distance to this neighbour is the spacing of points on a surface: exact on a square grid, and right on average
# for points strewn at random.
SPACING_NEIGHBOUR = 4
# Stray points are sparse: they must not hide more than this many times what a usual point hides.
WIDEST_SPACING = 3.0


class Observed(enum.IntEnum):
    """What a survey knows of a place."""

    unobserved = -1
    """Nothing: hidden, outside every field of view, or without a return."""

    surface = 0
    """It has a surface there."""

    free = 1
    """It looked through the place at something behind: nothing was there."""


def observation(
    points: Float64[np.ndarray, "n 3"], other: Float64[np.ndarray, "m 3"], views: SensorViews, margin: float
) -> Int8[np.ndarray, " n"]:
    """What the survey that made the `other` cloud knows of the places of `points`.

    Where the other cloud has a point within the margin there is a surface. A place further from it is free when at
    least one view looked past it: it lies in the field of view and range, the other cloud has a surface behind it in
    the same direction, by more than the margin, and nothing in front of it in that direction or those next to it.
    The distance to the surface, not the depth along the ray, is held against the margin, so that a surface seen
    at a grazing angle is not taken for free space when it is a little misregistered.

    Args:
        points: the places, of the one cloud.
        other: the other cloud; none where the survey saw nothing.
        views: where the other cloud was taken from.
        margin: how far a surface may be displaced by noise and registration, in the unit of the clouds.

    Returns:
        A value of `Observed` for each of the points.
    """
    result = np.full(len(points), Observed.unobserved, np.int8)
    if not len(points) or not len(other):
        return result
    surface = thinned(other)
    tree = cKDTree(surface)
    near = np.isfinite(tree.query(points, distance_upper_bound=margin, workers=-1)[0])
    result[near] = Observed.surface
    open_places = np.flatnonzero(~near)
    spacing = point_spacing(tree)
    for view in range(len(views)):
        free = _seen_through(points[open_places], surface, spacing, views, view, margin)
        result[open_places[free]] = Observed.free
        open_places = open_places[~free]
    return result


def thinned(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    """The points, or the means of small voxels where there are more than `MOST_POINTS`."""
    if len(points) <= MOST_POINTS:
        return points
    return voxel_grid(points, voxel_size_for(points, MOST_POINTS)).points


def point_spacing(tree: cKDTree) -> Float64[np.ndarray, " n"]:
    """Distance of each point of a cloud to those beside it on the surface; stray points get that of the others."""
    neighbours = min(SPACING_NEIGHBOUR, tree.n - 1)
    if neighbours < 1:
        return np.zeros(tree.n)
    distances = tree.query(tree.data, k=[neighbours + 1], workers=-1)[0][:, 0]
    return np.asarray(np.minimum(distances, WIDEST_SPACING * np.median(distances)))


def _seen_through(
    points: Float64[np.ndarray, "n 3"],
    surface: Float64[np.ndarray, "m 3"],
    spacing: Float64[np.ndarray, " m"],
    views: SensorViews,
    view: int,
    margin: float,
) -> Bool[np.ndarray, " n"]:
    """The points, none of them near the surface, that one view looked past."""
    free = np.zeros(len(points), bool)
    places = views.in_camera(points, view)
    visible = np.flatnonzero(views.in_field_of_view(places))
    if not len(visible):
        return free
    surface = views.in_camera(surface, view)
    for camera in cameras(views):
        inside, directions, ranges = camera.seen(places[visible])
        behind, in_front = DepthImage.of(surface, spacing, camera).nearest(directions)
        free[visible[inside]] = np.isfinite(behind) & (behind > ranges + margin) & (in_front > ranges)
    return free
