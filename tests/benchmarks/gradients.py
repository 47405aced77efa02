"""What gradients of fits by their prior cost: `python -m tests.benchmarks.gradients --page docs/benchmarks.md`.

The gradient is by all leaves of the prior together, in float64, with the fit and its polish. Unrolled is reverse mode
through as many steps of EM, on the components that won. Memory is what the compiled programs say that they need.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gmmjax import FitSettings, Prior, fit_mixture
from gmmjax.mixtures import FeatureChunks, WeightedPoints, expectation, fit_by_annihilation, initial_mixture
from gmmjax.mixtures.expectation_maximisation import m_step, waiting_weights
from gmmjax.scenes import random_scene
from tests.benchmarks.clouds import GAUSSIANS, RELATIVE_NOISE_FLOOR, gaussian_cloud, noise_floor
from tests.benchmarks.fits import MAX_COMPONENTS
from tests.benchmarks.harness import interleaved, seconds, tabulate

COLUMNS = ("what", "this", "beside", "ratio", "load")


def main() -> None:
    scenes = ("apart", "overlapping")
    tabulate(__doc__, "gradients", COLUMNS, {scene: functools.partial(measured, scene) for scene in scenes})


def measured(scene: str, quick: bool) -> dict[str, Any]:
    """The rows of eight Gaussians that lie apart, or overlap."""
    size, most, repeats = (500, 6, 1) if quick else (20_000, MAX_COMPONENTS, 5)
    points = gaussian_cloud(size)
    if scene == "apart":
        points = random_scene(jax.random.key(0), start=GAUSSIANS, appeared=0, points=size // GAUSSIANS).before
    fit, gradient = fit_and_gradient(points, most)
    ways = Contenders(points, most)
    few, many = (5, 20) if quick else (50, 800)
    timings = interleaved(
        {
            "fit": fit,
            "gradient": gradient,
            "implicit": ways.gradient("implicit", 5000),
            "unrolled": ways.gradient("unrolled", ways.steps),
        },
        repeats,
    )
    cpu = {name: timing.cpu for name, timing in timings.items()}
    rows = [
        [f"fit and gradient, fit alone, {len(points):,} points, {scene}", cpu["gradient"], cpu["fit"]],
        [f"implicit, unrolled over {ways.steps} steps, {scene}", cpu["implicit"], cpu["unrolled"]],
    ]
    times = [[what, seconds(own), seconds(other), f"{own / other:.2g}"] for what, own, other in rows]
    for kind in ("implicit", "unrolled"):
        less, more = (ways.memory(kind, steps) / 1e6 for steps in (few, many))
        what = f"memory, {kind}, {many} steps, {few} steps, {scene}"
        times.append([what, f"{more:.3g} MB", f"{less:.3g} MB", f"{more / less:.2g}"])
    return {"rows": times}


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
            weights = waiting_weights(moments.mass, mixture.live, prior)
            return m_step(moments, weights, prior, "full")[0], None

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


if __name__ == "__main__":
    main()
