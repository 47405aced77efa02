"""Calls of gmmjax that several benchmarks share; they can be sent to a worker."""

import jax
import numpy as np

from gmmjax import FitSettings, Prior, detect_changes, earth_movers_distance, fit_mixture
from gmmjax.clouds import voxel_grid, voxel_size_for
from gmmjax.comparison import remove_changed
from gmmjax.mixtures import fit_restarts
from tests.benchmarks.scenes import gaussian_cloud, hall_pair, noise_floor
from tests.benchmarks.workers import forget_peak_memory, memory

MAX_COMPONENTS = 25
MAX_VOXELS = 4096


def fit(points, precision="float64", max_components=MAX_COMPONENTS, seed=0):
    """One fit from its own random start, with the noise floor that all fits of the benchmarks have."""
    prior = Prior.figueiredo_jain(3, noise_floor(points))
    key = jax.random.key(seed)
    return fit_mixture(points, key=key, max_components=max_components, prior=prior, precision=precision)


def steps(points, components, max_steps, precision="float64"):
    """So many EM steps on a fixed number of components; returns how many were made."""
    settings = FitSettings(min_components=components, tolerance=0.0, max_steps=max_steps)
    key = jax.random.key(0)
    fitted = fit_mixture(points, key=key, max_components=components, settings=settings, precision=precision)
    return int(fitted.steps)


def restarts(points, number, seed=0):
    """All restarts of one call."""
    prior = Prior.figueiredo_jain(3, noise_floor(points))
    return fit_restarts(points, key=jax.random.key(seed), max_components=MAX_COMPONENTS, prior=prior, restarts=number)


def single_fits(points, number):
    """As many fits of one start each, one call after the other."""
    return [restarts(points, 1, seed) for seed in range(number)]


def fit_voxels(points):
    """The voxels, and the fit of their means with their numbers of points as masses."""
    size = voxel_size_for(points, MAX_VOXELS)
    grid = voxel_grid(points, size)
    return fit_mixture(
        grid.points,
        key=jax.random.key(0),
        mass=grid.mass,
        scatter=grid.scatter(points),
        max_components=MAX_COMPONENTS,
        prior=Prior.figueiredo_jain(3, noise_floor(points)),
    )


def peak_memory(size, precision, max_steps):
    """The peak of a fit's memory over what the process holds before it, data included, and the data's own; bytes."""
    points = gaussian_cloud(size)
    forget_peak_memory()
    before = memory("VmRSS")
    settings = FitSettings(max_steps=max_steps)
    fit_mixture(points, key=jax.random.key(0), settings=settings, precision=precision)
    return memory("VmHWM") - before, points.nbytes


def detection_memory(size):
    """The peak of a detection's memory over what the process holds before it, data included; bytes."""
    forget_peak_memory()
    before = memory("VmRSS")
    detect_changes(*hall_pair(size))
    return memory("VmHWM") - before


def batch_of_distances(before, after, solver, epsilon=None):
    """From NumPy arrays to NumPy arrays."""
    with jax.enable_x64(True):
        return np.asarray(_distances[solver](before, after, epsilon))


def single_distances(before, after):
    """The exact distances of the live parts, one call after the other."""
    return [float(earth_movers_distance(*pair).cost) for pair in zip(before, after, strict=True)]


# Compiled once for each solver; `Interleaved` clears what was compiled before it begins.
_distances = {
    solver: jax.jit(
        jax.vmap(
            lambda before, after, epsilon, solver=solver: (
                earth_movers_distance(before, after, solver=solver, epsilon=epsilon).cost
            ),
            (0, 0, None),
        )
    )
    for solver in ("exact", "sinkhorn")
}


_removals = jax.jit(jax.vmap(remove_changed))


def removals(before, after):
    """From NumPy arrays to NumPy arrays."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _removals(before, after))
