"""Plain values of a record that was read from a file, checked one by one."""

from typing import Any

import numpy as np
from jaxtyping import Float

from gmmjax.errors import shown


def finite(values: Any, shape: tuple[int, ...] = ()) -> Float[np.ndarray, "..."]:
    """Numbers as an array in float64.

    Args:
        values: a number, or nested lists of them.
        shape: that the array must have.

    Raises:
        ValueError: another shape, no numbers, or NaN or infinity among them.
    """
    array = np.array(values)
    if array.shape != shape or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise ValueError(f"{shown(values)} must be finite numbers {list(shape)}")
    return array.astype(np.float64)


def probability(value: Any) -> float:
    """A probability.

    Raises:
        ValueError: no number from 0 to 1.
    """
    number = float(finite(value))
    if not 0 <= number <= 1:
        raise ValueError(f"{shown(value)} must lie between 0 and 1")
    return number


def whole(value: Any) -> int:
    """A count or an index.

    Raises:
        ValueError: no whole number, or a negative one.
    """
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{shown(value)} must be a whole number of at least 0")
    return value


def text(value: Any) -> str:
    """A text.

    Raises:
        ValueError: something else.
    """
    if not isinstance(value, str):
        raise ValueError(f"{shown(value)} must be a text")
    return value
