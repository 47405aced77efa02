"""Points and masses as a caller gives them, checked on the host."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from gmmjax.clouds import require_array
from gmmjax.errors import InputError
from gmmjax.mixtures.covariance_type import CovarianceType, parameters_per_component
from gmmjax.mixtures.weighted_points import WeightedPoints


def checked_points(
    points: ArrayLike,
    mass: ArrayLike | None,
    covariance_type: CovarianceType = "full",
    scatter: ArrayLike | None = None,
) -> WeightedPoints:
    """Points and masses in float64, checked on the host.

    Raises:
        InputError: what is wrong with the points, and the remedy.
    """
    require_array(points, "points")
    coordinates = np.asarray(points, dtype=np.float64)
    _check_shapes(coordinates, mass, scatter)
    masses = np.ones(len(coordinates)) if mass is None else np.asarray(mass, dtype=np.float64)
    if not (np.isfinite(masses).all() and (masses >= 0).all()):
        raise InputError("mass must be finite and not negative")
    unusable = int((~np.isfinite(coordinates)).any(axis=1).sum())
    if unusable:
        raise InputError(f"points has {unusable} rows with NaN or infinite coordinates; drop them first")
    parameters = parameters_per_component(coordinates.shape[1], covariance_type)
    if masses.sum() <= parameters:
        raise InputError(
            f"points has {masses.sum():g} observations; a single Gaussian in {coordinates.shape[1]} dimensions has "
            f"{parameters} parameters, so more than {parameters} are needed"
        )
    used = coordinates[masses > 0]
    if np.ptp(used, axis=0).max() <= 8 * np.finfo(np.float64).eps * np.abs(used).max():
        raise InputError("all points are equal: there is nothing to fit a mixture to")
    return WeightedPoints(coordinates, masses, _checked_scatter(scatter))


def _checked_scatter(scatter: ArrayLike | None) -> np.ndarray | None:
    if scatter is None:
        return None
    covariances = np.asarray(scatter, dtype=np.float64)
    if not np.isfinite(covariances).all() or (np.diagonal(covariances, axis1=1, axis2=2) < 0).any():
        raise InputError("scatter must be covariances: finite, and none of its variances negative")
    return covariances


def traced_points(points: ArrayLike, mass: ArrayLike | None, scatter: ArrayLike | None = None) -> WeightedPoints:
    """Points and masses as JAX arrays in the dtype of the points, for tracing; nothing of their values is checked.

    Raises:
        InputError: shapes that do not fit.
    """
    coordinates = jnp.asarray(points)
    known = coordinates.dtype in (np.float32, np.float64)
    dtype = coordinates.dtype if known else jnp.result_type(float)
    coordinates = coordinates.astype(dtype)
    _check_shapes(coordinates, mass, scatter)
    return WeightedPoints(
        coordinates,
        jnp.ones(len(coordinates), dtype) if mass is None else jnp.asarray(mass, dtype),
        None if scatter is None else jnp.asarray(scatter, dtype),
    )


def _check_shapes(points: ArrayLike, mass: ArrayLike | None, scatter: ArrayLike | None) -> None:
    shape = np.shape(points)
    if len(shape) != 2 or shape[1] < 1:
        raise InputError(f"points must have the shape [n, d], not {list(shape)}")
    if mass is not None and np.shape(mass) != shape[:1]:
        raise InputError(f"mass must have one value a point, [{shape[0]}], not {list(np.shape(mass))}")
    expected = (*shape, shape[1])
    if scatter is not None and np.shape(scatter) != expected:
        raise InputError(f"scatter must have one covariance a point, {list(expected)}, not {list(np.shape(scatter))}")
