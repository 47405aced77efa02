"""Gradients of fits by their prior: implicit, and through the unrolled steps of EM; JIT-compiled, in float64."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from gmmjax import FitSettings, Prior, fit_mixture
from gmmjax.mixtures import FeatureChunks, WeightedPoints, expectation, fit_by_annihilation, initial_mixture
from gmmjax.mixtures.expectation_maximisation import frozen_maximisation
from tests.benchmarks.scenes import RELATIVE_NOISE_FLOOR, noise_floor


def prior_of(points):
    """Every leaf is an array, to be differentiated by, and every belief is felt."""
    spread = noise_floor(points) / RELATIVE_NOISE_FLOOR
    prior = Prior(
        concentration=-3.5,
        noise_floor=noise_floor(points),
        scale=0.3 * spread,
        degrees_of_freedom=5.0,
        mean=points.mean(axis=0),
        mean_strength=1.0,
        tolerance=noise_floor(points),
        noise_share=0.01,
        noise_strength=10.0,
    )
    with jax.enable_x64(True):
        return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), prior)


def fit_and_gradient(points, components):
    """The fit, and its message length with the gradient by the prior: two functions of nothing, compiled at first."""

    def length(prior, points):
        settings = FitSettings(polish=True)
        fit = fit_mixture(points, key=jax.random.key(0), max_components=components, prior=prior, settings=settings)
        return fit.message_length, (fit.steps, fit.mixture.count)

    return in_float64(jax.jit(length), points), in_float64(jax.jit(jax.value_and_grad(length, has_aux=True)), points)


def in_float64(function, points):
    """The function of prior and points, bound to these."""
    prior = prior_of(points)

    def call():
        with jax.enable_x64(True):
            return function(prior, jnp.asarray(points))

    return call


class Contenders:
    """Gradients of a number made of a fit: implicit ones, and through as many steps of EM as the fit made.

    The unrolled steps have it easier: they are given the components that won, from near their rest, and make no others.
    """

    def __init__(self, points, components):
        points = (points - points.mean(axis=0)) / points.std()
        with jax.enable_x64(True):
            self.prior = jax.tree.map(jnp.asarray, Prior(-3.5, RELATIVE_NOISE_FLOOR, 0.3, 5.0, np.zeros(3), 1.0))
            self.points = WeightedPoints(jnp.asarray(points), jnp.ones(len(points)))
            self.first = initial_mixture(self.points, components, self.prior, jax.random.key(0))
            fit = jax.jit(functools.partial(self._fit, settings=FitSettings()))(self.prior, self.points)
            self.mixture = jax.tree.map(jnp.asarray, fit.mixture.live_part())
            polished = jax.jit(functools.partial(self._fit, settings=FitSettings(polish=True)))
            self.steps = int(polished(self.prior, self.points).steps)

    def _fit(self, prior, points, settings):
        return fit_by_annihilation(points, self.first, prior, settings)

    def implicit(self, prior, points, steps=5000):
        """Of the polished fit from all components, the start's too; the polish has so many steps at the most."""
        return _number(self._fit(prior, points, FitSettings(polish=True, max_polish_steps=steps)).mixture)

    def unrolled(self, prior, points, steps):
        """Of the components that won after so many more steps of EM, of which reverse mode keeps the residuals."""
        chunks = FeatureChunks.of(points)

        def step(mixture, _):
            moments, _ = expectation(mixture, chunks)
            return frozen_maximisation(moments, mixture.live, prior), None

        return _number(jax.lax.scan(step, self.mixture, length=steps)[0])

    def gradient(self, kind, steps):
        """Of `implicit` or `unrolled`, a function of nothing that compiles at its first call."""
        function = self._jitted(kind, steps)

        def call():
            with jax.enable_x64(True):
                return function(self.prior, self.points)

        return call

    def memory(self, kind, steps):
        """Bytes that the compiled gradient needs beside its arguments and results."""
        with jax.enable_x64(True):
            compiled = self._jitted(kind, steps).lower(self.prior, self.points).compile()
        return compiled.memory_analysis().temp_size_in_bytes

    def _jitted(self, kind, steps):
        return jax.jit(jax.grad(functools.partial(getattr(self, kind), steps=steps)))


def _number(mixture):
    return jnp.sum(mixture.weights**2) + jnp.sum(mixture.means**2) + jnp.sum(mixture.covariances**2)
