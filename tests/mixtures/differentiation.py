"""Scenes for the derivatives of fits that came to rest."""

import jax
import jax.numpy as jnp
import numpy as np

from gmmjax.mixtures import Prior, WeightedPoints, parameters_per_component
from tests.mixtures.examples import cloud, start

OUTLIERS, SIZE = 18, 400


def informative_prior(dimension):
    """A prior of which every leaf moves the fit; its leaves are float64 arrays."""
    prior = Prior(
        concentration=1 - parameters_per_component(dimension) / 2,
        noise_floor=0.05,
        scale=0.3,
        degrees_of_freedom=5.0,
        mean=np.linspace(-0.5, 0.5, dimension),
        mean_strength=2.0,
        tolerance=0.04,
        noise_share=0.05,
        noise_strength=20.0,
    )
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), prior)


def stray_scene(dimension, seed=0, *, spread=3.0, scatter=False):
    """Three Gaussians and stray points with masses, padding that lies far off, and a start of five with a dead slot."""
    random = np.random.default_rng(seed)
    gaussians = cloud(dimension, components=3, points=120, seed=seed, spread=spread)
    stray = random.uniform(gaussians.min(axis=0), gaussians.max(axis=0), (OUTLIERS, dimension))
    used = np.concatenate([gaussians, stray])
    padding = SIZE - len(used)
    points = WeightedPoints(
        jnp.asarray(np.concatenate([used, np.full((padding, dimension), 5.0)])),
        jnp.asarray(np.concatenate([random.uniform(0.5, 2, len(used)), np.zeros(padding)])),
        jnp.asarray(np.tile(0.01 * np.eye(dimension), (SIZE, 1, 1))) if scatter else None,
    )
    return points, jax.tree.map(jnp.asarray, start(used, 5, seed=seed, slots=6))


def statistic(*arrays):
    """A number that every entry moves, each with a weight of its own."""
    random = np.random.default_rng(1)
    weights = [jnp.asarray(random.standard_normal(array.shape), array.dtype) for array in arrays]
    return sum(jnp.sum(weight * array) for weight, array in zip(weights, arrays, strict=True))
