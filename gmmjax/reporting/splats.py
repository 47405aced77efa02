"""Points drawn as squares: the nearest point of each pixel, and how far pixels lie behind their neighbours."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32


class Projected(NamedTuple):
    """Points as a camera sees them: pixels from the left and the upper edge; depth is positive in front of the eye."""

    column: Float[np.ndarray, " n"]
    row: Float[np.ndarray, " n"]
    depth: Float[np.ndarray, " n"]

    def chosen(self, chosen: Bool[np.ndarray, " n"]) -> "Projected":
        """Return some of the points."""
        return Projected(*(values[chosen] for values in self))


def thinned(rows: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    """Choose at most this number of rows: one, at random, of each of as many equal parts; the same ones each time.

    Every n-th row would make a pattern of a scan whose points are in the order of a grid.
    """
    if len(rows) <= most:
        return rows
    places = np.arange(most) + np.random.default_rng(0).random(most)
    return rows[(places * (len(rows) / most)).astype(int)]


def square_edge(points: int, covered: float, largest: int) -> int:
    """Return the edge, in pixels, of squares for all points that have `covered` pixels together; at most `largest`."""
    return int(np.clip(round(float(np.sqrt(covered / max(points, 1)))), 1, largest))


def nearest_points(points: Projected, square: int, height: int, width: int) -> Int32[np.ndarray, "h w"]:
    """Find the nearest point whose square covers each pixel, -1 where there is none.

    Depths are told apart to a 65,536th of their range; of equal ones the last point is taken. `square` is the edge in
    pixels.
    """
    # With a margin, every square lies in the picture as a whole.
    wide = width + 2 * square
    left, top = (np.floor(position + (1 - square) / 2) for position in (points.column, points.row))
    inside = (points.depth > 0) & (left > -square) & (left < width) & (top > -square) & (top < height)
    drawn = np.flatnonzero(inside)
    drawn = drawn[_farthest_first(points.depth[drawn])].astype(np.int32)
    corner = ((top[drawn] + square) * wide + left[drawn] + square).astype(np.int32)
    offsets = (np.arange(square)[:, None] * wide + np.arange(square)).ravel().astype(np.int32)
    nearest = np.full((height + 2 * square) * wide, -1, np.int32)
    # Of equal indices NumPy keeps the last value, which is that of the nearest point.
    nearest[(corner[:, None] + offsets).ravel()] = np.repeat(drawn, len(offsets))
    return nearest.reshape(-1, wide)[square : square + height, square : square + width]


def enclosed(covered: Bool[np.ndarray, "h w"], gap: int) -> Bool[np.ndarray, "h w"]:
    """Find the uncovered pixels with covered ones on both sides, or above and below, at most `gap` pixels away."""
    left, right, above, below = (
        _beside(covered, gap, down, across) for down, across in ((0, -1), (0, 1), (-1, 0), (1, 0))
    )
    return ~covered & (left & right | above & below)


def _beside(covered: Bool[np.ndarray, "h w"], gap: int, down: int, across: int) -> Bool[np.ndarray, "h w"]:
    """Find the pixels with a covered one at most `gap` pixels away in a direction."""
    (height, width), padded, found = covered.shape, np.pad(covered, gap), np.zeros_like(covered)
    for step in range(1, gap + 1):
        row, column = gap + step * down, gap + step * across
        found |= padded[row : row + height, column : column + width]
    return found


def depth_steps(depth: Float32[np.ndarray, "h w"], largest: float) -> Float32[np.ndarray, "h w"]:
    """Measure by how many octaves of depth, at most, a pixel lies behind each of its four neighbours, on average.

    That is eye-dome lighting (Boucheny and Ribes 2011). A depth is inf where there is nothing.
    """
    octaves = np.log2(np.pad(depth, 1, constant_values=np.inf), dtype=np.float32)
    # Larger than any depth and, unlike inf, with differences.
    octaves[np.isinf(octaves)] = np.finfo(np.float32).max / 4
    own = octaves[1:-1, 1:-1]
    neighbours = octaves[:-2, 1:-1], octaves[2:, 1:-1], octaves[1:-1, :-2], octaves[1:-1, 2:]
    steps: Float32[np.ndarray, "h w"] = sum(np.clip(own - neighbour, 0, largest) for neighbour in neighbours) / 4
    return steps


def _farthest_first(depth: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Order the points by 16 bits of their depth: NumPy sorts these by radix, in a tenth of the time."""
    if not len(depth) or np.ptp(depth) == 0:
        return np.arange(len(depth))
    nearness = depth.max() - depth
    return np.argsort((nearness / nearness.max() * 65_535).astype(np.uint16), kind="stable")
