"""Boxes as depth cameras see them, and rigid motions of them."""

import numpy as np
from scipy.spatial.transform import Rotation

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
