"""Filters of the points that are left out before a cloud is compared."""

import math

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from gmmjax._cores import available_cores
from gmmjax.clouds.coordinates import as_finite_points
from gmmjax.errors import InputError


def statistical_outliers(points: npt.ArrayLike, *, neighbours: int = 20, ratio: float = 2.0) -> Bool[np.ndarray, " n"]:
    """The points that lie unusually far from their neighbours (Rusu et al., "Towards 3D point cloud based object maps
    for household environments", 2008, section 4.1).

    A point is an outlier when its mean distance to its `neighbours` nearest neighbours, itself not counted, is greater
    than the mean of that quantity over the cloud plus `ratio` times its standard deviation. The Point Cloud Library's
    MeanK is `neighbours`; Open3D counts the point itself, so that its nb_neighbors is `neighbours + 1`.

    Args:
        points: coordinates [N, 3], finite.
        neighbours: how many neighbours; all others where the cloud has no more.
        ratio: how many standard deviations.

    Returns:
        True where the point is an outlier.

    Raises:
        InputError: points that are not finite [N, 3], `neighbours` below 1 or a negative `ratio`.
    """
    coordinates = as_finite_points(points)
    if neighbours < 1:
        raise InputError(f"neighbours must be at least 1, not {neighbours}; 20 is usual")
    if not ratio >= 0:
        raise InputError(f"ratio must not be negative, but is {ratio}; 2.0 is usual")
    count = len(coordinates)
    if count < 2:
        return np.zeros(count, dtype=bool)
    distances, _ = cKDTree(coordinates).query(coordinates, k=min(neighbours, count - 1) + 1, workers=available_cores())
    # The nearest one is the point itself, or one at the same place: the distance is 0 either way.
    mean_distances = distances[:, 1:].mean(axis=1)
    return np.asarray(mean_distances > mean_distances.mean() + ratio * mean_distances.std(ddof=1))


def crop_box(points: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike) -> Bool[np.ndarray, " n"]:
    """The points inside a box along the axes, its faces included.

    Args:
        points: coordinates [N, 3], finite.
        lower: the corner with the lowest coordinates [3]; -inf leaves a side open.
        upper: the corner with the highest coordinates [3]; inf leaves a side open.

    Returns:
        True where the point is inside.

    Raises:
        InputError: points that are not finite [N, 3], or corners that are not three numbers with lower <= upper.
    """
    coordinates = as_finite_points(points)
    low, high = _corner(lower, "lower"), _corner(upper, "upper")
    if (low > high).any():
        raise InputError(f"lower {low.tolist()} is above upper {high.tolist()}; exchange them on that axis")
    return np.asarray(((coordinates >= low) & (coordinates <= high)).all(axis=1))


def box_text(box: Float64[np.ndarray, "2 3"], size: float) -> str:
    """A box along the axes as a user reads it, to a thousandth of a size.

    Args:
        box: its lowest and its highest corner.
        size: that matters, such as the extent of a scene.
    """
    decimals = max(0, 3 - math.ceil(math.log10(size)))
    return " x ".join(f"{least:.{decimals}f}..{most:.{decimals}f}" for least, most in box.T)


def _corner(corner: npt.ArrayLike, name: str) -> np.ndarray:
    try:
        values = np.asarray(corner, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name} must be three numbers, not {corner!r}") from error
    if values.shape != (3,) or np.isnan(values).any():
        raise InputError(f"{name} must be three numbers, not {values.tolist()}")
    return values
