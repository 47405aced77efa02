"""The stage that measures the changes of scans: the box around each one, its area and its volume."""

import dataclasses

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Box, Change
from gmmjax.changes.objects.support_plane import SupportPlane, support_planes
from gmmjax.changes.objects.volumes import MeasuredPart, with_volumes
from gmmjax.changes.signed_distance import OuterSide
from gmmjax.geometry import (
    LocalSurface,
    density_clusters,
    evenly_chosen,
    hull_corners,
    nearest_neighbours,
    smallest_box,
    upright_box,
)
from gmmjax.pair import Pair, each

# Points of a change, at most, by which its support plane is found; of fewer those of large objects are missed.
SAMPLE = 2500
# Points belong together within this multiple of the median distance of so many neighbours, two spacings on a surface,
# where there are so many of them; what lies apart are outliers, of which a box would be far too large.
NEIGHBOURS, REACH, TOGETHER = 8, 1.25, 3
# Fraction of a change's points, at least, of a part of it that is measured: else groups of outliers are.
MIN_PART = 0.1
# Faces of the convex hull of a change without a support plane that a box is tried on: with fewer round objects get
# larger boxes.
FACES = 24


def measure_changes(
    items: tuple[Change, ...],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    noise: float,
    sensors: Pair[Float64[np.ndarray, "_ 3"] | None],
    outer_side: OuterSide,
) -> tuple[Change, ...]:
    """The changes with the smallest box around their points, but for outliers, their area and their volume.

    A change that stands on a plane is measured down to it: what touches the floor looks unchanged, and belongs to the
    object. Its box is upright.

    Args:
        items: the changes of both clouds.
        labels: the change of each point of the clouds, or -1.
        pair: both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        sensors: where those of each survey stood; None: not known.
        outer_side: what tells from which side surfaces were seen.
    """
    points = [_points_of(index, pair.points, labels) for index in range(len(items))]
    working = each(lambda own, cloud: cloud.of_working_points(own), labels, pair.working.clouds)
    background = np.concatenate([*each(lambda surface, own: surface.points[own < 0], pair.surfaces, working)])
    surfaces = pair.surfaces.map(lambda surface: surface.points)
    parts = [_part(_points_of(index, surfaces, working)) for index in range(len(items))]
    planes = support_planes(parts, background, noise)
    # Relative to the change, because the coordinates of a survey leave no digits for a volume.
    kept = [_without_outliers(own - item.mean) for item, own in zip(items, points, strict=True)]
    boxed = [_boxed(item, own, plane) for item, own, plane in zip(items, kept, planes, strict=True)]
    sides = [bool((labels.after == index).any()) for index in range(len(items))]
    measured = [MeasuredPart(*part) for part in zip(kept, sides, planes, strict=True)]
    return with_volumes(boxed, measured, labels, pair, sensors, outer_side, noise)


def _points_of(
    index: int, points: Pair[Float64[np.ndarray, "_ 3"]], labels: Pair[Int[np.ndarray, " _"]]
) -> Float64[np.ndarray, "n 3"]:
    """The points of a change, which are all of one cloud."""
    return np.concatenate([*each(lambda cloud, own: cloud[own == index], points, labels)])


def _part(points: Float64[np.ndarray, "n 3"]) -> LocalSurface:
    return LocalSurface.of(points[evenly_chosen(len(points), SAMPLE)])


def _boxed(change: Change, points: Float64[np.ndarray, "n 3"], plane: SupportPlane | None) -> Change:
    corners = hull_corners(points)
    if plane is None:
        box = smallest_box(corners, FACES)
    else:
        height = plane.height - float(change.mean @ plane.up)
        projections = corners - (corners @ plane.up - height)[:, None] * plane.up
        corners = hull_corners(np.concatenate([corners, projections]))
        box = upright_box(corners, plane.up)
    return dataclasses.replace(change, box=Box.longest_first(box._replace(centre=box.centre + change.mean)))


def _without_outliers(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    """The points of the parts of a change that are large enough; all where none is."""
    # The point itself is its first neighbour.
    distances = nearest_neighbours(cKDTree(points), points, NEIGHBOURS + 1)[0][:, -1]
    spacing = float(np.median(distances))
    if spacing == 0:
        return points
    clusters = density_clusters(points, REACH * spacing, TOGETHER)
    large = np.bincount(clusters[clusters >= 0]) >= MIN_PART * len(points)
    kept = (clusters >= 0) & np.append(large, False)[clusters]
    return points[kept] if kept.any() else points
