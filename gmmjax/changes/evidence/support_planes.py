"""Without sensor poses: what a change stood on was not uncovered or covered by anything but that change.

An object hides the shelf that it stands on, and what of it lies in its shadow. When the object goes, the shelf appears;
when it comes, the shelf disappears. But what stands on a surface shows that the surface is there.
"""

import numpy as np
from jaxtyping import Bool, Float64, Int

from gmmjax.clouds import voxel_grid
from gmmjax.geometry.planes import Plane, plane_surface, planes_of
from gmmjax.pair import Pair, each

# A support is flat: one plane holds this share of its voxels, which have an edge of so many spacings.
FLAT_SHARE, VOXEL = 0.75, 2.0
NOISE_DEVIATIONS = 3.0
# What stands on it has at most this share of its points on the other side.
MOST_BELOW = 0.03
# It touches the plane with points within so many spacings of it; so many of them have the support within so many
# spacings, along the plane.
TOUCHING_SPACINGS = 3.0
LEAST_TOUCHING, BESIDE_SPACINGS = 8, 5.0


def supports(
    points: Pair[Float64[np.ndarray, "_ 3"]], labels: Pair[Int[np.ndarray, " _"]], spacing: float
) -> Pair[Bool[np.ndarray, " _"]]:
    """The points of the segments of either cloud that a segment of the other one stands on.

    Of two flat segments that could stand on each other neither is taken for a support.

    Args:
        points: of both clouds.
        labels: -1, or the number of the segment that a point belongs to.
        spacing: distance of neighbouring points on a surface.
    """
    gone, new = each(_segments, points, labels)
    under = {(i, j) for i, segment in gone.items() for j, change in new.items() if _supports(segment, change, spacing)}
    over = {(i, j) for i, change in gone.items() for j, segment in new.items() if _supports(segment, change, spacing)}
    return Pair(
        np.isin(labels.before, [i for i, _ in under - over]),
        np.isin(labels.after, [j for _, j in over - under]),
    )


def _segments(points: np.ndarray, labels: np.ndarray) -> dict[int, np.ndarray]:
    return {int(label): points[labels == label] for label in np.unique(labels[labels >= 0])}


def _supports(segment: Float64[np.ndarray, "n 3"], change: Float64[np.ndarray, "m 3"], spacing: float) -> bool:
    """Whether a segment is flat, and a change of the other cloud stands on it."""
    plane, noise = _flat(segment, spacing)
    return plane is not None and _stands_on(change, segment, plane, noise, spacing)


def _flat(segment: Float64[np.ndarray, "n 3"], spacing: float) -> tuple[Plane | None, float]:
    """The plane that most of a segment lies on, if there is one, and how far from it its points may be."""
    noise = NOISE_DEVIATIONS * plane_surface(segment).thickness
    thinned = voxel_grid(segment, VOXEL * spacing).points
    planes = planes_of(plane_surface(thinned), max(noise, spacing / 2), 0.0, FLAT_SHARE)
    return (planes[0] if planes else None), noise


def _stands_on(
    change: Float64[np.ndarray, "m 3"], segment: Float64[np.ndarray, "n 3"], plane: Plane, noise: float, spacing: float
) -> bool:
    heights = change @ plane.normal - plane.offset
    heights *= 1 if np.median(heights) >= 0 else -1
    if (heights < -(noise + spacing)).mean() > MOST_BELOW:
        return False
    touching = change[heights < TOUCHING_SPACINGS * spacing + noise]
    on_plane = segment[plane.distance(segment) <= noise]
    return int(plane.near(touching, on_plane, BESIDE_SPACINGS * spacing).sum()) >= LEAST_TOUCHING
