"""The front door: one call fits a mixture and finds the number of its components."""

from typing import Literal, get_args

from jaxtyping import ArrayLike, PRNGKeyArray

from gmmjax._host import check_static
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures.annihilation import Fit, FitSettings
from gmmjax.mixtures.grid_search import grid_search
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.parallel import Precision
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.restarts import best_fit, fit_restarts

FitMethod = Literal["annihilation", "grid"]


def fit_mixture(
    points: ArrayLike,
    *,
    key: PRNGKeyArray,
    mass: ArrayLike | None = None,
    scatter: ArrayLike | None = None,
    max_components: int = 25,
    prior: Prior | None = None,
    restarts: int = 1,
    start: GaussianMixture | None = None,
    method: FitMethod = "annihilation",
    settings: FitSettings = FitSettings(),
    precision: Precision = "float64",
    throw: bool = True,
) -> Fit:
    """Fits a Gaussian mixture whose number of components is found from the points (FJ02; thesis 2.2.2).

    On concrete arrays this is a host function: it checks its input, computes in `precision` whatever JAX's setting,
    and returns NumPy arrays in float64. On traced arrays (inside `jit`, `vmap`, `grad`) it is a pure function in the
    dtype of the points, checks shapes only, and failure is `Fit.result`.

    Args:
        points: coordinates [n, d], in any unit.
        key: random key of the starts, `jax.random.key(seed)`.
        mass: how many observations each point stands for [n]; default 1 each. Mass 0 is padding.
        scatter: covariance of those observations about the point [n, d, d], such as `VoxelGrid.scatter`: with it the
            moments of the mixture are those of the observations, and the log likelihood is a lower bound of theirs (a
            point's observations share its responsibilities). Default none; not for the grid search.
        max_components: annihilation starts from this number of components (K_max).
        prior: belief about weights and noise; not used by the grid search. Default: `Prior.figueiredo_jain` with a
            noise floor of a thousandth of the points' spread: 1 mm for a scan of 2 m (5 mm in float32).
        restarts: fits from different random starts; the one with the shortest message length is returned
            (`fit_restarts` returns all).
        start: a mixture to start from in place of random seeds, such as the fit of an earlier scan of the same place:
            fewer steps, and components that keep their slots. Its slots are K_max; not for the grid search.
        method: "annihilation", or "grid" for the grid search over 1 to `max_components` and all covariance types by MDL
            (`grid_search` has the choices).
        settings: how EM runs.
        precision: "float64" or "float32", of the computation on the host path. In float32 every fit is scored again in
            float64, and one that float32 got wrong, such as that of thin planes, is computed again in float64:
            `Fit.bits` says which it was.
        throw: raise if no restart gave a finite result; else look at `Fit.result`.

    Returns:
        The fit, in the unit of the points.

    Raises:
        InputError: points or masses that are not finite, too few, all equal, or of the wrong shape; more components
            than points; a prior outside of its domain; an unknown method or precision.
        ComputationError: no restart gave a finite result, and `throw`.
    """
    check_static(max_components=max_components, restarts=restarts)
    check_choice("method", method, get_args(FitMethod))
    check_choice("precision", precision, get_args(Precision))
    if method == "grid":
        for name, given in (("scatter", scatter), ("start", start)):
            if given is not None:
                raise InputError(f"{name} is not for method='grid'; leave it out, or choose method='annihilation'")
        return grid_search(
            points,
            key=key,
            mass=mass,
            components=range(1, max_components + 1),
            restarts=restarts,
            settings=settings,
            precision=precision,
            throw=throw,
        ).fit
    fits = fit_restarts(
        points,
        key=key,
        mass=mass,
        scatter=scatter,
        max_components=max_components,
        prior=prior,
        restarts=restarts,
        start=start,
        settings=settings,
        precision=precision,
    )
    return best_fit(fits, throw=throw)
