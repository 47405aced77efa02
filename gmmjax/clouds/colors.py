"""Colours of all the kinds that files hold, as bytes."""

import numpy as np
from jaxtyping import UInt8

from gmmjax.errors import InputError

CHANNELS = ("red", "green", "blue")


def color_bytes(channels: np.ndarray, source: str) -> UInt8[np.ndarray, "n 3"]:
    """Red, green and blue as bytes.

    Bytes stay. Other integers stay when none is above 255 (many writers put bytes into 16-bit columns) and are divided
    by 257 otherwise, which maps 65535 to 255. Floats are shares of one when none is above 1, and 0 to 255 otherwise.
    NaN, as scanners write it for points without a colour, becomes 0.

    Args:
        channels: numbers [N, 3].
        source: the file, for the message.

    Returns:
        The colours [N, 3].

    Raises:
        InputError: a negative colour, or one above the range.
    """
    if channels.dtype == np.uint8:
        return np.ascontiguousarray(channels)
    with np.errstate(invalid="ignore"):
        values = np.nan_to_num(channels.astype(np.float64), nan=0.0, posinf=np.inf, neginf=-np.inf)
    highest = values.max(initial=0.0)
    if channels.dtype.kind == "f" and highest <= 1:
        values = values * 255
    elif channels.dtype.kind != "f" and highest > 255:
        values = values / 257
    if values.min(initial=0.0) < 0 or values.max(initial=0.0) > 255:
        raise InputError(
            f"{source}: colours run from {channels.min()} to {channels.max()}; "
            "write them as 0 to 255, as 0 to 65535 or as shares from 0 to 1"
        )
    return np.rint(values).astype(np.uint8)
