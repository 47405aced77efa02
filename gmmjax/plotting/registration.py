"""The plot of a registration: how far the surfaces of both scans are apart without and with it."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from gmmjax.changes import Changes, GivenCloud, presented
from gmmjax.errors import InputError
from gmmjax.geometry import LocalSurface
from gmmjax.plotting.figures import axes_or_new, light_frame, verbatim, with_unit
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.splats import thinned
from gmmjax.reporting.summary import length_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclasses.dataclass(frozen=True)
class RegistrationPlotSettings:
    """What the plot of a registration is made of.

    Attributes:
        surface_points: of the before scan, through which planes are laid, at most; with fewer, edges are rounded off.
        points: of the after scan whose offsets are counted, at most.
        bins: of the histogram.
        shown: share of the points within its right end; at 1 a stray point makes all else one bar.
    """

    surface_points: int = 60_000
    points: int = 15_000
    bins: int = 60
    shown: float = 0.97


def plot_registration(
    changes: Changes,
    before: GivenCloud | None = None,
    after: GivenCloud | None = None,
    *,
    ax: "Axes | None" = None,
    settings: RegistrationPlotSettings = RegistrationPlotSettings(),
) -> "Axes":
    """Draws how far the unchanged points of the after scan are from the surface of the before scan.

    The distance is that from the plane through the nearest points of the before scan, along its normal: once for the
    scan as it was given, and once registered. Dashed lines are the residuals that the detection measured.

    Args:
        changes: what was found.
        before: the before cloud; None: that of `changes.clouds`.
        after: the after cloud, as it was given to the detection; None likewise.
        ax: where to draw; None: a new figure.
        settings: what the histogram is made of.

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; clouds that are not known or are not those of the changes; no point is
            unchanged.
    """
    ax = axes_or_new(ax, (7.0, 4.5))
    clouds, changes = presented(changes, before, after)
    rows = thinned(np.flatnonzero(changes.labels_after < 0), settings.points)
    if not len(rows):
        raise InputError("changes: every point of the after cloud changed, so that no surface can be compared")
    surface_rows = thinned(np.arange(len(clouds.before)), settings.surface_points)
    surface, points = LocalSurface.of(clouds.before.points[surface_rows]), clouds.after.points[rows]
    registration, unit = changes.registration, changes.unit
    drawn = [("as given", _offsets(surface, points), registration.residual_before, KIND_COLORS["disappeared"])]
    if registration.applied:
        offsets = _offsets(surface, registration.apply(points))
        drawn.append(("registered", offsets, registration.residual, KIND_COLORS["moved"]))
    end = max(float(np.quantile(offsets, settings.shown)) for _, offsets, *_ in drawn)
    bins = np.linspace(0, end or 1.0, settings.bins + 1)
    edges = bins.tolist()
    for name, offsets, residual, color in drawn:
        median = length_text(float(np.median(offsets)), unit)
        ax.hist(offsets, bins=edges, color=color, alpha=0.25)
        ax.hist(offsets, bins=edges, color=color, histtype="step", linewidth=1.4, label=f"{name}, median {median}")
        if residual is not None and residual <= bins[-1]:
            ax.axvline(residual, color=color, linestyle="--", linewidth=1.2)
    light_frame(ax)
    ax.set_xlim(0, bins[-1])
    verbatim(ax.xaxis.label).set_text(with_unit("distance from the surface of the before scan", unit))
    ax.set_ylabel("points")
    for text in ax.legend(fontsize="small").get_texts():
        verbatim(text)
    return ax


def _offsets(surface: LocalSurface, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    there = surface.nearest(points)
    offsets = ((points - surface.centres[there]) * surface.normals[there]).sum(axis=1)
    return np.abs(offsets)
