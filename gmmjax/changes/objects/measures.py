"""The stage that measures the changes of scans: the box around each one, and its volume."""

import dataclasses

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Box, Change
from gmmjax.changes.objects.support_plane import SupportPlane, SupportPlaneSettings, support_planes
from gmmjax.geometry import (
    LocalSurface,
    evenly_chosen,
    hull_corners,
    hull_volume,
    nearest_neighbours,
    smallest_box,
    upright_box,
)
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class MeasureSettings:
    """How changes are measured.

    Attributes:
        sample: number of points of a change, at most, by which its support plane is found. Fewer: those of large
            objects are missed.
        neighbours: number of neighbours by whose distance a point of a change is told from an outlier, which lies apart
            from it and would make the box far too large. Fewer: pairs of outliers are measured.
        outlier_distance: the same distance of an outlier, in median ones of the change, at least. Infinite: outliers
            are measured; 1: half of the points are left out.
        faces: number of faces of the convex hull of a change without a support plane that a box is tried on. Fewer:
            faster, and round objects get larger boxes.
        support: what a change stands on.
    """

    sample: int = 2500
    neighbours: int = 8
    outlier_distance: float = 2.5
    faces: int = 24
    support: SupportPlaneSettings = SupportPlaneSettings()


def measured(
    items: tuple[Change, ...],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    noise: float,
    settings: MeasureSettings = MeasureSettings(),
) -> tuple[Change, ...]:
    """The changes with the smallest box around their points, but for outliers, and the volume of their convex hull.

    A change that stands on a plane is measured down to it: what touches the floor looks unchanged, and belongs to the
    object. Its box is upright.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the clouds, or -1.
        pair: both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        settings: how they are measured.
    """
    points = [_points_of(index, pair.points, labels) for index in range(len(items))]
    working = each(lambda own, cloud: cloud.of_working_points(own), labels, pair.working.clouds)
    background = np.concatenate([*each(lambda surface, own: surface.points[own < 0], pair.surfaces, working)])
    surfaces = pair.surfaces.map(lambda surface: surface.points)
    parts = [_part(_points_of(index, surfaces, working), settings) for index in range(len(items))]
    planes = support_planes(parts, background, noise, settings.support)
    return tuple(
        _with_measures(item, own, plane, settings) for item, own, plane in zip(items, points, planes, strict=True)
    )


def _points_of(
    index: int, points: Pair[Float64[np.ndarray, "_ 3"]], labels: Pair[Int[np.ndarray, " _"]]
) -> Float64[np.ndarray, "n 3"]:
    """The points of a change, which are all of one cloud."""
    return np.concatenate([*each(lambda cloud, own: cloud[own == index], points, labels)])


def _part(points: Float64[np.ndarray, "n 3"], settings: MeasureSettings) -> LocalSurface:
    return LocalSurface.of(points[evenly_chosen(len(points), settings.sample)])


def _with_measures(
    change: Change, points: Float64[np.ndarray, "n 3"], plane: SupportPlane | None, settings: MeasureSettings
) -> Change:
    # Relative to the change, because the coordinates of a survey leave no digits for a volume.
    corners = hull_corners(_without_outliers(points - change.mean, settings))
    if plane is None:
        box = smallest_box(corners, settings.faces)
    else:
        height = plane.height - float(change.mean @ plane.up)
        projections = corners - (corners @ plane.up - height)[:, None] * plane.up
        corners = hull_corners(np.concatenate([corners, projections]))
        box = upright_box(corners, plane.up)
    return dataclasses.replace(
        change, box=Box.longest_first(box._replace(centre=box.centre + change.mean)), volume=hull_volume(corners)
    )


def _without_outliers(points: Float64[np.ndarray, "n 3"], settings: MeasureSettings) -> Float64[np.ndarray, "m 3"]:
    # The point itself is its first neighbour.
    distances = nearest_neighbours(cKDTree(points), points, settings.neighbours + 1)[0][:, -1]
    return points[distances <= settings.outlier_distance * np.median(distances)]
