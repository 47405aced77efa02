"""Fits from many random starts: checks the points, chooses scale and precision, shares the work out over the cores."""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, PRNGKeyArray

from gmmjax._host import available_cores, is_traced, to_numpy
from gmmjax.errors import ComputationError, InputError, check_choice
from gmmjax.mixtures.annihilation import NOT_FINITE, Fit, FitSettings, FitStatus, fit_by_annihilation
from gmmjax.mixtures.covariance_type import CovarianceType, parameters_per_component
from gmmjax.mixtures.frame import Frame
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.seeding import initial_mixture
from gmmjax.mixtures.trust import scored_in_double
from gmmjax.mixtures.weighted_points import WeightedPoints

Precision = Literal["float64", "float32"]

# The default noise floor, in units of the points' spread. In float32 the rounding of the second moments is about 7e-4
# of the spread, and the floor must stand well above it.
RELATIVE_NOISE_FLOOR = {"float64": 1e-3, "float32": 5e-3}


def fit_restarts(
    points: ArrayLike,
    *,
    key: PRNGKeyArray,
    mass: ArrayLike | None = None,
    scatter: ArrayLike | None = None,
    max_components: int = 25,
    prior: Prior | None = None,
    restarts: int = 8,
    settings: FitSettings = FitSettings(),
    precision: Precision = "float64",
    progress: Callable[[], None] | None = None,
) -> Fit:
    """Fits from `restarts` random starts: a `Fit` whose every leaf has a leading axis of restarts.

    On the host the restarts are shared out over the processor's cores; under tracing they are a `vmap`.

    Args:
        points: coordinates [n, d].
        key: random key; each restart gets its own part.
        mass: masses [n]; default 1 each.
        scatter: covariances [n, d, d] of the observations about their points; default none.
        max_components: K_max.
        prior: as in `fit_mixture`.
        restarts: how many.
        settings: how EM runs.
        precision: "float64" or "float32"; a fit that float32 gets wrong is computed again in float64, see `Fit.bits`.
        progress: called after each finished restart, from any thread.

    Raises:
        InputError: as `fit_mixture`. Failed computations are in `Fit.result`, one per restart.
    """
    check_choice("precision", precision, get_args(Precision))
    if restarts < 1:
        raise InputError(f"restarts={restarts} must be at least 1")
    if is_traced(points, mass, scatter, key, prior):
        traced = traced_points(points, mass, scatter)
        _check_components(max_components, len(traced.points))
        keys = jax.random.split(key, restarts)
        return jax.vmap(lambda key: fit_in_frame(traced, key, prior, max_components, settings))(keys)
    checked = checked_points(points, mass, settings.covariance_type, scatter)
    _check_components(max_components, int(np.count_nonzero(checked.mass)))

    def fit_one(key: PRNGKeyArray, points: WeightedPoints) -> Fit:
        return _compiled_fit(points, key, prior_in_frame, max_components, settings)

    frame = Frame.of(checked)
    prior_in_frame = _prior_in_frame(prior, frame, settings, precision)
    padded = frame.enter(checked).padded()
    arguments = [(key, padded) for key in jax.random.split(key, restarts)]
    fits: Fit = map_on_cores(fit_one, arguments, precision, progress)
    if precision == "float32":
        fits, right = scored_in_double(fits, padded, settings)
        if not right.all():
            doubtful = np.flatnonzero(~right)
            again = map_on_cores(fit_one, [arguments[index] for index in doubtful], "float64")
            fits = jax.tree.map(lambda old, new: _replaced(old, doubtful, new), fits, again)
    observations = checked.mass.sum()
    # One by one in NumPy: to trace a `vmap` would take longer than a small fit.
    return _stacked([frame.leave_fit(_restart(fits, index), observations) for index in range(restarts)])


def fit_in_frame(
    points: WeightedPoints, key: PRNGKeyArray, prior: Prior | None, max_components: int, settings: FitSettings
) -> Fit:
    """One traced fit, from and to the unit of the points; see `fit_mixture`."""
    frame = Frame.of(points)
    prior_in_frame = _prior_in_frame(prior, frame, settings, str(points.points.dtype))
    fit = _fit(frame.enter(points), key, prior_in_frame, max_components, settings)
    return frame.leave_fit(fit, jnp.sum(points.mass))


def best_fit(fits: Fit, *, throw: bool = True) -> Fit:
    """The restart with the shortest message length among those that are finite.

    Args:
        fits: of `fit_restarts`, with a leading axis of restarts.
        throw: raise if there is none (not under tracing).

    Raises:
        ComputationError: no restart gave a finite result.
    """
    lengths = jnp.where(fits.result != FitStatus.not_finite, jnp.asarray(fits.message_length), jnp.inf)
    if throw and not is_traced(fits) and not bool(jnp.any(jnp.isfinite(lengths))):
        raise ComputationError(f"none of {len(lengths)} restarts gave a mixture; {NOT_FINITE}")
    best = jnp.argmin(lengths)
    if is_traced(fits):
        return jax.tree.map(lambda leaf: leaf[best], fits)
    return jax.tree.map(lambda leaf: np.asarray(leaf[int(best)]), fits)


def derived_noise_floor(points: WeightedPoints) -> float:
    """The noise floor where none is given, in the unit of the points: a thousandth of their spread.

    Args:
        points: the points that are fitted, NumPy arrays.
    """
    return RELATIVE_NOISE_FLOOR["float64"] * float(Frame.of(points).spread)


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
    coordinates = np.asarray(points, dtype=np.float64)
    if coordinates.ndim != 2 or coordinates.shape[1] < 1:
        raise InputError(f"points must have the shape [n, d], not {list(coordinates.shape)}")
    masses = np.ones(len(coordinates)) if mass is None else np.asarray(mass, dtype=np.float64)
    if masses.shape != coordinates.shape[:1]:
        raise InputError(f"mass must have one value a point, [{len(coordinates)}], not {list(masses.shape)}")
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
    return WeightedPoints(coordinates, masses, _checked_scatter(scatter, coordinates))


def _checked_scatter(scatter: ArrayLike | None, points: np.ndarray) -> np.ndarray | None:
    if scatter is None:
        return None
    covariances = np.asarray(scatter, dtype=np.float64)
    expected = (*points.shape, points.shape[1])
    if covariances.shape != expected:
        raise InputError(f"scatter must have one covariance a point, {list(expected)}, not {list(covariances.shape)}")
    if not np.isfinite(covariances).all() or (np.diagonal(covariances, axis1=1, axis2=2) < 0).any():
        raise InputError("scatter must be covariances: finite, and none of its variances negative")
    return covariances


def map_on_cores(
    function: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    precision: Precision,
    progress: Callable[[], None] | None = None,
) -> Any:
    """Runs a compiled function on the host for each tuple of arguments, shared out over the cores.

    Args:
        function: compiled by `jit`.
        arguments: one tuple of trees for each call, with NumPy leaves; all of the same shapes.
        precision: in which the floating point leaves go in.
        progress: called after each call, from any thread.

    Returns:
        The results stacked, as NumPy arrays.
    """

    def run(own: tuple[Any, ...]) -> Any:
        with jax.enable_x64(precision == "float64"):
            result = to_numpy(function(*in_precision(own, precision)))
        if progress is not None:
            progress()
        return result

    with ThreadPoolExecutor(min(len(arguments), available_cores())) as pool:
        results = list(pool.map(run, arguments))
    return _stacked(results)


def _replaced(rows: np.ndarray, indices: np.ndarray, by: np.ndarray) -> np.ndarray:
    changed = rows.copy()
    changed[indices] = by
    return changed


def _restart(fits: Fit, index: int) -> Fit:
    own: Fit = jax.tree.map(lambda leaf: np.asarray(leaf[index]), fits)
    return own


def _stacked(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


def in_precision(tree: Any, precision: Precision) -> Any:
    """The tree with its NumPy floating point leaves in this precision."""

    def cast(leaf: Any) -> Any:
        return leaf.astype(precision) if isinstance(leaf, np.ndarray) and leaf.dtype.kind == "f" else leaf

    return jax.tree.map(cast, tree)


def _fit(points: WeightedPoints, key: PRNGKeyArray, prior: Prior, max_components: int, settings: FitSettings) -> Fit:
    start = initial_mixture(points, max_components, prior, key)
    return fit_by_annihilation(points, start, prior, settings)


_compiled_fit = functools.partial(jax.jit, static_argnames=("max_components", "settings"))(_fit)


def _prior_in_frame(prior: Prior | None, frame: Frame, settings: FitSettings, precision: str) -> Prior:
    if prior is not None:
        return prior.rescaled(1 / frame.spread)
    return Prior.figueiredo_jain(len(frame.origin), RELATIVE_NOISE_FLOOR[precision], settings.covariance_type)


def traced_points(points: ArrayLike, mass: ArrayLike | None, scatter: ArrayLike | None = None) -> WeightedPoints:
    """Points and masses as JAX arrays, for tracing; nothing of their values is checked."""
    coordinates = jnp.asarray(points)
    return WeightedPoints(
        coordinates,
        jnp.ones(len(coordinates), coordinates.dtype) if mass is None else jnp.asarray(mass),
        None if scatter is None else jnp.asarray(scatter),
    )


def _check_components(max_components: int, points: int) -> None:
    if not 1 <= max_components <= points:
        raise InputError(
            f"max_components={max_components} must be at least 1 and at most the number of points, {points}"
        )
