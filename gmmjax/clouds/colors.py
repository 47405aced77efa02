"""Conversion of the colours that files hold to bytes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from gmmjax.errors import InputError

CHANNELS = ("red", "green", "blue")


class ColorRange(NamedTuple):
    """The lowest and the highest colour of a cloud, which tell what its numbers mean.

    Attributes:
        lowest: of all channels; NaN counts as 0.
        highest: of all channels.
    """

    lowest: float = 0.0
    highest: float = 0.0

    def with_channels(self, channels: np.ndarray) -> "ColorRange":
        """Extend the range by more colours, numbers [N, 3]."""
        numbers = _numbers(channels)
        lowest, highest = float(numbers.min(initial=0.0)), float(numbers.max(initial=0.0))
        return ColorRange(min(self.lowest, lowest), max(self.highest, highest))


def color_bytes(channels: np.ndarray, source: str, limits: ColorRange | None = None) -> UInt8[np.ndarray, "n 3"]:
    """Convert red, green and blue to bytes.

    Bytes stay. Other integers stay when none is above 255 (many writers put bytes into 16-bit columns) and are divided
    by 257 otherwise, which maps 65535 to 255. Floats are shares of one when none is above 1, and otherwise as integers,
    which above 255 they have to be. NaN, as scanners write it for points without a colour, becomes 0.

    Args:
        channels: numbers [N, 3].
        source: the file, for the message.
        limits: of the whole cloud, where these are some of its points; None: these are all.

    Raises:
        InputError: a negative colour, or one above the range.
    """
    if channels.dtype == np.uint8:
        return np.ascontiguousarray(channels)
    values = _numbers(channels)
    limits = ColorRange().with_channels(channels) if limits is None else limits
    factor, divisor = 1.0, 1.0
    if channels.dtype.kind == "f" and limits.highest <= 1:
        factor = 255.0
    elif limits.highest > 255 and (channels.dtype.kind != "f" or (values == np.rint(values)).all()):
        divisor = 257.0
    if limits.lowest < 0 or limits.highest * factor / divisor > 255:
        raise InputError(
            f"{source}: colours run from {limits.lowest:g} to {limits.highest:g}; "
            "write them as 0 to 255, as 0 to 65535 or as shares from 0 to 1"
        )
    return np.rint(values * factor / divisor).astype(np.uint8)


def _numbers(channels: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(channels.astype(np.float64), nan=0.0, posinf=np.inf, neginf=-np.inf)
