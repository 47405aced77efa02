"""The compiled kernels of one checkout, in a process that stays: started by `kernels`, with that checkout on the path.

It imports nothing of the tests, so that the package may be of any age. A line on the standard input is the name of a
task; a line of JSON on the standard output is the seconds that it took. The first one says where the package is.
"""

import importlib
import inspect
import json
import sys
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

import gmmjax
from gmmjax import native
from gmmjax.mixtures import FeatureChunks, GaussianMixture, WeightedPoints
from gmmjax.mixtures.quadratic import coefficients


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    if not native.available():
        raise SystemExit("its kernels were not compiled, or are switched off")
    print(json.dumps(inspect.getfile(gmmjax)), flush=True)
    made: dict[str, Callable[[], object]] = {}
    for line in sys.stdin:
        name = line.rstrip("\n")
        if name not in made:
            made[name] = TASKS[name]()
        wall, cpu = time.perf_counter(), time.process_time()
        jax.block_until_ready(made[name]())
        taken = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
        print(json.dumps(taken), flush=True)


def e_step(dtype: str) -> Callable[[], object]:
    """The sums of one E-step of 25 components over 100,000 points."""
    random = np.random.default_rng(0)
    weights, means = random.uniform(0.1, 1, 25), random.standard_normal((25, 3))
    roots = 0.4 * random.standard_normal((25, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.02 * np.eye(3)
    arrays = [jnp.asarray(own, dtype) for own in (weights / weights.sum(), means, covariances)]
    points = random.standard_normal((100_000, 3)).astype(dtype)
    chunks = FeatureChunks.of(WeightedPoints(points, np.ones(len(points), dtype)))
    parameters = coefficients(GaussianMixture.masked(*arrays, jnp.ones(25, bool)))
    module = importlib.import_module("gmmjax.mixtures.expectation_maximisation")
    sums = jax.jit(module.feature_sums)
    return lambda: sums(parameters, chunks)


def transport(components: int) -> Callable[[], object]:
    """The exact transport of 500 pairs of mixtures."""
    random = np.random.default_rng(0)
    masses = [random.dirichlet(np.ones(components), 500) for _ in range(2)]
    costs = random.uniform(0, 3, (500, components, components))
    module = importlib.import_module("gmmjax.transport")
    solve = jax.jit(jax.vmap(module.exact_transport))
    return lambda: solve(*masses, costs).cost


def cylinders() -> Callable[[], object]:
    """The points in 50,000 cylinders, of which each holds about 150 of 500,000."""
    random, spacing = np.random.default_rng(0), 1 / np.sqrt(500_000)
    points = np.column_stack([random.uniform(0, 1, (500_000, 2)), random.normal(0, 3 * spacing, 500_000)])
    kernels = native.host_kernels()
    packed, count = kernels.packed_points(points), 50_000
    centres, axes = points[random.choice(len(points), count)], np.tile([0.0, 0.0, 1.0], (count, 1))
    radii, lengths = np.full(count, 7.0 * spacing), np.full(count, 10.5 * spacing)
    found, mean, variance = np.zeros(count, np.int64), np.zeros(count), np.zeros(count)
    return lambda: kernels.projections(packed, centres, axes, radii, lengths, found, mean, variance)


TASKS = {
    "E-step, float64": lambda: e_step("float64"),
    "E-step, float32": lambda: e_step("float32"),
    "exact transport, K = 10": lambda: transport(10),
    "exact transport, K = 25": lambda: transport(25),
    "exact transport, K = 50": lambda: transport(50),
    "points in cylinders": cylinders,
}

if __name__ == "__main__":
    main()
