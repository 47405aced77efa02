"""Colours of the kinds of change, Okabe and Ito's, which colour-blind readers can tell apart, and of scans."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, UInt8

from gmmjax.changes import Kind

KIND_COLORS: Mapping[Kind, str] = {"appeared": "#009E73", "disappeared": "#D55E00", "moved": "#0072B2"}
UNCHANGED_COLOR = (150, 152, 156)


def color_bytes(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of "#rrggbb"."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue


def point_colors(kinds: UInt8[np.ndarray, " n"], colors: UInt8[np.ndarray, "n 3"] | None) -> UInt8[np.ndarray, "n 3"]:
    """Colour each point of a cloud by its kind of change, or its own colour, half way to grey, where unchanged.

    Kinds are 0 where unchanged, else 1 and the index of the kind in `KIND_COLORS`.
    """
    grey = np.array(UNCHANGED_COLOR, np.uint8)
    result = np.tile(grey, (len(kinds), 1)) if colors is None else greyed(colors)
    of_kinds = np.array([grey, *map(color_bytes, KIND_COLORS.values())], np.uint8)
    changed = kinds > 0
    result[changed] = of_kinds[kinds[changed]]
    return result


def luminance(colors: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return how bright colours look, 0 to 1 (Rec. 601)."""
    weights = np.array([0.299, 0.587, 0.114]) / 255
    brightness: Float[np.ndarray, " n"] = colors @ weights
    return brightness


def greyed(colors: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Mix colours of unchanged points with grey, half and half, so that those of the kinds stand out."""
    mixed = 0.5 * colors + 0.5 * np.array(UNCHANGED_COLOR)
    return np.rint(mixed).astype(np.uint8)


def stretched(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Map values to 0 to 1, the lowest and highest hundredths cut off."""
    lowest, highest = np.quantile(values, [0.01, 0.99]) if len(values) else (0.0, 0.0)
    if highest <= lowest:
        return np.full(len(values), 0.5)
    stretched: Float[np.ndarray, " n"] = np.clip((values - lowest) / (highest - lowest), 0, 1)
    return stretched
