"""Fits of one cloud from many random starts, and the best of them."""

import logging
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, PRNGKeyArray

from gmmjax._host import check_static, is_traced
from gmmjax.errors import ComputationError
from gmmjax.mixtures.annihilation import NOT_FINITE, Fit, FitSettings, failed
from gmmjax.mixtures.checked_points import checked_points, traced_points
from gmmjax.mixtures.map_fits import check_components, check_restarts, fit_in_frame, fits_of
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.parallel import Precision
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.weighted_points import WeightedPoints

logger = logging.getLogger(__name__)


def fit_restarts(
    points: ArrayLike,
    *,
    key: PRNGKeyArray,
    mass: ArrayLike | None = None,
    scatter: ArrayLike | None = None,
    max_components: int = 25,
    prior: Prior | None = None,
    restarts: int = 8,
    start: GaussianMixture | None = None,
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
        restarts: how many; 1 from a given start.
        start: a mixture to start from in place of random seeds.
        settings: how EM runs.
        precision: "float64" or "float32"; a fit that float32 gets wrong is computed again in float64, see `Fit.bits`.
        progress: called after each finished restart, from any thread.

    Raises:
        InputError: as `fit_mixture`. Failed computations are in `Fit.result`, one per restart.
    """
    check_static(max_components=max_components, restarts=restarts)
    check_restarts(restarts, precision)
    if is_traced(points, mass, scatter, key, prior, start):
        traced = traced_points(points, mass, scatter)
        check_components(max_components if start is None else len(start.weights), len(traced.points))
        # As arrays: a number would be a constant of the program.
        prior, start = jax.tree.map(jnp.asarray, (prior, start))
        traced_fits: Fit = _traced_fits(traced, key, prior, start, max_components, restarts, settings)
        return traced_fits
    checked = checked_points(points, mass, settings.covariance_type, scatter)
    starts = None if start is None else [start]
    of_restarts = [list(jax.random.split(key, restarts))]
    text = "fitting %d points from %d starts with at most %d components"
    logger.info(text, len(checked.points), restarts, max_components)
    fits = fits_of([checked], of_restarts, max_components, prior, starts, settings, precision, None, progress)[0]
    counts = np.asarray(fits.mixture.live).sum(axis=1).tolist()
    logger.info("components %s, message lengths %s", counts, np.round(np.asarray(fits.message_length), 1).tolist())
    return fits


@eqx.filter_jit
def _traced_fits(
    points: WeightedPoints,
    key: PRNGKeyArray,
    prior: Prior | None,
    start: GaussianMixture | None,
    max_components: int,
    restarts: int,
    settings: FitSettings,
) -> Fit:
    """Fits under any transformation; outside of `jit` too they are traced and compiled once."""
    keys = jax.random.split(key, restarts)
    if restarts == 1:
        # Loops compile and run faster without a batch of one.
        only = fit_in_frame(points, keys[0], prior, start, max_components, settings)
        return jax.tree.map(lambda leaf: leaf[None], only)
    fits: Fit = jax.vmap(lambda key: fit_in_frame(points, key, prior, start, max_components, settings))(keys)
    return fits


def best_fit(fits: Fit, *, throw: bool = True) -> Fit:
    """The restart with the shortest message length among those that are finite.

    Args:
        fits: of `fit_restarts`, with a leading axis of restarts.
        throw: raise if there is none (not under tracing).

    Raises:
        ComputationError: no restart gave a finite result.
    """
    lengths = jnp.where(failed(fits.result), jnp.inf, jnp.asarray(fits.message_length))
    if throw and not is_traced(fits) and not bool(jnp.any(jnp.isfinite(lengths))):
        raise ComputationError(f"none of {len(lengths)} restarts gave a mixture; {NOT_FINITE}")
    best = jnp.argmin(lengths)
    if is_traced(fits):
        return jax.tree.map(lambda leaf: jnp.asarray(leaf)[best], fits)
    return jax.tree.map(lambda leaf: np.asarray(leaf[int(best)]), fits)
