"""Pixels of depth images: which stand alone, and what lies between them."""

import numpy as np
from jaxtyping import Bool, Float64

# Pixels whose depths differ by more than this share are of two surfaces, with nothing between them.
JUMP = 0.03
# A pixel stands alone when fewer of the eight around it are of the same surface; a line of pixels has two.
LEAST_ALIKE = 2


def lone_pixels(depth: Float64[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The pixels with a return that are of no surface, such as those that fall between two at an edge.

    Args:
        depth: metres, NaN where there is no return.
    """
    height, width = depth.shape
    padded = np.pad(depth, 1, constant_values=np.nan)
    alike = np.zeros(depth.shape, int)
    for row, column in [(row, column) for row in range(3) for column in range(3) if (row, column) != (1, 1)]:
        beside = padded[row : row + height, column : column + width]
        alike += np.abs(beside - depth) <= JUMP * depth
    return np.isfinite(depth) & (alike < LEAST_ALIKE)


def interpolated(depth: Float64[np.ndarray, "h w"], factor: int) -> Float64[np.ndarray, "fine_h fine_w"]:
    """The image with each pixel cut into smaller ones, interpolated where the four pixels around see one surface.

    Inverse depths are interpolated, in which a plane is linear. At jumps of the depth, and beside pixels without a
    return, the smaller pixels have the depth of their own one.

    Args:
        depth: metres, NaN where there is no return.
        factor: into how many each pixel is cut across and down.
    """
    rows, down = _between(depth.shape[0], factor)
    columns, across = _between(depth.shape[1], factor)
    corners = np.stack([depth[np.ix_(rows + i, columns + j)] for i in (0, 1) for j in (0, 1)])
    weights = np.stack([np.outer(y, x) for y in (1 - down, down) for x in (1 - across, across)])
    between = 1 / (weights / corners).sum(axis=0)
    nearest, farthest = corners.min(axis=0), corners.max(axis=0)
    # Comparisons with NaN are false.
    smooth = farthest - nearest <= JUMP * nearest
    return np.where(smooth, between, depth.repeat(factor, axis=0).repeat(factor, axis=1))


def _between(size: int, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each smaller pixel the pixel before its centre, and its share of the way to the next; at the rim beyond."""
    centres = (np.arange(size * factor) + 0.5) / factor - 0.5
    before = np.clip(np.floor(centres).astype(int), 0, max(size - 2, 0))
    return before, centres - before
