"""Clouds and mixtures that the tests of the mixtures share: few shapes, so that few programs compile."""

import numpy as np
import scipy.stats

from gmmjax.mixtures import GaussianMixture, WeightedPoints


def cloud(dimension=3, components=4, points=150, seed=0, spread=3.0):
    """Points [components * points, dimension] from random Gaussians, about the origin and of order 1."""
    random = np.random.default_rng(seed)
    parts = []
    for _ in range(components):
        factor = random.normal(size=(dimension, dimension)) * 0.3 + 0.2 * np.eye(dimension)
        parts.append(random.uniform(-spread, spread, dimension) + random.normal(size=(points, dimension)) @ factor.T)
    together = np.concatenate(parts)
    return (together - together.mean(axis=0)) / together.std()


def weighted(points, mass=None):
    return WeightedPoints(points, np.ones(len(points)) if mass is None else np.asarray(mass, float))


def start(points, components=6, seed=0, slots=None):
    """A mixture at random points of the cloud with the covariance (2.17); further slots are dead."""
    random = np.random.default_rng(seed)
    dimension = points.shape[1]
    means = points[random.choice(len(points), components, replace=False)]
    covariances = np.tile(points.var(axis=0).mean() / 10 * np.eye(dimension), (components, 1, 1))
    return pad(
        GaussianMixture(np.full(components, 1 / components), means, covariances, np.ones(components, bool)), slots
    )


def random_mixture(components=4, dimension=3, seed=0, slots=None):
    random = np.random.default_rng(seed)
    factors = random.normal(size=(components, dimension, dimension)) * 0.4 + np.eye(dimension)
    return pad(
        GaussianMixture(
            random.dirichlet(np.full(components, 3.0)),
            random.uniform(-2, 2, (components, dimension)),
            factors @ factors.transpose(0, 2, 1),
            np.ones(components, bool),
        ),
        slots,
    )


def pad(mixture, slots):
    """The same mixture with dead slots at the end."""
    extra = 0 if slots is None else slots - len(mixture.weights)
    identity = np.tile(np.eye(mixture.dimension), (extra, 1, 1))
    return GaussianMixture(
        np.concatenate([mixture.weights, np.zeros(extra)]),
        np.concatenate([mixture.means, np.zeros((extra, mixture.dimension))]),
        np.concatenate([mixture.covariances, identity]),
        np.concatenate([mixture.live, np.zeros(extra, bool)]),
    )


def scipy_log_joint(mixture, points):
    """Columns log w_k N(x; mean_k, covariance_k) of the live components."""
    live = mixture.live_part()
    return np.stack(
        [
            np.log(weight) + scipy.stats.multivariate_normal(mean, covariance).logpdf(points)
            for weight, mean, covariance in zip(live.weights, live.means, live.covariances, strict=True)
        ],
        axis=1,
    )


def random_rotation(dimension=3, seed=0):
    return scipy.stats.special_ortho_group.rvs(dimension, random_state=seed)


def assert_mixtures_close(actual, expected, rtol=0.0, atol=1e-8):
    np.testing.assert_array_equal(actual.live, expected.live)
    for name in ("weights", "means", "covariances"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=rtol, atol=atol, err_msg=name)
