"""Rooms with boxes in them, as depth cameras see them: the ray meets the inside of the room or the outside of a box."""

import numpy as np

from gmmjax.clouds import SensorViews, voxel_grid

ROOM = (np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.5]))
FIELD_OF_VIEW = (62.0, 48.0)


def box(centre, size):
    """Lower and upper corner of a box that stands at `centre`, the middle of its underside."""
    centre, half = np.array(centre, float), np.array(size, float) / 2
    return centre - half * [1, 1, 0], centre + half * [1, 1, 2]


def looking(position, target):
    """The pose of a camera at a position that looks at a target, z is up in the world."""
    forward = np.array(target, float) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


def around(count, height=1.3, radius=0.9, target=(0, 0, 0.2)):
    """Views from a circle of places, all looking at the middle of the room."""
    angles = 2 * np.pi * np.arange(count) / count
    places = [(radius * np.cos(angle), radius * np.sin(angle), height) for angle in angles]
    return SensorViews(np.stack([looking(place, target) for place in places]), FIELD_OF_VIEW, 4.0)


def scanned(views, boxes=(), room=ROOM, pixels=(128, 96), noise=0.0, seed=0, voxel=None):
    """What the views see of the boxes in the room, as one cloud."""
    generator = np.random.default_rng(seed)
    tangents = [
        np.tan(np.radians(angle) / 2) * np.linspace(-1, 1, count)
        for angle, count in zip(views.field_of_view, pixels, strict=True)
    ]
    x, y = (grid.ravel() for grid in np.meshgrid(*tangents))
    frames = []
    for pose in views.poses:
        directions = np.stack([x, y, np.ones_like(x)], axis=1) @ pose[:3, :3].T
        depth = _enters_or_leaves(pose[:3, 3], directions, room)[1]
        for other in boxes:
            enter, leave = _enters_or_leaves(pose[:3, 3], directions, other)
            depth = np.where((enter < leave) & (enter > 0), np.minimum(depth, enter), depth)
        depth = depth + noise * depth * generator.normal(size=len(depth))
        points = pose[:3, 3] + depth[:, None] * directions
        frames.append(points[depth * np.linalg.norm(directions, axis=1) <= views.max_range])
    points = np.concatenate(frames)
    return points if voxel is None else voxel_grid(points, voxel).points


def _enters_or_leaves(position, directions, corners):
    with np.errstate(divide="ignore"):
        hits = np.stack([(corner - position) / directions for corner in corners])
    return hits.min(axis=0).max(axis=1), hits.max(axis=0).min(axis=1)
