"""Plots of what changed: both clouds, the changes from several directions, the signed distance."""

import dataclasses
from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float, Int, UInt8

from gmmjax.changes import Changes, GivenCloud, presented
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError, check_choice
from gmmjax.pair import Pair
from gmmjax.plotting.axes import (
    Style,
    axes_or_new,
    distance_bar,
    draw_label,
    elided,
    legend_below,
    verbatim,
    with_unit,
)
from gmmjax.plotting.cloud_image import (
    MAX_POINTS,
    PIXELS,
    Page,
    cloud_picture,
    flat_colors,
    marked_picture,
    scan_colors,
)
from gmmjax.plotting.projection import Direction, Projection
from gmmjax.reporting.palette import KIND_COLORS, UNCHANGED_COLOR
from gmmjax.reporting.splats import thinned
from gmmjax.reporting.summary import answer, object_labels, point_counts, registration_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Shown = Literal["before", "after", "changes"]
SHOWN: tuple[Shown, ...] = ("before", "after", "changes")
# Opacity of what is unchanged where both clouds are drawn: at 1 the changes stand out less.
PALE = 0.6


def plot_changes(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    show: Shown = "changes",
    direction: Direction = "above",
    ax: "Axes | None" = None,
    legend: bool = True,
    pixels: int = PIXELS,
) -> "Axes":
    """Draw a scan with its changes, or both with all changes: changed points in the colour of their kind.

    The projection is parallel, with equal axes in the unit of the clouds and in the frame of the before cloud. Changed
    points have a white outline and are drawn over everything else, so that walls hide none. The boxes have the labels
    of the changes; where both clouds are drawn, an arrow shows how an object moved.

    Args:
        changes: what was found.
        before: the before cloud; None: that of `changes.clouds`.
        after: the after cloud, as it was given to the detection; None likewise.
        show: "before" or "after", one cloud and its own changes; "changes": both, pale, with all changes.
        direction: "above", "front", "side", or "oblique" as the report looks at first.
        ax: where to draw; None: a new figure.
        legend: whether the kinds are explained.
        pixels: of the longer edge of the picture.

    Raises:
        InputError: clouds that are not known or are not those of the changes; an unknown direction.
    """
    check_choice("show", show, SHOWN)
    ax = axes_or_new(ax, (7.0, 6.0))
    clouds, changes = presented(changes, before, after)
    clouds = _registered(clouds, changes)
    page = _page(direction, clouds, changes, pixels)
    _draw_clouds(clouds, changes, show, page, ax)
    labels = _shown_labels(changes, show)
    _draw_boxes(changes, labels, page.projection, ax)
    if show == "changes":
        _draw_motions(changes, page.projection, ax)
    page.dress(ax, changes.unit)
    if legend:
        legend_below(ax, _handles(changes, labels))
    return ax


def plot_overview(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    axes: Any = None,
    pixels: int = PIXELS,
) -> Any:
    """Draw both scans, and the changes from above and from the side, with title, legend and scale.

    Args:
        changes: what was found.
        before: as of `plot_changes`.
        after: as of `plot_changes`.
        axes: four axes; None: those of a new figure, which gets a title and a legend.
        pixels: of the longer edge of each picture.

    Returns:
        The axes [2, 2].

    Raises:
        InputError: as `plot_changes`; other than four axes.
    """
    if axes is None:
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(11, 9), layout="compressed")
        return draw_overview(figure, changes, before, after, pixels=pixels)
    axes = np.asarray(axes)
    if axes.size != 4:
        raise InputError(f"axes: must be four axes, not {axes.size}; leave them out for a new figure")
    shown = presented(changes, before, after)
    _draw_overview(shown.changes, shown.clouds, axes.ravel().tolist(), pixels)
    return axes.reshape(2, 2)


def draw_overview(
    figure: "Figure",
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    pixels: int = PIXELS,
) -> Any:
    """Draw `plot_overview` into a figure with a compressed layout: also one that pyplot knows nothing of."""
    clouds, changes = presented(changes, before, after)
    axes = figure.subplots(2, 2)
    _draw_overview(changes, clouds, axes.ravel().tolist(), pixels)
    names = [_name(cloud, f"the {side} cloud") for side, cloud in zip(("before", "after"), clouds, strict=True)]
    verbatim(figure.suptitle(f"{answer(changes)}\n{' → '.join(names)}", fontsize="large"))
    handles = _handles(changes, range(len(changes)))
    legend = figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    legend.set_title(registration_text(changes) or "")
    verbatim(legend.get_title()).set(color="0.35", size="small")
    fit_height(figure, axes)
    return axes


def fit_height(figure: Any, axes: Any) -> None:
    """Give a figure with pictures the height that they need: corridors are wide, towers are high."""
    shapes = [[np.ptp(ax.get_ylim()) / np.ptp(ax.get_xlim()) for ax in row] for row in axes]
    heights = [float(np.clip(max(row), 0.25, 1.3)) for row in shapes]
    axes[0, 0].get_gridspec().set_height_ratios(heights)
    width = figure.get_size_inches()[0]
    figure.set_size_inches(width, 0.9 * width / len(axes[0]) * sum(heights) + 1.0 + 0.45 * len(axes))


def plot_distance(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    direction: Direction = "above",
    limit: float | None = None,
    ax: "Axes | None" = None,
    pixels: int = PIXELS,
) -> "Axes":
    """Draw the after scan coloured by its signed distance from the surface of the before scan.

    Blue lies below the before surface and red above it, on the sides that the normals tell; grey has nothing to be
    compared with.

    Args:
        changes: what was found, with `distance_after`.
        before: as of `plot_changes`.
        after: as of `plot_changes`.
        direction: as of `plot_changes`.
        limit: distance at which the colours end, in the unit of the clouds; None: that of 98 % of the points.
        ax: where to draw; None: a new figure.
        pixels: of the longer edge of the picture.

    Returns:
        The axes; the figure has a colour bar beside them.

    Raises:
        InputError: as `plot_changes`; distances that were not measured.
    """
    clouds, changes = presented(changes, before, after)
    distance = changes.distance_after
    if distance is None or not np.isfinite(distance).any():
        raise InputError("changes: have no signed distances, which only scans of surfaces have, by method='joint'")
    ax = axes_or_new(ax, (7.5, 6.0))
    known = np.isfinite(distance)
    if limit is None:
        limit = float(np.quantile(np.abs(distance[known]), 0.98)) or 1.0
    norm, colormap = distance_bar(ax, limit, with_unit("signed distance", changes.unit))
    colors = np.tile(np.array(UNCHANGED_COLOR, np.uint8), (len(distance), 1))
    colors[known] = colormap(norm(distance[known]), bytes=True)[:, :3]
    clouds = _registered(clouds, changes)
    page = _page(direction, clouds, changes, pixels)
    page.draw(cloud_picture(clouds.after.points, colors, page), ax, 1)
    page.dress(ax, changes.unit)
    return ax


def _registered(clouds: Pair[PointCloud], changes: Changes) -> Pair[PointCloud]:
    after = dataclasses.replace(clouds.after, points=changes.registration.apply(clouds.after.points), views=None)
    return Pair(clouds.before, after)


def _page(direction: Direction, clouds: Pair[PointCloud], changes: Changes, pixels: int) -> Page:
    points = np.concatenate([cloud.points for cloud in clouds])
    corners = np.concatenate([np.empty((0, 3)), *(change.box.corners() for change in changes)])
    return Page.around(Projection.of(direction, clouds.after.points), points, corners, pixels)


def _draw_overview(changes: Changes, clouds: Pair[PointCloud], axes: Sequence[Any], pixels: int) -> None:
    counts = point_counts(changes, clouds)
    pictures: tuple[tuple[Shown, Direction, str], ...] = (
        ("before", "oblique", f"Before: {counts.before:,} points"),
        ("after", "oblique", f"After: {counts.after:,} points"),
        ("changes", "above", "Changes from above"),
        ("changes", _widest_side(clouds), "Changes from the side"),
    )
    for ax, (show, direction, title) in zip(axes, pictures, strict=True):
        plot_changes(changes, *clouds, show=show, direction=direction, ax=ax, legend=False, pixels=pixels)
        ax.set_title(title, fontsize="medium")


def _draw_clouds(clouds: Pair[PointCloud], changes: Changes, show: Shown, page: Page, ax: "Axes") -> None:
    """Draw what is unchanged below, what is changed over it."""
    sides = zip(("before", "after"), clouds, Pair(changes.labels_before, changes.labels_after), strict=True)
    drawn = [(cloud, labels) for name, cloud, labels in sides if show in (name, "changes")]
    up = Projection.of("front", clouds.after.points).up
    points, colors = map(np.concatenate, zip(*(_unchanged(*side, up) for side in drawn), strict=True))
    page.draw_scan(points, colors, ax, PALE if show == "changes" else 1.0)
    kinds = list(KIND_COLORS)
    of_changes = np.array([kinds.index(change.kind) for change in changes], int)
    changed = [thinned(np.flatnonzero(labels >= 0), MAX_POINTS) for _, labels in drawn]
    marked = np.concatenate([cloud.points[rows] for (cloud, _), rows in zip(drawn, changed, strict=True)])
    labels = np.concatenate([labels[rows] for (_, labels), rows in zip(drawn, changed, strict=True)])
    flat = flat_colors(list(KIND_COLORS.values()), of_changes[labels])
    page.draw(marked_picture(marked, flat, page, others=len(points)), ax, 2)


def _unchanged(
    cloud: PointCloud, labels: Int[np.ndarray, " n"], up: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "m 3"], UInt8[np.ndarray, "m 3"]]:
    """Return the points that are drawn, with their colours."""
    rows = thinned(np.flatnonzero(labels < 0), MAX_POINTS)
    points = cloud.points[rows]
    return points, scan_colors(points, None if cloud.colors is None else cloud.colors[rows], up)


def _shown_labels(changes: Changes, show: Shown) -> list[int]:
    """List the changes that have points in the clouds that are shown."""
    sides = {"before": changes.labels_before, "after": changes.labels_after}
    if show == "changes":
        return list(range(len(changes)))
    return [int(label) for label in np.unique(sides[show]) if label >= 0]


def _draw_boxes(changes: Changes, labels: Sequence[int], projection: Projection, ax: "Axes") -> None:
    """Draw the edges of the boxes, and the labels above them."""
    from matplotlib.collections import LineCollection

    for label in labels:
        color, corners = KIND_COLORS[changes[label].kind], projection.on_page(changes[label].box.corners())
        # The numbers of corners that an edge joins differ in one bit.
        edges = [corners[[start, start | bit]] for start in range(8) for bit in (1, 2, 4) if not start & bit]
        ax.add_collection(LineCollection(edges, colors=color, linewidths=0.8, alpha=0.8, zorder=3), autolim=False)
        draw_label(ax, str(label), (corners[:, 0].mean(), corners[:, 1].max()), color)


def _draw_motions(changes: Changes, projection: Projection, ax: "Axes") -> None:
    """Draw an arrow from where a moved object was to where it is."""
    for labels in object_labels(changes):
        if len(labels) == 2:
            start, end = (projection.on_page(changes[label].box.centre) for label in labels)
            style: Style = {"arrowstyle": "-|>", "color": KIND_COLORS["moved"], "linewidth": 1.6}
            ax.annotate("", tuple(end), tuple(start), arrowprops={**style, "shrinkA": 0, "shrinkB": 0}, zorder=4)


def _handles(changes: Changes, labels: Sequence[int]) -> list[Any]:
    from matplotlib.patches import Patch

    kinds = {changes[label].kind for label in labels}
    grey = "#" + bytes(UNCHANGED_COLOR).hex()
    patches = [Patch(color=color, label=kind) for kind, color in KIND_COLORS.items() if kind in kinds]
    return [*patches, Patch(color=grey, label="unchanged")]


def _widest_side(clouds: Pair[PointCloud]) -> Direction:
    """Return the one of the two level directions in which more of the scan is seen."""
    points = clouds.after.points
    pages = [Projection.of(direction, points).on_page(points)[:, 0] for direction in ("front", "side")]
    front, side = (np.ptp(np.quantile(page, [0.01, 0.99])) for page in pages)
    return "front" if front >= side else "side"


def _name(cloud: PointCloud, missing: str) -> str:
    return elided(PurePath(cloud.source).name) if cloud.source else missing
