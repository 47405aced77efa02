"""An order of the points of a cloud that does not depend on the order they are given in."""

import numpy as np
from jaxtyping import Bool, Float64, Int, Shaped, UInt64

# What doubles the distance between groups of bits until two zeros follow each of 21 bits.
MORTON_MASKS = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def canonical_order(points: Float64[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """The order of the points by x, then y, then z: sums, samples and labels then do not depend on the rows' order.

    Each axis is taken in the sense in which the median lies above the middle of the extent, so that the mirrored cloud
    has the mirrored order. Equal points keep their order.

    Args:
        points: coordinates, finite, at least one point.

    Returns:
        The indices of the points in that order.
    """
    x, y, z = _unmirrored(points).T
    order = np.argsort(x, kind="stable")
    # Few points share their x, and only these need the other axes: half the time of sorting by all three.
    same = np.diff(x[order]) == 0
    tied = np.flatnonzero(np.append(same, False) | np.append(False, same))
    rows = order[tied]
    order[tied] = rows[np.lexsort((z[rows], y[rows], x[rows]))]
    return order


def morton_order(points: Float64[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """The order of the points along Morton's space-filling curve (1966): neighbours in it are neighbours in space.

    Points within a two-millionth of the extent of each other keep their order. The axes have the sense of
    `canonical_order`.

    Args:
        points: coordinates, finite, at least one point.
    """
    unmirrored = _unmirrored(points)
    offsets = unmirrored - unmirrored.min(axis=0)
    extent = max(float(offsets.max()), np.finfo(np.float64).tiny)
    return np.argsort(morton_codes((offsets.T / extent * (2**21 - 1)).astype(np.uint64)), kind="stable")


def morton_codes(indices: UInt64[np.ndarray, "3 n"]) -> UInt64[np.ndarray, " n"]:
    """Morton's number of each cell of a grid: the bits of its indices in turn, three bits fewer for the cell around it.

    Args:
        indices: of the cells along x, y and z, below 2^21.
    """
    x, y, z = (_spread_bits(own) for own in indices)
    return (x << np.uint64(2)) | (y << np.uint64(1)) | z


def morton_indices(codes: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, "3 n"]:
    """The indices of cells along x, y and z by Morton's numbers.

    Args:
        codes: as of `morton_codes`.
    """
    return np.stack([_gathered_bits(codes >> np.uint64(2 - axis)) for axis in range(3)])


def _unmirrored(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    # Axis by axis: NumPy is many times as fast along rows.
    columns = np.ascontiguousarray(points.T)
    middle = columns.min(axis=1) / 2 + columns.max(axis=1) / 2
    return np.where(np.median(columns, axis=1) < middle, -points, points)


def _spread_bits(numbers: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """The lower 21 bits of the numbers, each followed by two zeros."""
    for shift, mask in MORTON_MASKS:
        numbers = (numbers | (numbers << np.uint64(shift))) & np.uint64(mask)
    return numbers


def _gathered_bits(numbers: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """Every third bit of the numbers, beginning with the lowest."""
    masks = [mask for _, mask in reversed(MORTON_MASKS)]
    numbers = numbers & np.uint64(masks[0])
    for (shift, _), mask in zip(reversed(MORTON_MASKS), [*masks[1:], 0x1FFFFF], strict=True):
        numbers = (numbers | (numbers >> np.uint64(shift))) & np.uint64(mask)
    return numbers


def first_of_equals(values: Shaped[np.ndarray, "n *_"]) -> Bool[np.ndarray, " n"]:
    """Mask of the values that differ from the one before them, for sorted values or points in the canonical order.

    Args:
        values: numbers [n], or points [n, 3].
    """
    different = values[1:] != values[:-1]
    return np.append(np.ones(min(1, len(values)), bool), different.any(axis=tuple(range(1, values.ndim))))
