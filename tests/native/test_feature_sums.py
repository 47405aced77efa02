"""The kernel of the E-step against the same sums in plain JAX."""

import importlib
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import native
from gmmjax.mixtures import FeatureChunks, GaussianMixture, WeightedPoints
from gmmjax.mixtures.quadratic import coefficients
from tests.differences import along, assert_derivatives

expectation_maximisation = importlib.import_module("gmmjax.mixtures.expectation_maximisation")
needs_kernels = pytest.mark.skipif(not native.available(), reason="the kernels were not built")
plain = jax.jit(expectation_maximisation._plain_feature_sums)
native_sums = jax.jit(expectation_maximisation._feature_sums)
plain_tangent = jax.jit(expectation_maximisation._plain_moved_by_parameters)
native_tangent = jax.jit(expectation_maximisation._moved_by_parameters)
# Of sums that are all of one sign or of order 1.
TOLERANCE = {"float64": 1e-13, "float32": 2e-6}


def problem(size, components, dimension=3, dtype="float64", seed=0, spread=1.0):
    random = np.random.default_rng(seed)
    live = random.uniform(size=components) < 0.7
    live[0] = True
    weights = live * random.uniform(0.1, 1, components)
    roots = 0.4 * random.standard_normal((components, dimension, dimension))
    arrays = (
        weights / weights.sum(),
        spread * random.standard_normal((components, dimension)),
        roots @ roots.transpose(0, 2, 1) + 0.02 * np.eye(dimension),
    )
    points = WeightedPoints(
        random.standard_normal((size, dimension)).astype(dtype), random.uniform(0, 3, size).astype(dtype)
    )
    return arguments_of(*(array.astype(dtype) for array in arrays), live, points)


@jax.jit
def arguments_of(weights, means, covariances, live, points):
    """The coefficients of a mixture, and the features and masses of points."""
    chunks = FeatureChunks.of(points)
    return coefficients(GaussianMixture.masked(weights, means, covariances, live)), chunks.features, chunks.mass


def assert_close(actual, expected, dtype):
    for ours, theirs in zip(actual, expected, strict=True):
        scale = np.abs(theirs).max()
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=TOLERANCE[dtype] * scale)


@pytest.mark.slow
@needs_kernels
@pytest.mark.parametrize(
    ("size", "components", "dimension", "dtype"),
    [
        *((*shape, "float64") for shape in [(1, 1, 1), (200, 3, 2), (777, 25, 3), (2500, 81, 3), (500, 7, 6)]),
        *((*shape, "float32") for shape in [(1, 1, 1), (777, 25, 3), (2500, 81, 3), (5000, 25, 3)]),
    ],
)
def test_as_plain(size, components, dimension, dtype):
    with jax.enable_x64(True):
        arguments = problem(size, components, dimension, dtype)
        assert_close(native_sums(*arguments), plain(*arguments), dtype)
        moved = tangent_of(arguments[0])
        assert_close([native_tangent(*arguments, moved)], plain_tangent(*arguments, moved), dtype)


def tangent_of(parameters):
    return np.random.default_rng(7).standard_normal(parameters.shape).astype(parameters.dtype)


@needs_kernels
def test_as_plain_where_most_components_are_far():
    """Where a component is negligible at all points of a block, it is left out."""
    with jax.enable_x64(True):
        parameters, features, mass = problem(4000, 20, spread=30.0)
        assert_close(native_sums(parameters, features, mass), plain(parameters, features, mass), "float64")
        moved = tangent_of(parameters)
        tangents = native_tangent(parameters, features, mass, moved), *plain_tangent(parameters, features, mass, moved)
        assert_close(tangents[:1], tangents[1:], "float64")


@needs_kernels
def test_dead_components_get_nothing():
    with jax.enable_x64(True):
        parameters, features, mass = problem(300, 12)
        sums, _ = native_sums(parameters, features, mass)
        dead = np.asarray(parameters[:, 0]) < -1e29
        assert dead.any()
        assert not np.asarray(sums)[dead].any()


@needs_kernels
def test_stacks_share_what_is_not_stacked():
    """Restarts on one cloud, clouds for one mixture, and both in turn."""
    with jax.enable_x64(True):
        first, features, mass = problem(700, 6)
        second = problem(700, 6, seed=1)
        parameters, clouds = jnp.stack([first, second[0]]), jnp.stack([features, second[1]])
        of_restarts = jax.vmap(native_sums, (0, None, None))(parameters, features, mass)
        assert_close(of_restarts, jax.vmap(plain, (0, None, None))(parameters, features, mass), "float64")

        def each(function):
            return jax.vmap(jax.vmap(function, (None, 0, None)), (0, None, None))(parameters, clouds, mass)

        assert_close(each(native_sums), each(plain), "float64")


@needs_kernels
def test_what_is_not_a_number_stays_so():
    with jax.enable_x64(True):
        parameters, features, mass = problem(300, 5)
        _, log_likelihood = native_sums(parameters.at[0, 2].set(jnp.nan), features, mass)
        assert np.isnan(log_likelihood)


@needs_kernels
@pytest.mark.parametrize("shared", [("parameters",), ("features",), ("parameters", "features")])
def test_derivatives_of_stacks_that_share_arguments(shared):
    """By what all of a stack share: one gradient, the sum of theirs."""
    with jax.enable_x64(True):
        clouds = [problem(300, 5, seed=seed) for seed in range(2)]
        parameters = clouds[0][0] if "parameters" in shared else jnp.stack([own[0] for own in clouds])
        features = clouds[0][1] if "features" in shared else jnp.stack([own[1] for own in clouds])
        masses = jnp.stack([own[2] for own in clouds])
        axes = (None if "parameters" in shared else 0, None if "features" in shared else 0, 0)

        def loss(parameters, function):
            return jnp.sum(jnp.sin(jax.vmap(function, axes)(parameters, features, masses)[0] / 100))

        slope = jax.jit(jax.grad(loss), static_argnums=1)
        found, expected = (slope(parameters, function) for function in (native_sums, plain))
        assert_close([found], [expected], "float64")


def test_precisions_may_be_mixed():
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        parameters, features, mass = problem(300, 5)
        single = parameters.astype("float32")
        mixed = expectation_maximisation.feature_sums(single, FeatureChunks(features, mass, 3))
        assert mixed[0].dtype == np.float64
        assert_close(mixed, plain(single.astype("float64"), features, mass), "float64")


def test_derivatives_are_those_of_the_sums():
    """Against central differences, whichever code computes the sums."""
    with jax.enable_x64(True):
        parameters, features, mass = problem(300, 5, seed=3)
        live = np.asarray(parameters[:, :1]) > -1e29

        def likelihood(step):
            own = parameters + jnp.where(live, step, 0) * 0.1
            return expectation_maximisation._feature_sums(own, features, mass)[1]

        assert_derivatives(jax.grad(likelihood)(0.0), along(likelihood, 0.0, 1.0, 1e-3))


SCRIPT = """
import jax, numpy as np, gmmjax
points = np.random.default_rng(0).normal(size=(900, 3)) + 6 * np.random.default_rng(1).integers(0, 2, (900, 1))
for precision in ("float64", "float32"):
    fit = gmmjax.fit_mixture(points, key=jax.random.key(0), max_components=8, precision=precision)
    print(int(fit.mixture.count), float(fit.message_length))
print(gmmjax.native.available())
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "setting",
    [
        {"GMMJAX_NATIVE": "0"},
        pytest.param({"GMMJAX_INSTRUCTIONS": "baseline"}, marks=needs_kernels),
        pytest.param({"GMMJAX_INSTRUCTIONS": "avx2"}, marks=needs_kernels),
        pytest.param({}, marks=needs_kernels),
    ],
    ids=lambda setting: "-".join(setting.values()) or "widest",
)
def test_a_fit_is_the_same_with_every_instruction_set(setting):
    environment = {**os.environ, **setting}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True)
    double, single, available = done.stdout.splitlines()
    assert (available == "True") == ("GMMJAX_NATIVE" not in setting)
    for line, tolerance in ((double, 1e-6), (single, 0.05)):
        count, length = line.split()
        assert count == "2"
        assert float(length) == pytest.approx(EXPECTED, abs=tolerance)


# In nats: of the two Gaussians of the script, by every path.
EXPECTED = 4497.850099
