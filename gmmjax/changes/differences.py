"""How far each point of one scan is from the surface of the other: to the nearest point, and along the normal.

The distance along the normal between local means is that of M3C2 (Lague, Brodu and Leroux 2013, section 3), on nearest
neighbours in place of cylinders: averages see offsets smaller than the noise of single points. The distance to the
nearest point sees what lies beside a surface, where normals say nothing.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gmmjax.geometry.local_surface import PLANE_NEIGHBOURS, LocalSurface
from gmmjax.geometry.neighbours import nearest_neighbours

MEDIAN_TO_DEVIATION = 1.4826
# k points that fill a disc of radius r evenly are r sqrt(pi / k) apart, with a spread of r / sqrt 2 about its centre.
SPACING_PER_SPREAD = np.sqrt(2 * np.pi / PLANE_NEIGHBOURS)


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
        offset: robust standard deviation of the offsets: noise of the local means and registration error together;
            positive.
    """

    distance: float
    offset: float


def local_difference(
    own: LocalSurface, other: LocalSurface, chosen: Int[np.ndarray, " n"] | None = None
) -> LocalDifference:
    """The distance and the offset of each point of one cloud to another one.

    Args:
        own: the cloud.
        other: the other cloud.
        chosen: indices of the points that are asked for; all by default.
    """
    chosen = np.arange(len(own)) if chosen is None else chosen
    groups = own.groups(chosen)
    means = groups.mean(axis=1)
    there = other.nearest(means)
    normals, variances = other.normals[there], other.variances[there]
    own_scatter = ((groups - means[:, None]) @ normals[:, :, None])[..., 0].var(axis=1)
    return LocalDifference(
        distance=nearest_neighbours(other.tree, own.points[chosen], 1)[0][:, 0],
        offset=np.abs(((means - other.centres[there]) * normals).sum(axis=1)),
        noise=np.sqrt(own_scatter / groups.shape[1] + variances[:, 0] / other.neighbours.shape[1]),
        thickness=np.sqrt(variances[:, 0]),
        spacing=SPACING_PER_SPREAD * np.sqrt(variances[:, 1] + variances[:, 2]),
    )


def difference_scale(
    before: LocalDifference, after: LocalDifference, *, finest_offset: float = 1e-6
) -> DifferenceScale:
    """The usual distances and offsets, from the medians of the cloud in which less has changed.

    Args:
        before: of each point of the before cloud to the after cloud.
        after: of each point of the after cloud to the before cloud.
        finest_offset: in spacings: surfaces without noise, such as computed planes, are compared no finer than this.
            Chosen: above the rounding of coordinates, 1e-9 m in a country's grid. 0: that rounding looks like an
            offset, and where there is none 0 is divided by 0.
    """
    sides = (before, after)
    offset = MEDIAN_TO_DEVIATION * min(float(np.median(side.offset)) for side in sides)
    finest = finest_offset * max(float(np.median(side.spacing)) for side in sides)
    return DifferenceScale(
        distance=min(float(np.median(side.distance)) for side in sides),
        offset=max(offset, finest),
    )
