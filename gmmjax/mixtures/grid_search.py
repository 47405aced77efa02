"""Grid search: number of components x covariance type, scored by a criterion (thesis 2.2.2, (2.12), and 3.1.7)."""

import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import ArrayLike, Float, PRNGKeyArray

from gmmjax._host import to_numpy
from gmmjax.errors import ComputationError, InputError, check_choice
from gmmjax.mixtures.annihilation import NOT_FINITE, Fit, FitSettings, FitStatus
from gmmjax.mixtures.covariance_type import COVARIANCE_TYPES, CovarianceType, parameters_per_component
from gmmjax.mixtures.criteria import CRITERIA, Criterion, criterion_score, message_length
from gmmjax.mixtures.expectation_maximisation import expectation_maximisation
from gmmjax.mixtures.fitting import RELATIVE_NOISE_FLOOR, Precision, checked_points, map_keys
from gmmjax.mixtures.frame import Frame
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.seeding import initial_mixture
from gmmjax.mixtures.weighted_points import WeightedPoints


class GridSearch(NamedTuple):
    """Result of `grid_search`.

    Attributes:
        fit: the fit with the lowest score.
        covariance_type: its covariance type.
        components: the numbers of components that were tried.
        scores: for each criterion and covariance type the lowest score over the restarts at each number of components,
            in nats; NaN-free: infinite where every restart failed.
    """

    fit: Fit
    covariance_type: CovarianceType
    components: tuple[int, ...]
    scores: Mapping[Criterion, Mapping[CovarianceType, Float[np.ndarray, " c"]]]


def grid_search(
    points: ArrayLike,
    *,
    key: PRNGKeyArray,
    mass: ArrayLike | None = None,
    components: Sequence[int] = range(3, 10),
    covariance_types: Sequence[CovarianceType] = COVARIANCE_TYPES,
    criterion: Criterion = "mdl",
    restarts: int = 1,
    settings: FitSettings = FitSettings(),
    precision: Precision = "float64",
) -> GridSearch:
    """Plain EM for every number of components and covariance type; the lowest score by the criterion wins.

    Args:
        points: coordinates [n, d].
        key: random key of the starts.
        mass: how many observations each point stands for [n]; default 1 each.
        components: the numbers of components to try.
        covariance_types: the covariance types to try; `settings.covariance_type` is not used.
        criterion: "mdl" (2.13), "bic" (2.14) or "aic" (2.15).
        restarts: random starts for each; the lowest score counts.
        settings: tolerance and max_steps of EM.
        precision: "float64" or "float32".

    Raises:
        InputError: points that cannot be fitted (see `fit_mixture`), an empty grid, an unknown criterion or type.
        ComputationError: no cell of the grid gave a finite score.
    """
    check_choice("criterion", criterion, CRITERIA)
    for covariance_type in covariance_types:
        check_choice("covariance_types", covariance_type, COVARIANCE_TYPES)
    if not covariance_types:
        raise InputError(f"covariance_types is empty; choose from {', '.join(COVARIANCE_TYPES)}")
    if not components or min(components) < 1:
        raise InputError(f"components={list(components)} must be numbers of components, 1 or more")
    if restarts < 1:
        raise InputError(f"restarts={restarts} must be at least 1")
    checked = checked_points(points, mass, parameters_per_component(np.shape(points)[-1]))
    if max(components) > np.count_nonzero(checked.mass):
        raise InputError(f"components up to {max(components)} are more than the points, {len(checked.mass)}")
    frame = Frame.of(checked)
    scores: dict[Criterion, dict[CovarianceType, np.ndarray]] = {name: {} for name in CRITERIA}
    best: tuple[float, CovarianceType, Fit] | None = None
    for covariance_type in covariance_types:
        fits = _fits(frame.enter(checked), key, components, covariance_type, restarts, settings, precision)
        with jax.enable_x64(True):
            fits = to_numpy(jax.vmap(frame.leave_fit, in_axes=(0, None))(fits, checked.mass.sum()))
            of_type = {name: _scores(name, fits, checked, covariance_type) for name in CRITERIA}
        for name, score in of_type.items():
            scores[name][covariance_type] = score.reshape(len(components), restarts).min(axis=1)
        index = int(np.argmin(of_type[criterion]))
        if best is None or of_type[criterion][index] < best[0]:
            best = of_type[criterion][index], covariance_type, jax.tree.map(lambda leaf, i=index: leaf[i], fits)
    assert best is not None
    if not np.isfinite(best[0]):
        raise ComputationError(f"no mixture of the grid has a finite score; {NOT_FINITE}")
    return GridSearch(best[2], best[1], tuple(components), scores)


def _fits(
    points: WeightedPoints,
    key: PRNGKeyArray,
    components: Sequence[int],
    covariance_type: CovarianceType,
    restarts: int,
    settings: FitSettings,
    precision: Precision,
) -> Fit:
    """All fits of one covariance type, number by number and restart by restart, along one leading axis."""
    per_number = []
    for count in components:

        def fit_one(key: PRNGKeyArray, points: WeightedPoints, count: int = count) -> Fit:
            return _fit_fixed(points, key, count, max(components), covariance_type, settings)

        per_number.append(map_keys(fit_one, points, key, restarts, precision))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *per_number)


@functools.partial(jax.jit, static_argnames=("slots", "covariance_type", "settings"))
def _fit_fixed(
    points: WeightedPoints,
    key: PRNGKeyArray,
    count: JaxArray | int,
    slots: int,
    covariance_type: CovarianceType,
    settings: FitSettings,
) -> Fit:
    """Plain EM with a fixed number of components in `slots` slots: one program for all numbers."""
    prior = Prior.maximum_likelihood(RELATIVE_NOISE_FLOOR[str(points.points.dtype)])
    seeded = initial_mixture(points, slots, prior, key)
    live = seeded.live & (jnp.arange(slots) < count)
    weights = live.astype(seeded.means.dtype) / jnp.sum(live, dtype=seeded.means.dtype)
    start = GaussianMixture.masked(weights, seeded.means, seeded.covariances, live)
    end = expectation_maximisation(
        points,
        start,
        prior,
        covariance_type=covariance_type,
        tolerance=settings.tolerance,
        max_steps=settings.max_steps,
    )
    result = FitStatus.where(end.converged, FitStatus.converged, FitStatus.step_limit)
    result = FitStatus.where(jnp.isfinite(end.log_likelihood), result, FitStatus.not_finite)
    length = message_length(end.mixture, end.log_likelihood, jnp.sum(points.mass), covariance_type)
    return Fit(end.mixture, length, end.log_likelihood, end.steps, result)


def _scores(
    criterion: Criterion, fits: Fit, points: WeightedPoints, covariance_type: CovarianceType
) -> Float[np.ndarray, " fits"]:
    def score(fit: Fit) -> JaxArray:
        return criterion_score(criterion, fit.mixture, fit.log_likelihood, points.mass.sum(), covariance_type)

    return np.where(np.asarray(fits.result != FitStatus.not_finite), np.asarray(jax.vmap(score)(fits)), np.inf)
