"""Whether sensor views can belong to a cloud at all: each of its points was observed from one of them."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64

from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError, warn
from gmmjax.geometry import DepthImage, frustums


@dataclasses.dataclass(frozen=True)
class ViewCheckSettings:
    """From when on views contradict their cloud.

    Attributes:
        max_outside: fraction of the points outside of all views, at most: noise, or poses that were left out (with
            three quarters of them left out 4 to 5 %). 1: views of another survey are used.
        max_occluded: fraction of the points in the views that are occluded in all of them, at most; where it is more,
            `max_hidden` decides. Measured: 1 % in surveys of many frames, 2 to 7 % in single frames, at the edges of
            occluding objects, 10 to 40 % in a scanner's single scan, and 16 to 38 % in a survey moved sideways by half
            its width. 1: such a survey is used.
        occlusion_depth: a point is occluded when something lies this many spacings in front of it; nearer, it is the
            same slanted surface. 0: most of a slanted surface is occluded by itself.
        max_hidden: fraction of the points that are covered together with their neighbours, by what is neither near the
            sensor nor seen at a grazing angle, at most, of a single view; of n views it is divided by the root of n,
            since what one of them misses another one sees. With it and the next one none of 280 surveys is refused with
            its own views, and three quarters of those with views off by half their width are. 1: views of
            another place are used; 0: one point that is covered is enough to refuse all views.
        max_hidden_sighted: the same where the scan's own lines of sight are looked at, which fill no gaps. 1 and 0:
            likewise.
        covered_bins: a point is covered where, of the nine bins of an image around its direction, so many show
            something in front of it. 1: what is seen past the edges of racks and through their gaps is, as bins are
            wider than what they show; 9: fewer views of another place are found.
        nearest_range: what is nearer than this fraction of the upper quartile of the ranges in a view occludes nothing
            in that test: the stand of a scanner, which turns beside the axis that the view is given for. 0: the stand
            contradicts its own view; towards 1: nothing contradicts a view.
        min_incidence: cosine between the ray and the normal of a surface that occludes in that test, at least. 0:
            surfaces at a grazing angle occlude, which noise displaces across the ray; 1: nothing does.
        hidden_neighbours: fraction of a point's neighbours that are occluded with it in that test, at least. 0: single
            points at the edges of surfaces count; 1: only what is far from all that is visible.
    """

    max_outside: float = 0.08
    max_occluded: float = 0.15
    occlusion_depth: float = 8.0
    max_hidden: float = 0.035
    max_hidden_sighted: float = 0.015
    covered_bins: int = 8
    nearest_range: float = 0.3
    min_incidence: float = 0.2
    hidden_neighbours: float = 0.5


def usable_views(
    name: str,
    survey: ScanVisibility,
    settings: ViewCheckSettings = ViewCheckSettings(),
    points: Float64[np.ndarray, "n 3"] | None = None,
    *,
    quiet: bool = False,
) -> ScanVisibility:
    """The survey, without its views where they contradict the cloud.

    Args:
        name: the argument that the views came in, for the message.
        survey: a cloud of at least one point.
        settings: from when on they do.
        points: as of `check_views`.
        quiet: whether they are left out without a warning: nobody has given them.

    Raises:
        InputError: the views see none of the points.

    Warns:
        InputWarning: the views contradict the cloud.
    """
    contradiction = None if survey.views is None else check_views(name, survey, settings, points)
    if contradiction is None:
        return survey
    if not quiet:
        warn(contradiction)
    return survey.without_views()


def check_views(
    name: str,
    survey: ScanVisibility,
    settings: ViewCheckSettings = ViewCheckSettings(),
    points: Float64[np.ndarray, "n 3"] | None = None,
) -> str | None:
    """Whether a cloud can have been taken from its views.

    Args:
        name: the argument that the views came in, for the message.
        survey: a cloud of at least one point, with views.
        settings: from when on views contradict their cloud.
        points: of the scan, where the survey has its voxels: a voxel near the sensor fills the gaps that it saw
            through, and what seems to be hidden by many is looked at by the scan's own lines of sight. None: the survey
            has all of its points.

    Returns:
        None when all is well, else why the views contradict the cloud and what to do: they must not be used then.

    Raises:
        InputError: the views see none of the points.
    """
    views, own = survey.views, survey.points
    assert views is not None
    in_range, inside, visible = (np.zeros(len(own), bool) for _ in range(3))
    for view in range(len(views)):
        places = views.in_camera(own, view)
        in_range |= (places**2).sum(axis=1) <= views.max_range**2
        in_view = views.in_field_of_view(places)
        inside |= in_view
        if not visible[in_view].all():
            visible |= in_view & _unoccluded(places, survey, view, settings)
    if not inside.any():
        raise InputError(
            f"{name}: none of the {len(views)} view(s) sees any of the {len(own)} points of its cloud; poses are "
            "camera to world (x right, y down, z forward) in the cloud's frame and unit, the field of view in degrees"
        )
    occluded = 1 - float(visible[inside].mean())
    if occluded > settings.max_occluded:
        if points is not None and len(points) > len(own):
            survey = survey.with_line_of_sight(points)
        if not _hidden_by_much(survey, inside & ~visible, settings):
            occluded = 0.0
    return _contradiction(name, views, in_range.mean(), inside.mean(), occluded, settings)


def _contradiction(
    name: str, views: SensorViews, in_range: float, inside: float, occluded: float, settings: ViewCheckSettings
) -> str | None:
    """Why the views contradict the cloud, by the fractions of its points in range, in a view, and occluded there."""
    remedy = "free space is not used as evidence; check the poses (camera to world), the frame and the unit"
    if in_range < 1 - settings.max_outside:
        return (
            f"{name}: {1 - in_range:.0%} of the cloud's points are further than max_range={views.max_range:.4g} from "
            f"every view; {remedy}"
        )
    if inside < 1 - settings.max_outside:
        return f"{name}: {1 - inside:.0%} of the cloud's points are behind or beside every view; {remedy}"
    if occluded > settings.max_occluded:
        return f"{name}: {occluded:.0%} of the cloud's points are hidden by others from every view; {remedy}"
    return None


def _unoccluded(
    places: Float64[np.ndarray, "n 3"], survey: ScanVisibility, view: int, settings: ViewCheckSettings
) -> Bool[np.ndarray, " n"]:
    """Which points of a survey, in the coordinates of one view, nothing in the view's images occludes."""
    visible = np.zeros(len(places), bool)
    for frustum, image in survey.images(view):
        inside, directions, ranges = frustum.project(places)
        in_front = image.nearest(directions).range
        visible[inside] = in_front > ranges - settings.occlusion_depth * survey.spacing[inside]
    return visible


def _hidden_by_much(survey: ScanVisibility, occluded: Bool[np.ndarray, " n"], settings: ViewCheckSettings) -> bool:
    """Whether too many points are covered in all views that they are in, together with their neighbours.

    Args:
        survey: a cloud with views; without lines of sight of its scan its own points cover each other.
        occluded: its points that are in a view, and occluded in all of these.
        settings: what occludes, and how much of the cloud may be.
    """
    assert survey.views is not None
    shown = survey.sighted or survey
    most = settings.max_hidden if survey.sighted is None else settings.max_hidden_sighted
    hidden, margin = occluded.copy(), settings.occlusion_depth * survey.spacing
    for view in range(len(survey.views)):
        places = survey.views.in_camera(survey.points, view)
        visible = survey.views.in_field_of_view(places)
        if visible.any():
            hidden &= ~(visible & ~_covered(places, margin, shown, view, settings))
    together = hidden & (hidden[survey.surface.neighbours].mean(axis=1) >= settings.hidden_neighbours)
    return bool(together.mean() > most / len(survey.views) ** 0.5)


def _covered(
    places: Float64[np.ndarray, "n 3"],
    margin: Float64[np.ndarray, " n"],
    shown: ScanVisibility,
    view: int,
    settings: ViewCheckSettings,
) -> Bool[np.ndarray, " n"]:
    """Which places, in the coordinates of one view, are behind a surface by a margin, and not beside its edge.

    Neither the nearest points in the view nor surfaces at a grazing angle are such a surface.
    """
    assert shown.views is not None
    covered, images = np.zeros(len(places), bool), shown.settings.images
    points = shown.views.in_camera(shown.points[shown.occluders], view)
    in_view, ranges = shown.views.in_field_of_view(points), np.linalg.norm(points, axis=1)
    if not in_view.any():
        return covered
    normals = shown.surface.normals[shown.occluders] @ shown.views.poses[view, :3, :3]
    facing = np.abs((normals * points).sum(axis=1)) > settings.min_incidence * ranges
    nearest = settings.nearest_range * np.quantile(ranges[in_view], 0.75)
    covering, spacing = facing & (ranges > nearest), shown.spacing_in(view)
    # The last one is that of a bin that shows nothing.
    in_bins = np.append(ranges[covering], np.inf)
    behind = np.linalg.norm(places, axis=1) - margin
    for frustum in frustums(shown.views.field_of_view, images):
        image = DepthImage.of(points[covering], spacing[covering], frustum, images)
        inside, directions, _ = frustum.project(places)
        in_front = in_bins[image.around(directions)] < behind[inside, None, None]
        covered[inside] = (in_front.sum(axis=2) >= settings.covered_bins).any(axis=1)
    return covered
