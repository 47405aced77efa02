"""Which part of the clouds the views show, and how their values are stretched to the range of a scale."""

import numpy as np
from jaxtyping import Float

from gmmjax.changes import Changes


def shown_range(
    points: Float[np.ndarray, "n 3"], changes: Changes
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The box that the views show: all points but a few that lie far out, and all changes.

    Args:
        points: of both clouds, in the frame of the changes.
        changes: whose boxes are shown as a whole.

    Returns:
        Its lower and its upper corner.
    """
    # One stray point far out must not shrink the scene to a dot.
    inner = np.quantile(points, [0.001, 0.999], axis=0)
    margin = 0.5 * (inner[1] - inner[0]).max()
    lower, upper = np.maximum(points.min(axis=0), inner[0] - margin), np.minimum(points.max(axis=0), inner[1] + margin)
    corners = np.concatenate([[lower, upper], *(change.box.corners() for change in changes.items)])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    # A plane along an axis still needs some depth.
    pad = 0.03 * max(float((upper - lower).max()), float(np.finfo(np.float32).tiny))
    return lower - pad, upper + pad


def stretched(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Values from 0 to 1, the lowest and highest hundredths cut off."""
    lowest, highest = np.quantile(values, [0.01, 0.99]) if len(values) else (0.0, 0.0)
    if highest <= lowest:
        return np.full(len(values), 0.5)
    stretched: Float[np.ndarray, " n"] = np.clip((values - lowest) / (highest - lowest), 0, 1)
    return stretched
