"""How many Gaussians, and which: one cloud on the host, then many random starts at once inside `jit` and `vmap`."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from gmmjax import FitStatus, fit_mixture

MEANS = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 1.0]])


def cloud(points: int = 300) -> np.ndarray:
    """Three Gaussians of the same size."""
    random = np.random.default_rng(0)
    return np.concatenate([mean + 0.4 * random.normal(size=(points, 3)) for mean in MEANS])


def on_the_host(points: np.ndarray, plot: Path | None) -> None:
    """In float64, the restarts shared out over the cores; the shortest message length wins."""
    fit = fit_mixture(points, key=jax.random.key(0), max_components=10, restarts=4)
    mixture = fit.mixture.live_part()
    print(f"{len(mixture.weights)} Gaussians, message length {fit.message_length:.1f} nats")
    for weight, mean in zip(mixture.weights, mixture.means, strict=True):
        print(f"  weight {weight:.2f}, mean {np.round(mean, 2).tolist()}")
    print("  labels of the first points:", np.asarray(mixture.labels(points[:5])).tolist())
    if plot:
        from gmmjax.plotting import plot_mixture

        plot_mixture(mixture, points).figure.savefig(plot)


def many_starts_at_once(points: np.ndarray) -> None:
    """A pure function of its arrays, so that it can be compiled and mapped, here over random keys."""
    fit = jax.jit(jax.vmap(lambda key: fit_mixture(jnp.asarray(points, "float32"), key=key, max_components=10)))
    fits = fit(jax.random.split(jax.random.key(1), 6))
    print("Gaussians from six starts:", fits.mixture.count.tolist())
    print("converged:", np.asarray(fits.result == FitStatus.converged).tolist())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    points = cloud()
    on_the_host(points, options.plot)
    many_starts_at_once(points)
