"""Whether sensor views can belong to a cloud at all: each of its points was observed from one of them."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64

from gmmjax.changes.evidence.survey import Survey
from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError, warn
from gmmjax.geometry import DepthImage, Frustum, frustums


@dataclasses.dataclass(frozen=True)
class ViewCheckSettings:
    """From when on views contradict their cloud.

    Attributes:
        most_outside: fraction of the points outside of all views, at most: noise, or poses that were left out (with
            three quarters of them left out 4 to 5 %). 1: views of another survey are used.
        most_occluded: fraction of the points in the views that are occluded in all of them, at most; where it is more,
            `most_hidden` decides. Measured: 1 % in surveys of many frames, 2 to 7 % in single frames, at the edges of
            occluding objects, 10 to 40 % in a scanner's single scan, and 16 to 38 % in a survey moved sideways by half
            its width. 1: such a survey is used.
        occlusion_depth: a point is occluded when something lies this many spacings in front of it; nearer, it is the
            same slanted surface. 0: most of a slanted surface is occluded by itself.
        most_hidden: fraction of the points that are occluded together with their neighbours, by what is neither near
            the sensor nor seen at a grazing angle, at most, of a single view; of n views an n-th of it, since what one
            of them misses another one sees. Measured in single scans: up to 10 %, and 14 to 50 % from a place that is
            off by half of their width. 1: such a scan is used; 0: scanners that see their stand are refused.
        nearest_range: what is nearer than this fraction of the upper quartile of the ranges in a view occludes nothing
            in that test: the stand of a scanner, which turns beside the axis that the view is given for. 0: the stand
            contradicts its own view; towards 1: nothing contradicts a view.
        least_incidence: cosine between the ray and the normal of a surface that occludes in that test, at least. 0:
            surfaces at a grazing angle occlude, which noise displaces across the ray; 1: nothing does.
        hidden_neighbours: fraction of a point's neighbours that are occluded with it in that test, at least. 0: single
            points at the edges of surfaces count; 1: only what is far from all that is visible.
    """

    most_outside: float = 0.08
    most_occluded: float = 0.15
    occlusion_depth: float = 8.0
    most_hidden: float = 0.125
    nearest_range: float = 0.3
    least_incidence: float = 0.2
    hidden_neighbours: float = 0.5


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
    return survey.without_views()


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
            visible |= in_view & _unoccluded(places, survey, survey.images(view), settings)
    if not inside.any():
        raise InputError(
            f"{name}: none of the {len(views)} view(s) sees any of the {len(points)} points of its cloud; poses are "
            "camera to world (x right, y down, z forward) in the cloud's frame and unit, the field of view in degrees"
        )
    occluded = 1 - float(visible[inside].mean())
    if occluded > settings.most_occluded and not _hidden_by_much(survey, inside & ~visible, settings):
        occluded = 0.0
    return _contradiction(name, views, in_range.mean(), inside.mean(), occluded, settings)


def _contradiction(
    name: str, views: SensorViews, in_range: float, inside: float, occluded: float, settings: ViewCheckSettings
) -> str | None:
    """Why the views contradict the cloud, by the fractions of its points in range, in a view, and occluded there."""
    remedy = "free space is not used as evidence; check the poses (camera to world), the frame and the unit"
    if in_range < 1 - settings.most_outside:
        return (
            f"{name}: {1 - in_range:.0%} of the cloud's points are further than max_range={views.max_range:.4g} from "
            f"every view; {remedy}"
        )
    if inside < 1 - settings.most_outside:
        return f"{name}: {1 - inside:.0%} of the cloud's points are behind or beside every view; {remedy}"
    if occluded > settings.most_occluded:
        return f"{name}: {occluded:.0%} of the cloud's points are hidden by others from every view; {remedy}"
    return None


def _unoccluded(
    places: Float64[np.ndarray, "n 3"],
    survey: Survey,
    images: list[tuple[Frustum, DepthImage]],
    settings: ViewCheckSettings,
) -> Bool[np.ndarray, " n"]:
    """Which points of a survey, in the coordinates of one view, nothing in the view's images occludes."""
    visible = np.zeros(len(places), bool)
    for frustum, image in images:
        inside, directions, ranges = frustum.project(places)
        in_front = image.nearest(directions).range
        visible[inside] = in_front > ranges - settings.occlusion_depth * survey.spacing[inside]
    return visible


def _hidden_by_much(survey: Survey, occluded: Bool[np.ndarray, " n"], settings: ViewCheckSettings) -> bool:
    """Whether points are still occluded by what is neither near the sensor nor seen at a grazing angle.

    Args:
        survey: a cloud with views.
        occluded: its points that are in a view, and occluded in all of these.
        settings: what occludes, and how much of the cloud may be.
    """
    assert survey.views is not None
    hidden = occluded.copy()
    for view in range(len(survey.views)):
        places = survey.views.in_camera(survey.points, view)
        visible = survey.views.in_field_of_view(places)
        if visible.any():
            hidden &= ~(visible & _unoccluded(places, survey, _clear_images(survey, view, settings), settings))
    together = hidden & (hidden[survey.surface.neighbours].mean(axis=1) >= settings.hidden_neighbours)
    return bool(together.mean() > settings.most_hidden / len(survey.views))


def _clear_images(survey: Survey, view: int, settings: ViewCheckSettings) -> list[tuple[Frustum, DepthImage]]:
    """The depth images of a view without the nearest points in it, and without surfaces at a grazing angle."""
    assert survey.views is not None
    places = survey.views.in_camera(survey.points, view)
    ranges = np.linalg.norm(places, axis=1)
    normals = survey.surface.normals @ survey.views.poses[view, :3, :3]
    facing = np.abs((normals * places).sum(axis=1)) > settings.least_incidence * ranges
    nearest = settings.nearest_range * np.quantile(ranges[survey.views.in_field_of_view(places)], 0.75)
    shown = facing & (ranges > nearest) & ~survey.outliers
    images = survey.settings.images
    return [
        (frustum, DepthImage.of(places[shown], survey.spacing[shown], frustum, images))
        for frustum in frustums(survey.views.field_of_view, images)
    ]
