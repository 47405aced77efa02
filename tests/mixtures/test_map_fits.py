"""Many clouds in one call: the same fits, on cores and on devices."""

import os
import subprocess
import sys

import jax
import numpy as np
import pytest

from gmmjax import InputError, fit_mixture
from gmmjax.mixtures import WeightedPoints, best_fit, fit_restarts, map_fits

SETTINGS = dict(max_components=6)


@pytest.fixture(scope="module")
def clouds():
    random = np.random.default_rng(0)
    return [
        random.normal(size=(size, 3)) * 0.3 + 3 * random.integers(0, 2, (size, 1)) + [10, 0, 0]
        for size in (240, 250, 380)
    ]


@pytest.fixture(scope="module")
def fits(clouds):
    return map_fits(clouds, key=jax.random.key(0), restarts=2, **SETTINGS)


@pytest.mark.slow
def test_fits_are_those_of_one_cloud_after_the_other(clouds, fits):
    for cloud, fit, key in zip(clouds, fits, jax.random.split(jax.random.key(0), 3), strict=True):
        alone = fit_restarts(cloud, key=key, restarts=2, **SETTINGS)
        jax.tree.map(np.testing.assert_array_equal, fit, alone)
        assert int(best_fit(fit).mixture.count) == 2


def test_masses_and_scatter_are_taken(clouds):
    cloud = WeightedPoints(clouds[0], np.full(240, 2.0), np.tile(0.01 * np.eye(3), (240, 1, 1)))
    (fit,) = map_fits([cloud], key=jax.random.key(0), **SETTINGS)
    key = jax.random.split(jax.random.key(0), 1)[0]
    alone = fit_restarts(clouds[0], mass=cloud.mass, scatter=cloud.scatter, key=key, restarts=1, **SETTINGS)
    np.testing.assert_array_equal(fit.mixture.means, alone.mixture.means)


def test_a_warm_start_needs_fewer_steps(clouds, fits):
    """The next scan of the same place, started from the fit of this one."""
    moved = clouds[2] + 0.01
    before = best_fit(fits[2])
    cold = fit_mixture(moved, key=jax.random.key(1), **SETTINGS)
    warm = fit_mixture(moved, key=jax.random.key(1), start=before.mixture)
    assert warm.steps < cold.steps / 2
    assert float(warm.message_length) == pytest.approx(float(cold.message_length), abs=0.1)
    (mapped,) = map_fits([moved], starts=[before.mixture], key=jax.random.key(1))
    np.testing.assert_array_equal(mapped.mixture.means[0], warm.mixture.means)
    traced = jax.jit(lambda points: fit_mixture(points, key=jax.random.key(1), start=before.mixture))
    with jax.enable_x64(True):
        assert float(traced(moved).message_length) == pytest.approx(float(warm.message_length), abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(clouds=[]), "clouds is empty"),
        (dict(clouds=[np.zeros((50, 3))]), r"clouds\[0\]: all points are equal"),
        (dict(restarts=0), "restarts=0 must be at least 1"),
        (dict(starts=[]), "starts has 0 mixtures for 1 clouds"),
    ],
)
def test_bad_input_is_named(clouds, change, message):
    with pytest.raises(InputError, match=message):
        map_fits(**{"clouds": clouds[:1], "key": jax.random.key(0), **change})


def test_starts_must_fit_together(clouds, fits):
    mixture = best_fit(fits[0]).mixture
    with pytest.raises(InputError, match="starts have 5 to 6 slots"):
        map_fits(clouds[:2], starts=[mixture, mixture.compacted(5)], key=jax.random.key(0))
    with pytest.raises(InputError, match="a start in 3 dimensions is for no points in 2"):
        fit_mixture(clouds[0][:, :2], start=mixture, key=jax.random.key(0))
    with pytest.raises(InputError, match="clouds have 2 to 3 dimensions"):
        map_fits([clouds[0], clouds[1][:, :2]], key=jax.random.key(0))


def test_a_start_has_no_restarts(clouds, fits):
    with pytest.raises(InputError, match="from a given start all fits are the same"):
        fit_mixture(clouds[0], key=jax.random.key(0), start=best_fit(fits[0]).mixture, restarts=2)


SCRIPT = """
import jax, numpy as np
from gmmjax.mixtures import map_fits
random = np.random.default_rng(0)
clouds = [random.normal(size=(size, 3)) + 6 * random.integers(0, 2, (size, 1)) for size in (200, 250, 300)]
told = []
settings = dict(key=jax.random.key(0), max_components=4, restarts=2, precision="float32")
ours = map_fits(clouds, devices=jax.devices(), progress=lambda: told.append(1), **settings)
cores = map_fits(clouds, **settings)
for one, other in zip(ours, cores):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-3), one, other)
print(len(jax.devices()), len(told), [fit.bits.tolist() for fit in ours])
"""


@pytest.mark.slow
def test_several_devices_share_the_fits():
    """Two host devices, and a stack of fits that does not divide by two for one of the padded sizes."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    environment = {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip() == "2 6 [[32, 32], [32, 32], [32, 32]]"
