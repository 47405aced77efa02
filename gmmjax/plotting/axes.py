"""The axes that plots are drawn into, their colours, and text that matplotlib takes as it is."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from gmmjax.reporting.quantities import rounded_down

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

# Okabe and Ito's colours, without the black of the ellipses and the yellow that paper swallows.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
MARKERS = ("o", "s", "^", "D", "v", "P")
INK = "#1b1f24"
Style = dict[str, Any]
"""Keyword arguments of matplotlib."""


def axes_or_new(ax: "Axes | None", size: tuple[float, float]) -> "Axes":
    """The axes that were given, or those of a new figure of pyplot, which notebooks show by themselves.

    Args:
        ax: of the user.
        size: of a new figure, inches.
    """
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="compressed")[1]


def verbatim(text: "Text") -> "Text":
    """The text without any markup: a file's name with dollar signs or backslashes is no formula."""
    text.set_parse_math(False)
    text.set_usetex(False)
    return text


def elided(name: str, longest: int = 44) -> str:
    """A name with its middle left out where it is too long for a title."""
    if len(name) <= longest:
        return name
    half = (longest - 1) // 2
    return f"{name[:half]}…{name[-half:]}"


def with_unit(text: str, unit: str | None) -> str:
    """The label of an axis."""
    return f"{text} ({unit})" if unit else text


def light_frame(ax: "Axes", **grid: Any) -> None:
    """A frame without its upper and right side, and a pale grid behind the data."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_axisbelow(True)
    ax.grid(color="0.9", linewidth=0.8, **grid)


def legend_inside(ax: "Axes", **place: Any) -> None:
    """A legend whose entries are no formulas."""
    for text in ax.legend(fontsize="small", **place).get_texts():
        verbatim(text)


def legend_below(ax: "Axes", handles: Sequence[Any]) -> None:
    """A legend in one row under the axes and their labels, where it hides nothing."""
    from matplotlib.transforms import ScaledTranslation

    points = 40 if ax.get_xlabel() else 6
    below = ScaledTranslation(0, -points / 72, ax.figure.dpi_scale_trans)
    place: Style = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": ax.transAxes + below}
    ax.legend(handles=handles, ncols=len(handles), fontsize="small", frameon=False, borderaxespad=0, **place)


def distance_bar(ax: "Axes", limit: float, label: str) -> tuple[Any, Any]:
    """Draw a colour bar of signed distances, blue below and red above, beside the axes.

    Args:
        ax: that the distances are drawn into.
        limit: distance at which the colours end.
        label: of the bar.

    Returns:
        The norm and the colour map.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    norm, colormap = Normalize(-limit, limit), colormaps["RdBu_r"]
    bar = ax.figure.colorbar(ScalarMappable(norm, colormap), ax=ax, shrink=0.8, extend="both")
    verbatim(bar.ax.yaxis.label).set_text(label)
    return norm, colormap


def draw_label(ax: "Axes", text: str, above: tuple[float, float], color: str, edge: str = "none") -> None:
    """The label of a change, above a place."""
    box: Style = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": edge, "alpha": 0.8}
    style: Style = {"ha": "center", "va": "bottom", "fontsize": "small", "fontweight": "bold", "color": color}
    ax.annotate(text, above, xytext=(0, 3), textcoords="offset points", bbox=box, zorder=6, **style)


def draw_scale(ax: "Axes", lower: Float[np.ndarray, "2"], upper: Float[np.ndarray, "2"], unit: str | None) -> None:
    """A bar of 1, 2 or 5 times a power of ten, at most a quarter of the picture, in its lower left corner.

    Args:
        ax: where to draw.
        lower: left and lower edge of the picture.
        upper: right and upper edge.
        unit: of lengths; None: not known.
    """
    width, height = upper - lower
    length = rounded_down(width / 4)
    left, bottom = lower + np.array([0.02 * width, 0.03 * height])
    ax.plot([left, left + length], [bottom, bottom], color="0.1", linewidth=2.5, solid_capstyle="butt", zorder=5)
    style: Style = {"ha": "center", "fontsize": "small", "zorder": 5, "textcoords": "offset points"}
    box: Style = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.6}
    text = f"{length:g}{f' {unit}' if unit else ''}"
    verbatim(ax.annotate(text, (left + length / 2, bottom), xytext=(0, 4), bbox=box, **style))
