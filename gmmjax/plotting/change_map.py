"""A map of what changed for a report: signed distances from above, the changes outlined and numbered."""

import dataclasses
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from gmmjax.changes import Changes, GivenCloud, presented
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.plotting.cloud_image import (
    CloudImageSettings,
    Page,
    cloud_picture,
    density_picture,
    is_layered,
    scan_colors,
)
from gmmjax.plotting.figures import (
    Style,
    axes_or_new,
    check_matplotlib,
    draw_scale,
    elided,
    legend_below,
    verbatim,
    with_unit,
)
from gmmjax.plotting.projection import Projection
from gmmjax.reporting.map_cells import ChangeMap, ChangeMapSettings, change_map, check_upright
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.splats import thinned
from gmmjax.reporting.summary import answer, volumes_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SQUARE = np.ones((3, 3), bool)


@dataclasses.dataclass(frozen=True)
class MapPlotSettings:
    """How a map is drawn.

    Attributes:
        grid: of the map.
        cloud: how the scan below it is drawn.
        share: of the distances in changes that the colours reach up to. 1: a single outlier makes all else pale.
        faint: opacity of the colours where nothing changed, at the end of the colours. 0: only changes have any; 1: the
            scan below is hidden by them.
        gap: cells, half the width of the gaps between the points of a change that its outline does not show. 0: sparse
            points are outlined one by one.
    """

    grid: ChangeMapSettings = ChangeMapSettings()
    cloud: CloudImageSettings = CloudImageSettings()
    share: float = 0.95
    faint: float = 0.6
    gap: int = 2


def plot_map(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    limit: float | None = None,
    ax: "Axes | None" = None,
    settings: MapPlotSettings = MapPlotSettings(),
) -> "Axes":
    """Draws a map from above, along z: where the surface rose (red) or sank (blue), and the outlines of the changes.

    The scan is grey below the colours, which fade where nothing changed. Outlines have the colour of the kind of change
    and its label; a bar shows the scale.

    Args:
        changes: what was found.
        before: the before cloud; None: that of `changes.clouds`.
        after: the after cloud, as it was given to the detection; None likewise.
        limit: distance at which the colours end, in the unit of the clouds; None: from those of the changes.
        ax: where to draw; None: a new figure.
        settings: how it is drawn.

    Returns:
        The axes; the figure has a colour bar beside them.

    Raises:
        InputError: matplotlib is not installed; clouds that are not known or are not those of the changes; scans that
            have no upward direction along z, or fill volumes.
    """
    ax = axes_or_new(ax, (8.5, 7.0))
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    clouds, changes = presented(changes, before, after)
    found = change_map(changes, clouds, settings.grid)
    limit = _limit(found, settings) if limit is None else limit
    if not limit > 0:
        raise InputError(f"limit={limit}: must be a positive length")
    norm, colormap = Normalize(-limit, limit), colormaps["RdBu_r"]
    page = _draw_scan(clouds, changes, found, ax, settings.cloud)
    ax.imshow(_colors(found, limit, colormap(norm(found.distance)), settings), extent=found.extent, zorder=2)
    _draw_outlines(changes, found, ax, settings)
    page.dress(ax, changes.unit)
    # Full coordinates: those of a survey differ in their last digits only.
    ax.ticklabel_format(useOffset=False, style="plain")
    ax.tick_params(labelsize="small")
    draw_scale(ax, page.lower, page.upper, changes.unit)
    bar = ax.figure.colorbar(ScalarMappable(norm, colormap), ax=ax, shrink=0.8, extend="both")
    verbatim(bar.ax.yaxis.label).set_text(with_unit("lower  ←  signed distance  →  higher", changes.unit))
    return ax


def map_figure(changes: Changes, clouds: Pair[PointCloud], settings: MapPlotSettings = MapPlotSettings()) -> "Figure":
    """The map with a title, the volumes and the kinds of change: what `--map-2d FILE.png` writes.

    Args:
        changes: what was found.
        clouds: as they were given to the detection.
        settings: how it is drawn.

    Raises:
        InputError: as `plot_map`.
    """
    check_matplotlib()
    check_upright(clouds.after.points)
    from matplotlib.figure import Figure

    extent = np.ptp(clouds.after.points[:, :2], axis=0)
    height = float(np.clip(8.5 * extent[1] / max(extent[0], np.finfo(float).tiny), 3.0, 11.0))
    figure = Figure(figsize=(10.5, height + 1.6), layout="compressed")
    ax = plot_map(changes, *clouds, ax=figure.subplots(), settings=settings)
    names = [elided(PurePath(cloud.source).name) if cloud.source else "" for cloud in clouds]
    title = answer(changes) if not all(names) else f"{answer(changes)}\n{names[0]} → {names[1]}"
    verbatim(ax.set_title(title, fontsize="medium"))
    if handles := _handles(changes):
        legend_below(ax, handles)
    if (text := volumes_text(changes)) is not None:
        verbatim(figure.supxlabel(text, fontsize="small"))
    return figure


def _limit(found: ChangeMap, settings: MapPlotSettings) -> float:
    """The distance that the colours reach up to: of the changes or, without any, of all."""
    known = np.isfinite(found.distance)
    changed = known & (found.label >= 0)
    values = np.abs(found.distance[changed if changed.any() else known])
    return float(np.quantile(values, settings.share)) or 1.0 if len(values) else 1.0


def _colors(
    found: ChangeMap, limit: float, colors: Float[np.ndarray, "r c 4"], settings: MapPlotSettings
) -> Float[np.ndarray, "r c 4"]:
    """The colours of the distances, which fade with them where nothing changed."""
    strength = np.clip(np.abs(found.distance) / limit, 0, 1)
    opacity = np.where(found.label >= 0, 1.0, settings.faint * strength)
    return np.dstack([colors[..., :3], np.where(np.isfinite(found.distance), opacity, 0.0)])


def _draw_scan(
    clouds: Pair[PointCloud], changes: Changes, found: ChangeMap, ax: "Axes", settings: CloudImageSettings
) -> Page:
    """The after scan from above, in grey."""
    east, north, upwards = np.eye(3)
    projection = Projection(east, north, upwards, ("x", "y"))
    points = changes.registration.apply(clouds.after.points)
    points = points[thinned(np.arange(len(points)), settings.most_points)]
    left, right, lower, upper = found.extent
    middle = float(np.median(points[:, 2]))
    page = Page.around(projection, points, np.array([[left, lower, middle], [right, upper, middle]]), settings)
    if is_layered(points, page, settings):
        page.draw(density_picture(points, page, settings), ax, 1)
    else:
        page.draw(
            cloud_picture(points, scan_colors(points, None, np.array([0.0, 0.0, 1.0]), settings), page, settings), ax, 1
        )
    return page


def _draw_outlines(changes: Changes, found: ChangeMap, ax: "Axes", settings: MapPlotSettings) -> None:
    """The outline of the cells of each change, and its label beside it."""
    left, right, lower, upper = found.extent
    half = found.cell / 2
    # A frame of nothing, so that outlines at the edge of the map are closed.
    columns = np.arange(left - half, right + found.cell, found.cell)[: found.label.shape[1] + 2]
    rows = np.arange(upper + half, lower - found.cell, -found.cell)[: found.label.shape[0] + 2]
    for label, change in enumerate(changes):
        # Without the gaps between sparse points, which would be all outline.
        own = np.pad(found.label == label, 1 + settings.gap)
        own = ndimage.binary_fill_holes(ndimage.binary_closing(own, SQUARE, iterations=settings.gap))
        own = own[settings.gap : len(own) - settings.gap, settings.gap : own.shape[1] - settings.gap].astype(float)
        if not own.any():
            continue
        color = KIND_COLORS[change.kind]
        ax.contour(columns, rows, own, [0.5], colors=["white"], linewidths=2.6, zorder=3)
        ax.contour(columns, rows, own, [0.5], colors=[color], linewidths=1.3, zorder=3)
        box: Style = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": color, "alpha": 0.85}
        places = np.argwhere(own > 0)
        above = columns[places[:, 1]].mean(), rows[places[:, 0].min()] + half
        style: Style = {"ha": "center", "va": "bottom", "fontsize": "small", "fontweight": "bold", "color": color}
        ax.annotate(str(label), above, xytext=(0, 3), textcoords="offset points", bbox=box, zorder=6, **style)


def _handles(changes: Changes) -> list[Any]:
    """The kinds that there are, for the legend."""
    from matplotlib.lines import Line2D

    kinds = {change.kind for change in changes}
    return [
        Line2D([], [], color=color, linewidth=1.6, label=kind) for kind, color in KIND_COLORS.items() if kind in kinds
    ]
