"""Small boxes around points: upright ones where the upward direction is known, else in any orientation."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull, QhullError


class OrientedBox(NamedTuple):
    """A box in any orientation.

    Attributes:
        centre: of the box.
        extent: full edge lengths along its own axes.
        rotation: those axes as the columns of a rotation matrix.
    """

    centre: Float64[np.ndarray, "3"]
    extent: Float64[np.ndarray, "3"]
    rotation: Float64[np.ndarray, "3 3"]


def hull_volume(points: Float64[np.ndarray, "n 3"]) -> float:
    """The volume of the convex hull; 0 where the points lie in a plane."""
    hull = _hull(points)
    return 0.0 if hull is None else float(hull.volume)


def hull_area(points: Float64[np.ndarray, "n 2"]) -> float:
    """The area of the convex hull; 0 where the points lie on a line."""
    hull = _hull(points)
    # What a hull encloses is its volume, in two dimensions too.
    return 0.0 if hull is None else float(hull.volume)


def hull_corners(points: Float64[np.ndarray, "n d"]) -> Float64[np.ndarray, "m d"]:
    """The corners of the convex hull, in two dimensions counterclockwise; all points where they span none."""
    hull = _hull(points)
    return points if hull is None else np.asarray(points[hull.vertices])


def upright_box(points: Float64[np.ndarray, "n 3"], up: Float64[np.ndarray, "3"]) -> OrientedBox:
    """The box around points with the least footprint, of those whose last axis is the upward direction.

    One side of the rectangle of least area lies along an edge of the convex hull (Freeman and Shapira 1975).

    Args:
        points: at least one.
        up: unit vector.
    """
    across = np.linalg.svd(up[None])[2][1:]
    plane = hull_corners(points @ across.T)
    edges = np.roll(plane, -1, axis=0) - plane
    edges = edges[(edges != 0).any(axis=1)]
    along = edges / np.linalg.norm(edges, axis=1)[:, None] if len(edges) else np.eye(1, 2)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    areas = np.ptp(plane @ along.T, axis=0) * np.ptp(plane @ aside.T, axis=0)
    first = along[int(np.argmin(areas))] @ across
    return _box_along(points, np.stack([first, np.cross(up, first), up], axis=1))


def smallest_box(points: Float64[np.ndarray, "n 3"], faces: int) -> OrientedBox:
    """The smallest of the boxes around points that have a side on one of the largest faces of their convex hull.

    Args:
        points: at least one.
        faces: number of faces, at most, that are tried. Fewer: faster, and round objects get larger boxes.
    """
    hull = _hull(points)
    if hull is None:
        return upright_box(points, _min_direction(points))
    corners = points[hull.vertices]
    boxes = [upright_box(corners, normal) for normal in _largest_faces(points, hull, faces)]
    return min(boxes, key=lambda box: float(np.prod(box.extent)))


def _hull(points: Float64[np.ndarray, "n d"]) -> ConvexHull | None:
    """The convex hull; None where the points lie in a plane, or on a line."""
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def _largest_faces(points: Float64[np.ndarray, "n 3"], hull: ConvexHull, most: int) -> Float64[np.ndarray, "f 3"]:
    """The unit normals of the largest triangles of a hull, those of one plane once."""
    corners = points[hull.simplices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    planes, place = np.unique(hull.equations, axis=0, return_inverse=True)
    order = np.argsort(-np.bincount(place.ravel(), areas), kind="stable")[:most]
    return np.asarray(planes[order, :3])


def _min_direction(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " 3"]:
    """The unit normal of the plane that flat points lie in."""
    return np.asarray(np.linalg.eigh(np.cov(points.T, bias=True))[1][:, 0])


def _box_along(points: Float64[np.ndarray, "n 3"], rotation: Float64[np.ndarray, "3 3"]) -> OrientedBox:
    inside = points @ rotation
    lower, upper = inside.min(axis=0), inside.max(axis=0)
    return OrientedBox(rotation @ ((lower + upper) / 2), upper - lower, rotation)
