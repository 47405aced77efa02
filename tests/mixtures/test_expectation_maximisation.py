import importlib
import itertools
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture as ScikitMixture

from gmmjax.mixtures import (
    COVARIANCE_TYPES,
    FeatureChunks,
    GaussianMixture,
    Prior,
    expectation,
    expectation_maximisation,
    maximisation,
)
from gmmjax.mixtures.expectation_maximisation import feature_sums
from gmmjax.mixtures.quadratic import coefficients
from tests.mixtures.examples import (
    assert_mixtures_close,
    cloud,
    pad,
    random_mixture,
    random_rotation,
    scipy_log_joint,
    start,
    weighted,
)

# `gmmjax.mixtures.expectation_maximisation` is the function.
em = importlib.import_module("gmmjax.mixtures.expectation_maximisation")
MAXIMUM_LIKELIHOOD = Prior.maximum_likelihood(0.0)
SCIKIT_TYPES = {"full": "full", "diagonal": "diag", "spherical": "spherical", "tied": "tied"}


@jax.jit
def step(mixture, points):
    moments, log_likelihood = expectation(mixture, FeatureChunks.of(points))
    return maximisation(moments, MAXIMUM_LIKELIHOOD), log_likelihood


def scikit(points, first, covariance_type, steps):
    """scikit-learn's mixture after some EM steps from the same start."""
    precisions = np.linalg.inv(first.covariances)
    precisions = {
        "full": precisions,
        "diagonal": np.diagonal(precisions, axis1=1, axis2=2),
        "spherical": precisions[:, 0, 0],
        "tied": precisions[0],
    }[covariance_type]
    peer = ScikitMixture(
        len(first.weights),
        covariance_type=SCIKIT_TYPES[covariance_type],
        reg_covar=0,
        tol=0,
        max_iter=steps,
        weights_init=first.weights,
        means_init=first.means,
        precisions_init=precisions,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return peer.fit(points)


def as_full(covariances, covariance_type, components, dimension):
    match covariance_type:
        case "full":
            return covariances
        case "diagonal":
            return np.einsum("ki,ij->kij", covariances, np.eye(dimension))
        case "spherical":
            return covariances[:, None, None] * np.eye(dimension)
        case "tied":
            return np.tile(covariances, (components, 1, 1))


@pytest.mark.parametrize("covariance_type", COVARIANCE_TYPES)
def test_equals_scikit_learn_from_the_same_start(float64, covariance_type):
    points = cloud()
    first = start(points, 5)
    peer = scikit(points, first, covariance_type, steps=30)
    ours = expectation_maximisation(
        weighted(points),
        pad(first, 8),
        MAXIMUM_LIKELIHOOD,
        covariance_type=covariance_type,
        tolerance=0.0,
        max_steps=30,
    )
    expected = as_full(peer.covariances_, covariance_type, 5, 3)
    np.testing.assert_allclose(ours.mixture.weights[:5], peer.weights_, rtol=1e-7)
    np.testing.assert_allclose(ours.mixture.means[:5], peer.means_, atol=1e-7)
    np.testing.assert_allclose(ours.mixture.covariances[:5], expected, atol=1e-7)
    np.testing.assert_allclose(ours.log_likelihood, peer.score(points) * len(points), rtol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3, 6])
def test_step_equals_direct_formulas(float64, dimension):
    """Equations (2.6) to (2.11), evaluated with SciPy's densities; 2,400 points are several chunks."""
    points, mixture = cloud(dimension, points=600), random_mixture(dimension=dimension)
    mass = np.random.default_rng(1).uniform(0.5, 3, len(points))
    log_joint = scipy_log_joint(mixture, points)
    log_density = np.logaddexp.reduce(log_joint, axis=1)
    responsibilities = mass[:, None] * np.exp(log_joint - log_density[:, None])
    support = responsibilities.sum(axis=0)
    means = responsibilities.T @ points / support[:, None]
    covariances = [np.cov(points.T, aweights=responsibilities[:, k], bias=True) for k in range(len(mixture.weights))]
    updated, log_likelihood = step(mixture, weighted(points, mass))
    np.testing.assert_allclose(log_likelihood, mass @ log_density, rtol=1e-10)
    expected = GaussianMixture(support / mass.sum(), means, np.array(covariances), mixture.live)
    assert_mixtures_close(updated, expected, atol=1e-9)


def test_where_all_components_die_no_slot_is_left_and_all_is_finite(float64):
    @jax.jit
    def updated(mixture, points):
        return maximisation(expectation(mixture, FeatureChunks.of(points))[0], Prior(-1e3, 0.0))

    left = updated(random_mixture(), weighted(cloud(points=50)))
    assert not np.asarray(left.live).any()
    assert_mixtures_close(
        left, GaussianMixture(np.zeros(4), np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)), left.live)
    )


@given(seed=st.integers(0, 10**6), padding=st.integers(1, 40))
def test_padding_changes_nothing(seed, padding):
    with jax.enable_x64(True):
        points, mixture = cloud(seed=seed, points=50), random_mixture(seed=seed)
        bare, log_likelihood = step(mixture, weighted(points))
        far = np.full((40, 3), 1e3)
        far[: padding - 1] = -5.0
        padded_points = np.concatenate([points, far])
        padded, padded_log_likelihood = step(
            pad(mixture, 6), weighted(padded_points, np.r_[np.ones(len(points)), np.zeros(40)])
        )
        assert_mixtures_close(padded, pad(bare, 6), atol=1e-9)
        np.testing.assert_allclose(padded_log_likelihood, log_likelihood, rtol=1e-10)


@given(seed=st.integers(0, 10**6))
def test_permuting_points_or_components_changes_nothing_else(seed):
    with jax.enable_x64(True):
        points, mixture = cloud(seed=seed, points=50), random_mixture(seed=seed)
        random = np.random.default_rng(seed)
        updated, _ = step(mixture, weighted(points))
        of_permuted_points, _ = step(mixture, weighted(random.permutation(points)))
        assert_mixtures_close(of_permuted_points, updated, atol=1e-9)
        order = random.permutation(4)
        permuted, _ = step(jax.tree.map(lambda leaf: leaf[order], mixture), weighted(points))
        assert_mixtures_close(permuted, jax.tree.map(lambda leaf: leaf[order], updated), atol=1e-9)


@given(seed=st.integers(0, 10**6))
def test_a_rigid_motion_moves_the_step(seed):
    with jax.enable_x64(True):
        points, mixture, rotation = cloud(seed=seed, points=50), random_mixture(seed=seed), random_rotation(seed=seed)
        shift = np.array([0.5, -1.0, 2.0])

        def moved(mixture):
            covariances = rotation @ mixture.covariances @ rotation.T
            means = mixture.means @ rotation.T + shift[None]
            return GaussianMixture(mixture.weights, means, covariances, mixture.live)

        updated, _ = step(mixture, weighted(points))
        of_moved, _ = step(moved(mixture), weighted(points @ rotation.T + shift))
        assert_mixtures_close(of_moved, moved(updated), atol=1e-8)


def test_mass_two_is_the_point_twice(float64):
    points, mixture = cloud(points=50), random_mixture()
    mass = np.random.default_rng(0).integers(1, 4, len(points))
    repeated, log_likelihood = step(mixture, weighted(np.repeat(points, mass, axis=0)))
    by_mass, mass_log_likelihood = step(mixture, weighted(points, mass))
    assert_mixtures_close(by_mass, repeated, atol=1e-10)
    np.testing.assert_allclose(mass_log_likelihood, log_likelihood, rtol=1e-12)


def test_float32_is_close_to_float64():
    points, mixture = cloud(), random_mixture()
    single, _ = step(mixture, weighted(points))
    with jax.enable_x64(True):
        double, _ = step(mixture, weighted(points))
    assert single.means.dtype == np.float32
    assert_mixtures_close(single, double, atol=5e-4)


def test_vmap_equals_a_loop(float64):
    clouds = [weighted(cloud(seed=seed, points=50)) for seed in range(3)]
    mixture = random_mixture()
    batch, _ = jax.vmap(step, in_axes=(None, 0))(mixture, jax.tree.map(lambda *leaves: np.stack(leaves), *clouds))
    for index, each in enumerate(clouds):
        single, _ = step(mixture, each)
        assert_mixtures_close(jax.tree.map(lambda leaf, i=index: leaf[i], batch), single, atol=1e-10)


def sums_and_plain(moved):
    """`feature_sums` and its plain definition as functions of the arrays that move, and these with tangents of theirs.

    Two chunks, with a dead slot and masses.
    """
    random = np.random.default_rng(2)
    points = cloud(2, points=150)
    chunks = FeatureChunks.of(weighted(points, random.uniform(0.5, 2, len(points))))
    arrays = {
        "parameters": coefficients(jax.tree.map(jnp.asarray, random_mixture(dimension=2, slots=5))),
        "features": chunks.features,
        "mass": chunks.mass,
    }
    primals = [arrays[name] for name in moved]
    tangents = [jnp.asarray(random.standard_normal(primal.shape)) for primal in primals]

    def complete(own):
        return {**arrays, **dict(zip(moved, own, strict=True))}

    def ours(*own):
        every = complete(own)
        return feature_sums(every["parameters"], FeatureChunks(every["features"], every["mass"], 2))

    return ours, lambda *own: em._plain_feature_sums(*complete(own).values()), primals, tangents


COMBINATIONS = [
    moved for size in (1, 2, 3) for moved in itertools.combinations(("parameters", "features", "mass"), size)
]


@pytest.mark.slow
@pytest.mark.parametrize("moved", COMBINATIONS, ids="-".join)
def test_derivatives_of_the_sums_are_those_of_plain_jax(float64, moved):
    """Forward and in reverse, for every choice of what moves."""
    ours, plain, primals, tangents = sums_and_plain(moved)

    @jax.jit
    def both(function_primals, function_tangents):
        forward = [jax.jvp(function, function_primals, function_tangents) for function in (ours, plain)]
        cotangent = forward[1][1]
        return forward, [jax.vjp(function, *function_primals)[1](cotangent) for function in (ours, plain)]

    (own, expected), (own_reverse, expected_reverse) = both(primals, tangents)
    for actual, wanted in zip(
        jax.tree.leaves((own, own_reverse)), jax.tree.leaves((expected, expected_reverse)), strict=True
    ):
        np.testing.assert_allclose(actual, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_second_derivatives_of_the_sums_are_those_of_plain_jax(float64):
    ours, plain, primals, tangents = sums_and_plain(("parameters", "mass"))

    def curvature(function):
        def size(*own):
            sums, log_likelihood = function(*own)
            return jnp.sum(jnp.sin(sums)) + log_likelihood

        return jax.jvp(jax.grad(size, argnums=(0, 1)), primals, tangents)[1]

    for actual, wanted in zip(*jax.jit(lambda: (curvature(ours), curvature(plain)))(), strict=True):
        np.testing.assert_allclose(actual, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
