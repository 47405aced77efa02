"""What a survey could see of a scene, and what nobody can be asked to find in it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.clouds import SensorViews
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, cast

# A point is seen when the first hit on its ray is not nearer than it by more than this, metres.
HIDDEN_BY = 0.03
# Points, at least, of a change that is counted in a cloud; less than half of them are unseen.
LEAST_POINTS = 40


def seen(points: Float[np.ndarray, "n 3"], solids: Sequence[Solid], views: SensorViews) -> Bool[np.ndarray, " n"]:
    """Which places a survey of these solids could see, through or onto."""
    visible = np.zeros(len(points), bool)
    for view in range(len(views)):
        places = views.in_camera(points, view)
        candidates = np.flatnonzero(views.in_field_of_view(places) & (places[:, 2] > 0) & ~visible)
        position = views.poses[view, :3, 3]
        rays = points[candidates] - position
        ranges = np.linalg.norm(rays, axis=1)
        first_hit, _ = cast(solids, position, rays / ranges[:, None])
        visible[candidates[first_hit > ranges - HIDDEN_BY]] = True
    return visible


def uncounted(solids: Sequence[Solid], truth: Int[np.ndarray, " n"], unseen: Bool[np.ndarray, " n"]) -> frozenset[int]:
    """The labels of those solids of which the cloud has too few points, or mostly such as the other survey cannot see.

    Args:
        solids: those with a label are changes.
        truth: per point the label of its change.
        unseen: per point whether the other survey could not see its place.
    """
    few = set()
    for number in {solid.label for solid in solids} - {UNLABELLED}:
        own = truth == number
        if own.sum() < LEAST_POINTS or unseen[own].mean() >= 0.5:
            few.add(number)
    return frozenset(few)
