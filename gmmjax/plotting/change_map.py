"""A map of what changed for a report: signed distances from above, the changes outlined and numbered."""

from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from gmmjax.changes import Changes, GivenCloud, presented
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.plotting.axes import (
    axes_or_new,
    distance_bar,
    draw_label,
    draw_scale,
    elided,
    legend_below,
    verbatim,
    with_unit,
)
from gmmjax.plotting.cloud_image import MAX_POINTS, PIXELS, Page, scan_colors
from gmmjax.plotting.projection import Projection
from gmmjax.reporting.map_cells import ChangeMap, change_map
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.splats import thinned
from gmmjax.reporting.summary import answer, volumes_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Share of the distances in changes that the colours reach up to: at 1 a single outlier makes all else pale.
SHOWN = 0.95
# Opacity of the colours where nothing changed, at their end: at 1 the scan below is hidden by them.
FAINT = 0.6
# Cells, half the width of the gaps between sparse points of a change that its outline does not show.
GAP = 2


def plot_map(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    limit: float | None = None,
    ax: "Axes | None" = None,
    cell: float | None = None,
    pixels: int = PIXELS,
) -> "Axes":
    """Draw a map from above, along z: where the surface rose (red) or sank (blue), and the outlines of the changes.

    The scan is grey below the colours, which fade where nothing changed. Outlines have the colour of the kind of change
    and its label; a bar shows the scale.

    Args:
        changes: what was found.
        before: the before cloud; None: that of `changes.clouds`.
        after: the after cloud, as it was given to the detection; None likewise.
        limit: distance at which the colours end, in the unit of the clouds; None: from those of the changes.
        ax: where to draw; None: a new figure.
        cell: edge of a cell, in the unit of the clouds; None: from the spacing of the points.
        pixels: of the longer edge of the picture of the scan.

    Returns:
        The axes; the figure has a colour bar beside them.

    Raises:
        InputError: clouds that are not known or are not those of the changes; scans that have no upward direction along
            z, or fill volumes.
    """
    clouds, changes = presented(changes, before, after)
    found = change_map(changes, clouds, cell)
    limit = _limit(found) if limit is None else limit
    if not limit > 0:
        raise InputError(f"limit={limit}: must be a positive length")
    ax = axes_or_new(ax, (8.5, 7.0))
    norm, colormap = distance_bar(ax, limit, with_unit("lower  ←  signed distance  →  higher", changes.unit))
    page = _draw_scan(clouds.after, changes, found, ax, pixels)
    ax.imshow(_colors(found, limit, colormap(norm(found.distance))), extent=found.extent, zorder=2)
    _draw_outlines(changes, found, ax)
    page.dress(ax, changes.unit)
    # Full coordinates: those of a survey differ in their last digits only.
    ax.ticklabel_format(useOffset=False, style="plain")
    ax.tick_params(labelsize="small")
    draw_scale(ax, page.lower, page.upper, changes.unit)
    return ax


def map_figure(changes: Changes, clouds: Pair[PointCloud], cell: float | None = None, pixels: int = PIXELS) -> "Figure":
    """Draw the map with a title, the volumes and the kinds of change: what `--map-2d FILE.png` writes.

    Args:
        changes: what was found.
        clouds: as they were given to the detection.
        cell: as of `plot_map`.
        pixels: as of `plot_map`.

    Raises:
        InputError: as `plot_map`.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    extent = np.ptp(clouds.after.points[:, :2], axis=0)
    height = float(np.clip(8.5 * extent[1] / max(extent[0], np.finfo(float).tiny), 3.0, 11.0))
    figure = Figure(figsize=(10.5, height + 1.6), layout="compressed")
    ax = plot_map(changes, *clouds, ax=figure.subplots(), cell=cell, pixels=pixels)
    names = [elided(PurePath(cloud.source).name) if cloud.source else "" for cloud in clouds]
    title = answer(changes) if not all(names) else f"{answer(changes)}\n{names[0]} → {names[1]}"
    verbatim(ax.set_title(title, fontsize="medium"))
    kinds = {change.kind for change in changes}
    colors = {kind: color for kind, color in KIND_COLORS.items() if kind in kinds}
    if colors:
        legend_below(ax, [Line2D([], [], color=color, linewidth=1.6, label=kind) for kind, color in colors.items()])
    if (text := volumes_text(changes)) is not None:
        verbatim(figure.supxlabel(text, fontsize="small"))
    return figure


def _limit(found: ChangeMap) -> float:
    """Return the distance that the colours reach up to: of the changes or, without any, of all."""
    known = np.isfinite(found.distance)
    changed = known & (found.label >= 0)
    values = np.abs(found.distance[changed if changed.any() else known])
    return float(np.quantile(values, SHOWN)) or 1.0 if len(values) else 1.0


def _colors(found: ChangeMap, limit: float, colors: Float[np.ndarray, "r c 4"]) -> Float[np.ndarray, "r c 4"]:
    """Return the colours of the distances, which fade with them where nothing changed."""
    strength = np.clip(np.abs(found.distance) / limit, 0, 1)
    opacity = np.where(found.label >= 0, 1.0, FAINT * strength)
    return np.dstack([colors[..., :3], np.where(np.isfinite(found.distance), opacity, 0.0)])


def _draw_scan(cloud: PointCloud, changes: Changes, found: ChangeMap, ax: "Axes", pixels: int) -> Page:
    """Draw the after scan from above, in grey."""
    east, north, up = np.eye(3)
    points = changes.registration.apply(cloud.points)
    points = points[thinned(np.arange(len(points)), MAX_POINTS)]
    left, right, lower, upper = found.extent
    middle = float(np.median(points[:, 2]))
    corners = np.array([[left, lower, middle], [right, upper, middle]])
    page = Page.around(Projection(east, north, up, ("x", "y")), points, corners, pixels)
    page.draw_scan(points, scan_colors(points, None, up), ax)
    return page


def _draw_outlines(changes: Changes, found: ChangeMap, ax: "Axes") -> None:
    """Draw the outline of the cells of each change, and its label beside it."""
    left, right, lower, upper = found.extent
    half = found.cell / 2
    # A frame of nothing, so that outlines at the edge of the map are closed.
    columns = np.arange(left - half, right + found.cell, found.cell)[: found.label.shape[1] + 2]
    rows = np.arange(upper + half, lower - found.cell, -found.cell)[: found.label.shape[0] + 2]
    for label, change in enumerate(changes):
        # Without the gaps between sparse points, which would be all outline.
        own = np.pad(found.label == label, 1 + GAP)
        own = ndimage.binary_fill_holes(ndimage.binary_closing(own, np.ones((3, 3), bool), iterations=GAP))
        own = own[GAP:-GAP, GAP:-GAP].astype(float)
        if not own.any():
            continue
        color = KIND_COLORS[change.kind]
        ax.contour(columns, rows, own, [0.5], colors=["white"], linewidths=2.6, zorder=3)
        ax.contour(columns, rows, own, [0.5], colors=[color], linewidths=1.3, zorder=3)
        places = np.argwhere(own > 0)
        above = columns[places[:, 1]].mean(), rows[places[:, 0].min()] + half
        draw_label(ax, str(label), above, color, edge=color)
