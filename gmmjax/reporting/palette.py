"""Colours of the kinds of change: Okabe and Ito's, which colour-blind readers can tell apart."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, UInt8

from gmmjax.changes import Kind

KIND_COLORS: Mapping[Kind, str] = {"appeared": "#009E73", "disappeared": "#D55E00", "moved": "#0072B2"}
UNCHANGED_COLOR = (150, 152, 156)


def color_bytes(color: str) -> tuple[int, int, int]:
    """Red, green and blue of "#rrggbb"."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue


def point_colors(kinds: UInt8[np.ndarray, " n"], colors: UInt8[np.ndarray, "n 3"] | None) -> UInt8[np.ndarray, "n 3"]:
    """A colour for each point of a cloud: that of its kind of change, or its own, half way to grey, where unchanged.

    Args:
        kinds: per point 0 where unchanged, else 1 and the index of the kind in `KIND_COLORS`.
        colors: the scan's own colours; None where it has none.
    """
    grey = np.array(UNCHANGED_COLOR, np.uint8)
    result = np.tile(grey, (len(kinds), 1)) if colors is None else greyed(colors)
    of_kinds = np.array([grey, *map(color_bytes, KIND_COLORS.values())], np.uint8)
    changed = kinds > 0
    result[changed] = of_kinds[kinds[changed]]
    return result


def luminance(colors: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """How bright colours look, 0 to 1 (Rec. 601)."""
    weights = np.array([0.299, 0.587, 0.114]) / 255
    brightness: Float[np.ndarray, " n"] = colors @ weights
    return brightness


def greyed(colors: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of unchanged points, half way to grey, so that those of the kinds stand out."""
    mixed = 0.5 * colors + 0.5 * np.array(UNCHANGED_COLOR)
    return np.rint(mixed).astype(np.uint8)
