"""Boxes as depth cameras see them, and rigid motions of them."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.prepare.resolution import WorkingCloud, WorkingPair
from gmmjax.changes.registration import Registration
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

# Faces of a box: the positive sides along x, y and z, then the negative ones along x and y. It stands on the last.
SIDES_AND_TOP = (0, 1, 2, 3, 4)


def box(seed, extent, faces=SIDES_AND_TOP, density=9000.0, noise=0.005):
    """Points of some faces of a box about the origin, so many a unit of area."""
    random = np.random.default_rng(seed)
    extent = np.array(extent)
    parts = []
    for face in faces:
        across = face % 3
        area = np.prod(np.delete(extent, across))
        points = random.uniform(-0.5, 0.5, (int(density * area), 3))
        points[:, across] = 0.5 if face < 3 else -0.5
        parts.append(points * extent)
    points = np.concatenate(parts)
    return points + noise * random.standard_normal(points.shape)


def motion(yaw, shift):
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec([0, 0, yaw]).as_matrix()
    transform[:3, 3] = shift
    return transform


def placed(points, transform):
    return points @ transform[:3, :3].T + transform[:3, 3]


def level(seed, height, middle=(0.0, 0.0), half=0.7, hole=None, spacing=0.012, noise=0.003):
    """A floor or a shelf, and what of it an object (a box that is cut out) does not hide."""
    steps = np.arange(-half, half, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    scatter = noise * np.random.default_rng(seed).standard_normal((3, len(x)))
    points = np.stack([x + middle[0], y + middle[1], np.full(len(x), height)], axis=1) + scatter.T
    if hole is None:
        return points
    return points[~((points[:, :2] > hole.min(axis=0)[:2]) & (points[:, :2] < hole.max(axis=0)[:2])).all(axis=1)]


def standing(seed, extent=(0.4, 0.28, 0.22), height=0.0, middle=(0.0, 0.0), yaw=0.0, faces=SIDES_AND_TOP):
    """A box with its base at this height."""
    points = placed(box(seed, extent, faces), motion(yaw, [0, 0, 0]))
    return points + np.array([*middle, height + extent[2] / 2])


def on_floor_and_shelf():
    """A box on the floor and one on a shelf, and what is around them."""
    objects = standing(0), standing(1, height=0.6, middle=(1.0, 0.0))
    return objects, np.concatenate([level(2, 0.0, hole=objects[0]), level(3, 0.6, (1.0, 0.0), 0.3, hole=objects[1])])


def registered(before, after):
    """Two clouds in one frame, each point its own voxel."""
    points = Pair(before, after)
    surfaces = points.map(LocalSurface.of)
    clouds = points.map(lambda own: WorkingCloud(own, np.ones(len(own)), np.arange(len(own))))
    spacing = max(surface.nearest_distance for surface in surfaces)
    return AlignedPair(points, WorkingPair(clouds, None, spacing, False), surfaces, Registration.none())
