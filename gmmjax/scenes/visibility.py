"""The part of a scene that a survey observes, and the changes that cannot be found in it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.clouds import SensorViews
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, cast

# What `seen` calls occluded unless told otherwise, metres.
HIDDEN_BY = 0.03
# A change is counted in a cloud when it has at least this number of points there, less than half of them unseen.
LEAST_POINTS = 40


def seen(
    points: Float[np.ndarray, "n 3"],
    solids: Sequence[Solid],
    views: SensorViews,
    *,
    hidden_by: float = HIDDEN_BY,
    least_elevation: float = -90.0,
) -> Bool[np.ndarray, " n"]:
    """Which points lie in the free space or on the surfaces that a survey observes.

    Args:
        points: in the world, metres.
        solids: of the scene.
        views: poses and field of view of the survey's camera or scanner.
        hidden_by: a point is occluded when the first hit on its ray is nearer than the point by more than this, metres.
        least_elevation: a turning scanner does not measure lower than this, degrees.
    """
    least_sine = np.sin(np.radians(least_elevation))
    visible = np.zeros(len(points), bool)
    for view in range(len(views)):
        places = views.in_camera(points, view)
        sensed = -places[:, 1] >= least_sine * np.linalg.norm(places, axis=1) if views.turning else places[:, 2] > 0
        candidates = np.flatnonzero(views.in_field_of_view(places) & sensed & ~visible)
        position = views.poses[view, :3, 3]
        rays = points[candidates] - position
        ranges = np.linalg.norm(rays, axis=1)
        first_hit, _ = cast(solids, position, rays / ranges[:, None])
        visible[candidates[first_hit > ranges - hidden_by]] = True
    return visible


def uncounted(solids: Sequence[Solid], truth: Int[np.ndarray, " n"], unseen: Bool[np.ndarray, " n"]) -> frozenset[int]:
    """The labels of changes with too few points in the cloud, or most of whose points the other survey cannot see.

    Args:
        solids: of the scene; those with a label are changes.
        truth: per point the label of its change; of what a change of the other time covers, that of the cover.
        unseen: per point whether the other survey could not see its place.
    """
    few = set()
    for number in ({solid.label for solid in solids} | set(truth.tolist())) - {UNLABELLED}:
        own = truth == number
        if own.sum() < LEAST_POINTS or unseen[own].mean() >= 0.5:
            few.add(number)
    return frozenset(few)
