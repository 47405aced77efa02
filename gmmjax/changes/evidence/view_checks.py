"""Whether sensor views can belong to a cloud at all: each of its points was observed from one of them."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64

from gmmjax.changes.evidence.free_space import Survey
from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError, warn


@dataclasses.dataclass(frozen=True)
class ViewCheckSettings:
    """From when on views contradict their cloud.

    Attributes:
        most_outside: fraction of the points outside of all views, at most: noise, or poses that were left out (with
            three quarters of them left out 4 to 5 %). 1: views of another survey are used.
        most_occluded: fraction of the points in the views that are occluded in all of them, at most. Measured: 1 % in
            surveys of many frames, 2 to 6 % in single frames, at the edges of occluding objects, and 20 % in a survey
            moved sideways by half its width. 1: such a survey is used.
        occlusion_depth: a point is occluded when something lies this many spacings in front of it; nearer, it is the
            same slanted surface. 0: most of a slanted surface is occluded by itself.
    """

    most_outside: float = 0.08
    most_occluded: float = 0.15
    occlusion_depth: float = 8.0


def usable_views(name: str, survey: Survey, settings: ViewCheckSettings = ViewCheckSettings()) -> Survey:
    """The survey, without its views where they contradict the cloud.

    Args:
        name: the argument that the views came in, for the message.
        survey: a cloud of at least one point.
        settings: from when on they do.

    Raises:
        InputError: the views see none of the points.

    Warns:
        InputWarning: the views contradict the cloud.
    """
    contradiction = None if survey.views is None else check_views(name, survey, settings)
    if contradiction is None:
        return survey
    warn(contradiction)
    return dataclasses.replace(survey, views=None)


def check_views(name: str, survey: Survey, settings: ViewCheckSettings = ViewCheckSettings()) -> str | None:
    """Whether a cloud can have been taken from its views.

    Args:
        name: the argument that the views came in, for the message.
        survey: a cloud of at least one point, with views.
        settings: from when on views contradict their cloud.

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
            visible |= in_view & _visible(places, survey, view, settings)
    if not inside.any():
        raise InputError(
            f"{name}: none of the {len(views)} view(s) sees any of the {len(points)} points of its cloud; poses are "
            "camera to world (x right, y down, z forward) in the cloud's frame and unit, the field of view in degrees"
        )
    return _contradiction(name, views, in_range.mean(), inside.mean(), visible[inside].mean(), settings)


def _contradiction(
    name: str, views: SensorViews, in_range: float, inside: float, visible: float, settings: ViewCheckSettings
) -> str | None:
    """Why the views contradict the cloud, by the fractions of its points in range, in a view, and not occluded."""
    remedy = "free space is not used as evidence; check the poses (camera to world), the frame and the unit"
    if in_range < 1 - settings.most_outside:
        return (
            f"{name}: {1 - in_range:.0%} of the cloud's points are further than max_range={views.max_range:.4g} from "
            f"every view; {remedy}"
        )
    if inside < 1 - settings.most_outside:
        return f"{name}: {1 - inside:.0%} of the cloud's points are behind or beside every view; {remedy}"
    if visible < 1 - settings.most_occluded:
        return f"{name}: {1 - visible:.0%} of the cloud's points are hidden by others from every view; {remedy}"
    return None


def _visible(
    places: Float64[np.ndarray, "n 3"], survey: Survey, view: int, settings: ViewCheckSettings
) -> Bool[np.ndarray, " n"]:
    """Which points of a survey, in the coordinates of one view, are not occluded in it."""
    visible = np.zeros(len(places), bool)
    for frustum, image in survey.images(view):
        inside, directions, ranges = frustum.project(places)
        in_front, _ = image.nearest(directions)
        visible[inside] = in_front > ranges - settings.occlusion_depth * survey.spacing[inside]
    return visible
