"""Without sensor poses: which segments are walls at the edge of what the other survey saw.

What hides something can only be told to have gone, or come, by a survey that saw what is behind it. A wall behind which
the other cloud has no point at all was not seen by the other survey, not built or torn down. The flat top of a box on
a bare floor has no point above it either, but it hides the floor: the other cloud has that, and this one has not.
"""

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax.clouds import voxel_grid
from gmmjax.geometry.planes import plane_surface, planes_of

# The segment is thinned to voxels of so many spacings, and is laid in so few planes as hold so many of them each.
VOXEL = 2.0
LEAST_SHARE = 0.15
# So few of the other cloud's points may be behind a wall: stray ones.
MOST_BEHIND = 0.01
# Points of the two clouds are at the same place of a surface within so many spacings.
NEAR = 2.0
# Where the other cloud has points of a plane next to most of what lies on it, it has no hole there.
MOST_COVERED = 0.75
# A wall hides at most this share of what the other cloud has straight before it.
MOST_HIDDEN = 0.5


def at_observed_edge(
    segment: Float64[np.ndarray, "m 3"],
    of_unchanged: cKDTree,
    of_other: cKDTree,
    flatness: float,
    tolerance: float,
    spacing: float,
) -> Bool[np.ndarray, " m"]:
    """The points of a segment that lie on a wall at the edge of what the other survey saw.

    Args:
        segment: the points of one segment.
        of_unchanged: tree of the unchanged points of the same cloud.
        of_other: tree of the other cloud.
        flatness: how far from a wall its points are, at the most.
        tolerance: how far apart, at the most, an unchanged surface may be in the two clouds.
        spacing: distance of neighbouring points on a surface.
    """
    at_edge = np.zeros(len(segment), bool)
    thinned = voxel_grid(segment, VOXEL * spacing).points
    for wall in planes_of(plane_surface(thinned), flatness, 0.0, LEAST_SHARE):
        on_wall = wall.distance(segment) <= flatness
        if not on_wall.any():
            continue
        heights = of_other.data @ wall.normal - wall.offset
        heights *= 1 if np.median(heights) >= 0 else -1
        clear = flatness + tolerance
        behind = heights < -clear
        if behind.mean() > MOST_BEHIND:
            continue
        covered = wall.near(segment[on_wall], of_other.data[np.abs(heights) <= clear], NEAR * spacing).mean()
        over = of_other.data[heights > clear]
        over = over[wall.near(over, segment[on_wall], NEAR * spacing)]
        if covered <= MOST_COVERED and _hidden(over, of_unchanged, NEAR * spacing) <= MOST_HIDDEN:
            at_edge |= on_wall
    return at_edge


def _hidden(others: Float64[np.ndarray, "k 3"], of_unchanged: cKDTree, near: float) -> float:
    """How much of what the other cloud has is missing in this cloud."""
    return float(np.isinf(of_unchanged.query(others, distance_upper_bound=near)[0]).mean()) if len(others) else 0.0
