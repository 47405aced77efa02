"""A single frame of a depth camera in the camera's own coordinates, recognised by the pixels that its points lie on.

Through a pinhole at the origin that looks along z the point (x, y, z) is seen at the tangents x / z and y / z. In a
frame as it was measured these are those of the columns and rows of an image, evenly spaced. In other clouds, and in
frames that were thinned or moved, they are anything.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.geometry import evenly_chosen


@dataclasses.dataclass(frozen=True)
class DepthFrameSettings:
    """When points lie on the pixels of a camera.

    Attributes:
        tolerance: standard deviation of the points about the lines of an image, in its pixels, at most. Points that
            lie anywhere have 0.29; those of files that are rounded to a tenth of a millimetre 0.02 and less. 0:
            rounding hides every frame.
        least_points: on a line, in the mean. 1: a few points that happen to lie on some lines are a frame.
        most_points: that are looked at, evenly chosen. Fewer: faster, and lines of large images have few points.
    """

    tolerance: float = 0.1
    least_points: float = 4.0
    most_points: int = 100_000


def is_depth_frame(points: Float64[np.ndarray, "n 3"], settings: DepthFrameSettings = DepthFrameSettings()) -> bool:
    """Whether points are the pixels of one camera at the origin, which looks along z, forward or backward.

    Args:
        points: of a cloud, or a part of them, in the camera's frame if it is one.
        settings: when they are.
    """
    chosen = points[evenly_chosen(len(points), settings.most_points)]
    depths = chosen[:, 2]
    if not len(chosen) or not ((depths > 0).all() or (depths < 0).all()):
        return False
    # Numbers beyond the range of floats fit no camera.
    with np.errstate(over="ignore", invalid="ignore"):
        tangents = chosen[:, :2] / depths[:, None]
    if not np.isfinite(tangents).all():
        return False
    image = [_number_of_lines(values, settings) for values in tangents.T]
    if not all(image):
        return False
    # The points of a level grid have evenly spaced tangents, too; those of a rounded file lie on a much finer grid.
    grid = [_number_of_lines(values, settings) for values in chosen[:, :2].T]
    return not all(0 < own <= 2 * seen for own, seen in zip(grid, image, strict=True))


def _number_of_lines(values: Float[np.ndarray, " n"], settings: DepthFrameSettings) -> int:
    """How many multiples of one step numbers are, up to an offset and a tolerance, many of each; 0: they are none."""
    ordered = np.sort(values)
    gaps = np.diff(ordered)
    extent = float(ordered[-1] - ordered[0])
    if extent <= 0:
        return 0
    # Of the gaps, half of the extent is made up by those that are as large: on lines, those between neighbouring ones.
    largest = np.sort(gaps)[::-1]
    usual = largest[np.searchsorted(np.cumsum(largest), extent / 2)]
    starts = np.flatnonzero(np.append(True, gaps > usual / 2))
    counts = np.diff(np.append(starts, len(ordered)))
    if len(starts) < 2 or counts.mean() < settings.least_points:
        return 0
    means = np.add.reduceat(ordered, starts) / counts
    distances = np.diff(means)
    lines = np.append(0.0, np.cumsum(np.round(distances / np.median(distances))))
    step, first = np.polyfit(lines, means, 1, w=np.sqrt(counts))
    error = ordered - np.repeat(first + step * lines, counts)
    return len(starts) if np.sqrt(np.mean(error**2)) <= settings.tolerance * step else 0
