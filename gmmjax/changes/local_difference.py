"""How far each point of one scan is from the surface of the other: to the nearest point, and along the normal.

The distance along the normal between local means is that of M3C2 (Lague, Brodu and Leroux 2013, section 3), on nearest
neighbours in place of cylinders: averages see offsets smaller than the noise of single points. The distance to the
nearest point sees what lies beside a surface, where normals say nothing.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from gmmjax.changes.neighbours import nearest_neighbours
from gmmjax.changes.planes import local_planes

# Neighbours in the own cloud whose mean is compared, and in the other cloud whose plane it is compared with.
OWN_NEIGHBOURS = 8
OTHER_NEIGHBOURS = 16
MEDIAN_TO_DEVIATION = 1.4826
# k points that fill a disc of radius r evenly are r sqrt(pi / k) apart, with a spread of r / sqrt 2 about its centre.
SPACING_PER_SPREAD = np.sqrt(2 * np.pi / OTHER_NEIGHBOURS)


class LocalDifference(NamedTuple):
    """For each point of one cloud how far it is from the other one.

    Attributes:
        distance: to the nearest point of the other cloud.
        offset: along the normal of the other cloud's surface, between local means.
        noise: standard deviation of that offset by the scatter of both surfaces about their planes.
        thickness: standard deviation of the other cloud's points about their plane there.
        spacing: of the other cloud's points there.
    """

    distance: Float[np.ndarray, " n"]
    offset: Float[np.ndarray, " n"]
    noise: Float[np.ndarray, " n"]
    thickness: Float[np.ndarray, " n"]
    spacing: Float[np.ndarray, " n"]


class DifferenceScale(NamedTuple):
    """What distances and offsets are usual in a pair of clouds, most of whose points are unchanged.

    Attributes:
        distance: median distance to the nearest point of the other cloud.
        offset: robust standard deviation of the offsets: noise of the local means and registration error together.
    """

    distance: float
    offset: float


def local_difference(points: Float[np.ndarray, "n 3"], own: cKDTree, other: cKDTree) -> LocalDifference:
    """The distance and the offset of each point.

    Args:
        points: of one cloud.
        own: tree of that cloud.
        other: tree of the other cloud.
    """
    own_groups = own.data[nearest_neighbours(own, points, OWN_NEIGHBOURS)[1]]
    means = own_groups.mean(axis=1)
    groups = other.data[nearest_neighbours(other, means, OTHER_NEIGHBOURS)[1]]
    centres, normals, variances = local_planes(groups)
    own_scatter = ((own_groups - means[:, None]) @ normals[:, :, None])[..., 0].var(axis=1)
    return LocalDifference(
        distance=nearest_neighbours(other, points, 1)[0][:, 0],
        offset=np.abs(np.einsum("ni,ni->n", means - centres, normals)),
        noise=np.sqrt(own_scatter / own_groups.shape[1] + variances[:, 0] / groups.shape[1]),
        thickness=np.sqrt(variances[:, 0]),
        spacing=SPACING_PER_SPREAD * np.sqrt(variances[:, 1] + variances[:, 2]),
    )


def difference_scale(before: LocalDifference, after: LocalDifference) -> DifferenceScale:
    """The usual distances and offsets, from the medians of the cloud in which less has changed."""
    return DifferenceScale(
        distance=min(float(np.median(side.distance)) for side in (before, after)),
        offset=MEDIAN_TO_DEVIATION * min(float(np.median(side.offset)) for side in (before, after)),
    )
