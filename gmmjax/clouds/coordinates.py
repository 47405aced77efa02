"""Coordinates as callers give them, checked."""

import os

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64

from gmmjax.errors import InputError, shown


def require_array(values: object, name: str) -> None:
    """Check that values are neither a path nor a cloud, which are given where an array is expected.

    Args:
        values: of an argument.
        name: what the message calls them.

    Raises:
        InputError: a text, a path, several of them, or an object that has points.
    """
    first = values[0] if isinstance(values, list | tuple) and values else values
    if isinstance(values, np.ndarray) and values.dtype.kind in "US" and values.size:
        first = values.flat[0].item()
    if isinstance(first, str | bytes | os.PathLike):
        raise InputError(
            f"{name}: is {shown(os.fspath(first))}, which is no array of points; read a file with "
            "gmmjax.read_cloud(path), the files of one survey with gmmjax.read_survey(paths)"
        )
    if isinstance(values, list | tuple) and hasattr(first, "points"):
        raise InputError(f"{name}: is a list of clouds; give one, such as of gmmjax.read_survey(paths)")
    for attribute in ("points", "vertices"):
        if hasattr(values, attribute):
            raise InputError(f"{name}: is a {type(values).__name__}, which is no array; give its attribute {attribute}")


def as_points(points: npt.ArrayLike, name: str = "points") -> Float64[np.ndarray, "n 3"]:
    """Check coordinates [N, 3] and convert them to float64, copied only where the type changes; NaN and inf pass.

    Args:
        points: real numbers [N, 3].
        name: what the message calls them.

    Raises:
        InputError: not real numbers, or not [N, 3].
    """
    require_array(points, name)
    if isinstance(points, np.ma.MaskedArray):
        # What is masked has no position.
        points = np.ma.filled(points.astype(np.float64), np.nan)
    try:
        array = np.asarray(points)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"{name}: cannot be made an array [N, 3] ({error}); give three numbers for each point"
        ) from error
    if array.dtype.kind not in "fiu" and array.size:
        if array.ndim < 2:
            raise InputError(f"{name}: is {shown(points)}, not an array [N, 3]; give three numbers for each point")
        raise InputError(f"{name}: must be real numbers, not {array.dtype}; convert them with astype(float)")
    if array.ndim != 2 or array.shape[1] != 3:
        hint = "; transpose it" if array.ndim == 2 and array.shape[0] == 3 else ""
        raise InputError(f"{name}: must have shape [N, 3], not {list(array.shape)}{hint}")
    # What is beyond float64 becomes inf; signalling NaN stays NaN.
    with np.errstate(over="ignore", invalid="ignore"):
        return array.astype(np.float64, copy=False)


def as_finite_points(points: npt.ArrayLike, name: str = "points") -> Float64[np.ndarray, "n 3"]:
    """Check and convert as `as_points`; an `InputError` also where a number is not finite."""
    array = as_points(points, name)
    if not np.isfinite(array).all():
        broken = ~np.isfinite(array).all(axis=1)
        raise InputError(
            f"{name}: {int(broken.sum())} of {len(array)} rows have NaN or inf (first: row {int(broken.argmax())}); "
            "drop them with PointCloud.from_rows(points).points"
        )
    return array
