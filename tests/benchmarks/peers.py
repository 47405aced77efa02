"""What a user could pick instead, called as its documentation says."""

import jax
import jax.numpy as jnp
import numpy as np
import ot
from scipy.spatial.distance import cdist
from scipy.stats import multivariate_normal
from sklearn.mixture import GaussianMixture as SklearnMixture

from tests.benchmarks.clouds import as_mixture, noise_floor

# The tolerance of our fits, nats an observation: scikit-learn's bound is the same quantity.
TOLERANCE = 1e-5


def sklearn_grid(points, max_components):
    """scikit-learn's `GaussianMixture` for every K; the lowest BIC."""
    fits = [sklearn_fixed(points, k) for k in range(1, max_components + 1)]
    best = min(fits, key=lambda fit: fit.bic(points))
    return as_mixture(best.weights_, best.means_, best.covariances_)


def sklearn_fixed(points, components, seed=0):
    """One fit of scikit-learn's `GaussianMixture` with the number of components given."""
    settings = {"tol": TOLERANCE, "reg_covar": noise_floor(points) ** 2, "random_state": seed}
    return SklearnMixture(components, **settings).fit(points)


def gmmx_fit(points, components, max_steps=100, tolerance=TOLERANCE):
    """gmmx with the number of components given, from Gaussians at points of the cloud; it knows float32 only."""
    from gmmx import EMFitter, GaussianMixtureModelJax

    means, covariances, weights = random_start(points, components)
    with jax.enable_x64(False), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        start = GaussianMixtureModelJax.from_squeezed(means=means, covariances=covariances, weights=weights)
        fitter = EMFitter(max_iter=max_steps, tol=tolerance, reg_covar=noise_floor(points) ** 2)
        result = fitter.fit(x=jax.numpy.asarray(points, jax.numpy.float32), gmm=start)
        fitted = result.gmm
        return as_mixture(fitted.weights_numpy, fitted.means_numpy, fitted.covariances.values_numpy), int(result.n_iter)


def sklearn_steps(points, components, max_steps):
    """So many iterations of scikit-learn's EM, and how many it made."""
    means, covariances, weights = random_start(points, components)
    fit = SklearnMixture(
        components,
        tol=0.0,
        max_iter=max_steps,
        init_params="random_from_data",
        weights_init=weights,
        means_init=means,
        precisions_init=np.linalg.inv(covariances),
        random_state=0,
    ).fit(points)
    return fit.n_iter_


def random_start(points, components):
    """Means at distinct points, one spherical covariance, equal weights."""
    chosen = np.random.default_rng(0).choice(len(points), components, replace=False)
    covariance = points.var(axis=0).mean() / 10 * np.eye(points.shape[1])
    return points[chosen], np.tile(covariance, (components, 1, 1)), np.full(components, 1 / components)


def pot_distance(before, after, costs=cdist):
    """The earth mover's distance of two (weights, means) by POT's network simplex; `costs` is SciPy's or `ot.dist`."""
    return ot.emd2(before[0], after[0], costs(before[1], after[1], metric="euclidean"))


def ott_distances(before, after, epsilon):
    """Entropic distances of two stacks of mixtures by ott-jax, in float64: from NumPy arrays to NumPy arrays."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        return np.asarray(_ott_distances(before, after, epsilon))


@jax.jit
def _ott_distances(before, after, epsilon):
    return jax.vmap(_ott_distance, (0, 0, None))(before, after, epsilon)


def _ott_distance(before, after, epsilon):
    from ott.geometry import geometry
    from ott.problems.linear import linear_problem
    from ott.solvers.linear.sinkhorn import Sinkhorn

    cost = jnp.linalg.norm(before.means[:, None] - after.means[None], axis=-1)
    problem = linear_problem.LinearProblem(geometry.Geometry(cost, epsilon=epsilon), before.weights, after.weights)
    # The share of the mass in the wrong place that our solver has to reach, too.
    solved = Sinkhorn(threshold=1e-6, max_iterations=20_000)(problem)
    return jnp.sum(solved.matrix * cost)


def live_pairs(before, after):
    """The live weights and means of every pair in two stacks of mixtures."""
    stacks = []
    for stack in (before, after):
        parts = zip(stack.weights, stack.means, stack.live, strict=True)
        stacks.append([(weights[live], means[live]) for weights, means, live in parts])
    return list(zip(*stacks, strict=True))


def pot_greedy(before, after):
    """Algorithm 1 for both kinds on POT, as `remove_changed` does it: the numbers that were removed."""
    kept = [np.arange(len(before[0])), np.arange(len(after[0]))]
    cost = cdist(before[1], after[1])

    def distance(rows, columns):
        masses = before[0][rows], after[0][columns]
        return ot.emd2(masses[0] / masses[0].sum(), masses[1] / masses[1].sum(), cost[np.ix_(rows, columns)])

    emd = distance(*kept)
    while True:
        trials = [
            [np.delete(part, index) if side == other else part for other, part in enumerate(kept)]
            for side in (0, 1)
            if len(kept[side]) > 1
            for index in range(len(kept[side]))
        ]
        distances = [distance(*trial) for trial in trials]
        if not distances or min(distances) >= emd - 1e-9 * cost.max():
            return tuple(
                np.setdiff1d(np.arange(len(side[0])), part) for side, part in zip((before, after), kept, strict=True)
            )
        emd, kept = min(distances), trials[int(np.argmin(distances))]


def thesis_detection(before, after, max_components, fit):
    """The thesis's algorithm, run once: a fit of each cloud, Algorithm 1 on POT, the changed points of each."""
    fits = [fit(points, max_components) for points in (before, after)]
    removed = pot_greedy(*((fit.weights, fit.means) for fit in fits))
    return [
        np.isin(most_probable(fit, points), gone)
        for fit, points, gone in zip(fits, (before, after), removed, strict=True)
    ]


def most_probable(mixture, points):
    """The component of each point."""
    components = zip(mixture.weights, mixture.means, mixture.covariances, strict=True)
    joint = [np.log(weight) + multivariate_normal(*shape).logpdf(points) for weight, *shape in components]
    return np.argmax(joint, axis=0)
