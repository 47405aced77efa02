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
    """Return the axes of the user, or those of a new figure of pyplot, inches, which notebooks show by themselves."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="compressed")[1]


def verbatim(text: "Text") -> "Text":
    """Return the text without any markup: a file's name with dollar signs or backslashes is no formula."""
    text.set_parse_math(False)
    text.set_usetex(False)
    return text


def elided(name: str, longest: int = 44) -> str:
    """Leave out the middle of a name that is too long for a title."""
    if len(name) <= longest:
        return name
    half = (longest - 1) // 2
    return f"{name[:half]}…{name[-half:]}"


def with_unit(text: str, unit: str | None) -> str:
    """Label an axis."""
    return f"{text} ({unit})" if unit else text


def light_frame(ax: "Axes", **grid: Any) -> None:
    """Draw a frame without its upper and right side, and a pale grid behind the data."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_axisbelow(True)
    ax.grid(color="0.9", linewidth=0.8, **grid)


def legend_inside(ax: "Axes", **place: Any) -> None:
    """Draw a legend whose entries are no formulas."""
    for text in ax.legend(fontsize="small", **place).get_texts():
        verbatim(text)


def legend_below(ax: "Axes", handles: Sequence[Any]) -> None:
    """Draw a legend in one row under the axes and their labels, where it hides nothing."""
    from matplotlib.transforms import ScaledTranslation

    points = 40 if ax.get_xlabel() else 6
    below = ScaledTranslation(0, -points / 72, ax.figure.dpi_scale_trans)
    place: Style = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": ax.transAxes + below}
    ax.legend(handles=handles, ncols=len(handles), fontsize="small", frameon=False, borderaxespad=0, **place)


def distance_bar(ax: "Axes", limit: float, label: str) -> tuple[Any, Any]:
    """Draw a colour bar of signed distances up to a limit, blue below and red above; return norm and colour map."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    norm, colormap = Normalize(-limit, limit), colormaps["RdBu_r"]
    bar = ax.figure.colorbar(ScalarMappable(norm, colormap), ax=ax, shrink=0.8, extend="both")
    verbatim(bar.ax.yaxis.label).set_text(label)
    return norm, colormap


def draw_label(ax: "Axes", text: str, above: tuple[float, float], color: str, edge: str = "none") -> None:
    """Draw the label of a change above a place."""
    box: Style = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": edge, "alpha": 0.8}
    style: Style = {"ha": "center", "va": "bottom", "fontsize": "small", "fontweight": "bold", "color": color}
    ax.annotate(text, above, xytext=(0, 3), textcoords="offset points", bbox=box, zorder=6, **style)


def draw_scale(ax: "Axes", lower: Float[np.ndarray, "2"], upper: Float[np.ndarray, "2"], unit: str | None) -> None:
    """Draw a bar of a round length, at most a quarter of the picture, in the lower left of its two corners."""
    width, height = upper - lower
    length = rounded_down(width / 4)
    left, bottom = lower + np.array([0.02 * width, 0.03 * height])
    ax.plot([left, left + length], [bottom, bottom], color="0.1", linewidth=2.5, solid_capstyle="butt", zorder=5)
    style: Style = {"ha": "center", "fontsize": "small", "zorder": 5, "textcoords": "offset points"}
    box: Style = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.6}
    text = f"{length:g}{f' {unit}' if unit else ''}"
    verbatim(ax.annotate(text, (left + length / 2, bottom), xytext=(0, 4), bbox=box, **style))
