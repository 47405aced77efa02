"""Whether sensor views can belong to a cloud at all."""

import numpy as np
from jaxtyping import Bool, Float64

from gmmjax.changes.evidence.free_space import Survey
from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError, warn

# Every point of a cloud was seen from somewhere. So many may still lie outside of all views (noise, or three quarters
# of the poses left out: 4 to 5 %) or be hidden in all of them (1 % in surveys of many frames; 2 to 6 % in single
# frames, at the edges of what hides them). Of a survey moved sideways by half its width 20 % are hidden.
MOST_OUTSIDE = 0.08
MOST_HIDDEN = 0.15
# A point is hidden when something lies this many spacings in front of it; nearer, it is the same slanted surface.
HIDDEN_SPACINGS = 8.0


def usable_views(name: str, survey: Survey) -> Survey:
    """The survey, without its views where they contradict the cloud.

    Args:
        name: the argument that the views came in, for the message.
        survey: a cloud of at least one point.

    Raises:
        InputError: the views see none of the points.

    Warns:
        InputWarning: the views contradict the cloud.
    """
    contradiction = None if survey.views is None else check_views(name, survey)
    if contradiction is None:
        return survey
    warn(contradiction)
    return Survey(survey.surface)


def check_views(name: str, survey: Survey) -> str | None:
    """Whether a cloud can have been taken from its views.

    Args:
        name: the argument that the views came in, for the message.
        survey: a cloud of at least one point, with views.

    Returns:
        None when all is well, else why the views contradict the cloud and what to do: they must not be used then.

    Raises:
        InputError: the views see none of the points.
    """
    views, points = survey.views, survey.points
    assert views is not None
    in_range, inside, visible = (np.zeros(len(points), bool) for _ in range(3))
    for view in range(len(views)):
        places = views.in_camera(points, view)
        in_range |= (places**2).sum(axis=1) <= views.max_range**2
        in_view = views.in_field_of_view(places)
        inside |= in_view
        if not visible[in_view].all():
            visible |= in_view & _visible(places, survey, view)
    if not inside.any():
        raise InputError(
            f"{name}: none of the {len(views)} view(s) sees any of the {len(points)} points of its cloud; poses are "
            "camera to world (x right, y down, z forward) in the cloud's frame and unit, the field of view in degrees"
        )
    return _contradiction(name, views, in_range.mean(), inside.mean(), visible[inside].mean())


def _contradiction(name: str, views: SensorViews, in_range: float, inside: float, visible: float) -> str | None:
    remedy = "free space is not used as evidence; check the poses (camera to world), the frame and the unit"
    if in_range < 1 - MOST_OUTSIDE:
        return (
            f"{name}: {1 - in_range:.0%} of the cloud's points are further than max_range={views.max_range:.4g} from "
            f"every view; {remedy}"
        )
    if inside < 1 - MOST_OUTSIDE:
        return f"{name}: {1 - inside:.0%} of the cloud's points are behind or beside every view; {remedy}"
    if visible < 1 - MOST_HIDDEN:
        return f"{name}: {1 - visible:.0%} of the cloud's points are hidden by others from every view; {remedy}"
    return None


def _visible(places: Float64[np.ndarray, "n 3"], survey: Survey, view: int) -> Bool[np.ndarray, " n"]:
    """The points of a survey that nothing hides from one view, in whose coordinates they are given."""
    visible = np.zeros(len(places), bool)
    for camera, image in survey.images(view):
        inside, directions, ranges = camera.seen(places)
        in_front, _ = image.nearest(directions)
        visible[inside] = in_front > ranges - HIDDEN_SPACINGS * survey.spacing[inside]
    return visible
