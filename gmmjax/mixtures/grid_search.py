"""Grid search: number of components x covariance type, scored by a criterion (thesis 2.2.2, (2.12), and 3.1.7)."""

import functools
from collections.abc import Sequence
from typing import get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import ArrayLike, Float, Int, PRNGKeyArray

from gmmjax._derivatives import without_derivatives
from gmmjax._host import check_static, is_traced, to_numpy
from gmmjax._typing import Array, Scalar
from gmmjax.errors import ComputationError, InputError, check_choice
from gmmjax.mixtures.annihilation import NOT_FINITE, Fit, FitSettings, FitStatus, bits_of, failed, is_usable
from gmmjax.mixtures.checked_points import checked_points, traced_points
from gmmjax.mixtures.covariance_type import COVARIANCE_TYPES, CovarianceType, parameters_per_component
from gmmjax.mixtures.criteria import CRITERIA, Criterion, criterion_score, message_length
from gmmjax.mixtures.expectation_maximisation import expectation_maximisation
from gmmjax.mixtures.map_fits import RELATIVE_NOISE_FLOOR
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.parallel import Precision, map_on_cores
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.seeding import initial_mixture
from gmmjax.mixtures.standardisation import Standardisation
from gmmjax.mixtures.weighted_points import WeightedPoints

NO_DERIVATIVES = (
    "a grid search has no derivatives; take fit_mixture with FitSettings(polish=True), or hide the points from the "
    "differentiation by jax.lax.stop_gradient"
)


class GridSearch(eqx.Module):
    """Result of `grid_search` over t covariance types and c numbers of components.

    Attributes:
        fit: the fit with the lowest score.
        type_index: which of `covariance_types` it has.
        scores: by criterion the lowest score over the restarts in each cell of the grid, in nats; infinite where every
            restart failed.
        covariance_types: the types that were tried.
        components: the numbers of components that were tried.
    """

    fit: Fit
    type_index: Int[Array, ""]
    scores: dict[Criterion, Float[Array, "t c"]]
    covariance_types: tuple[CovarianceType, ...] = eqx.field(static=True)
    components: tuple[int, ...] = eqx.field(static=True)

    @property
    def covariance_type(self) -> CovarianceType:
        """The covariance type of the fit; on the host."""
        return self.covariance_types[int(self.type_index)]


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
    throw: bool = True,
) -> GridSearch:
    """Plain EM for every number of components and covariance type; the lowest score by the criterion wins.

    A host function on concrete arrays and a pure one on traced arrays, as `fit_mixture` is.

    Args:
        points: coordinates [n, d].
        key: random key of the starts.
        mass: how many observations each point stands for [n]; default 1 each.
        components: the numbers of components to try.
        covariance_types: the covariance types to try; `settings.covariance_type` is not used.
        criterion: "mdl" (2.13), "bic" (2.14) or "aic" (2.15).
        restarts: random starts for each; the lowest score counts.
        settings: tolerance and max_steps of EM.
        precision: "float64" or "float32", of the computation on the host path.
        throw: raise if no cell of the grid has a finite score; else look at `fit.result`.

    Raises:
        InputError: points that cannot be fitted (see `fit_mixture`), an empty grid, an unknown criterion or type.
        ComputationError: no cell of the grid gave a finite score, and `throw`.
    """
    check_static(restarts=restarts, components=components)
    check_choice("precision", precision, get_args(Precision))
    _check_grid(components, covariance_types, criterion, restarts)
    traced = is_traced(points, mass, key)
    weighted = traced_points(points, mass) if traced else checked_points(points, mass)
    if max(components) > len(weighted.mass):
        raise InputError(f"components up to {max(components)} are more than the points, {len(weighted.mass)}")
    frame = Standardisation.of(weighted)
    fits_of_type = functools.partial(_mapped_fits, restarts=restarts, settings=settings)
    if not traced:
        fits_of_type = functools.partial(_host_fits, restarts=restarts, settings=settings, precision=precision)
    fits = [fits_of_type(frame.enter(weighted), key, components, name) for name in covariance_types]
    if traced:
        return _selected(fits, frame, weighted, components, covariance_types, criterion)
    with jax.enable_x64(True):
        search = to_numpy(_selected(fits, frame, weighted, components, covariance_types, criterion))
    if throw and not np.isfinite(search.scores[criterion]).any():
        raise ComputationError(f"no mixture of the grid has a finite score; {NOT_FINITE}")
    return search


def _check_grid(components: Sequence[int], covariance_types: Sequence[str], criterion: str, restarts: int) -> None:
    check_choice("criterion", criterion, CRITERIA)
    for covariance_type in covariance_types:
        check_choice("covariance_types", covariance_type, COVARIANCE_TYPES)
    if not covariance_types:
        raise InputError(f"covariance_types is empty; choose from {', '.join(COVARIANCE_TYPES)}")
    if not components or min(components) < 1:
        raise InputError(f"components={list(components)} must be numbers of components, 1 or more")
    if restarts < 1:
        raise InputError(f"restarts={restarts} must be at least 1")


def _host_fits(
    points: WeightedPoints,
    key: PRNGKeyArray,
    components: Sequence[int],
    covariance_type: CovarianceType,
    *,
    restarts: int,
    settings: FitSettings,
    precision: Precision,
) -> Fit:
    """All fits of one covariance type along one leading axis, number by number and restart by restart."""
    per_number = []
    arguments = [(key, points.padded()) for key in jax.random.split(key, restarts)]
    for count in components:

        def fit_one(key: PRNGKeyArray, points: WeightedPoints, count: int = count) -> Fit:
            return _fit_fixed(points, key, count, max(components), covariance_type, settings)

        per_number.append(map_on_cores(fit_one, arguments, precision))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *per_number)


def _mapped_fits(
    points: WeightedPoints,
    key: PRNGKeyArray,
    components: Sequence[int],
    covariance_type: CovarianceType,
    *,
    restarts: int,
    settings: FitSettings,
) -> Fit:
    """Trace the fits of `_host_fits`."""

    def fit_one(count: JaxArray, key: PRNGKeyArray) -> Fit:
        return _fit_fixed(points, key, count, max(components), covariance_type, settings)

    over_restarts = jax.vmap(fit_one, in_axes=(None, 0))
    fits = jax.vmap(over_restarts, in_axes=(0, None))(
        jnp.asarray(components, jnp.int32), jax.random.split(key, restarts)
    )
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), fits)


def _selected(
    fits: Sequence[Fit],
    frame: Standardisation,
    points: WeightedPoints,
    components: Sequence[int],
    covariance_types: Sequence[CovarianceType],
    criterion: Criterion,
) -> GridSearch:
    """Scores all fits, of each covariance type, in the unit of the points, and picks the lowest."""
    observations = points.mass.sum()
    left = [jax.vmap(frame.leave_fit, in_axes=(0, None))(of_type, observations) for of_type in fits]
    scores = {
        name: jnp.stack(
            [_scores(name, of_type, observations, kind) for of_type, kind in zip(left, covariance_types, strict=True)]
        )
        for name in CRITERIA
    }
    best = jnp.argmin(scores[criterion])
    together = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *left)
    cells = (len(covariance_types), len(components), -1)
    return GridSearch(
        fit=jax.tree.map(lambda leaf: leaf[best], together),
        type_index=best // scores[criterion].shape[1],
        scores={name: score.reshape(cells).min(axis=2) for name, score in scores.items()},
        covariance_types=tuple(covariance_types),
        components=tuple(components),
    )


def _scores(
    criterion: Criterion, fits: Fit, observations: Scalar, covariance_type: CovarianceType
) -> Float[Array, " fits"]:
    def score(fit: Fit) -> JaxArray:
        return criterion_score(criterion, fit.mixture, fit.log_likelihood, observations, covariance_type)

    return jnp.where(failed(fits.result), jnp.inf, jax.vmap(score)(fits))


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
    live = seeded.live & (jnp.arange(slots, dtype=jnp.int32) < count)
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
    parameters = parameters_per_component(points.points.shape[1], covariance_type)
    valid = is_usable(points, points.mass, prior, parameters)
    result = FitStatus.where(valid, result, FitStatus.invalid_input)
    length = message_length(end.mixture, end.log_likelihood, jnp.sum(points.mass), covariance_type)
    fit = Fit(end.mixture, length, end.log_likelihood, end.steps, result, bits_of(length), jnp.zeros_like(length))
    return without_derivatives(fit, points, NO_DERIVATIVES)
