"""Where fits come to rest, and the derivatives through it."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gmmjax import FitSettings, FitStatus, InputError, Prior, fit_mixture
from gmmjax.mixtures import WeightedPoints, expectation, fit_by_annihilation, polish
from gmmjax.mixtures.expectation_maximisation import FeatureChunks, m_step, waiting_weights
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.noise import log_uniform_density
from gmmjax.scenes import random_scene
from tests.differences import PRECISION, along, assert_derivatives, difference_gradient
from tests.mixtures.differentiation import informative_prior, statistic, stray_scene
from tests.mixtures.examples import assert_mixtures_close, pad, random_rotation, start, weighted

POLISHED = FitSettings(polish=True)


@functools.partial(jax.jit, static_argnames="settings")
def fit(points, first, prior, settings=POLISHED):
    return fit_by_annihilation(points, first, prior, settings)


@jax.jit
def step(mixture, points, prior, log_noise=None):
    """One more step of EM."""
    moments, log_likelihood = expectation(mixture, FeatureChunks.of(points), log_noise)
    weights = waiting_weights(moments.mass, mixture.live, prior)
    return m_step(moments, weights, prior, "full")[0], log_likelihood


def fit_statistic(prior, points, first, settings=POLISHED):
    """A number that all of a fit moves, and the fit."""
    fit = fit_by_annihilation(points, first, prior, settings)
    mixture = fit.mixture
    scores = fit.message_length / 100, fit.log_likelihood / 50, 3 * fit.noise_share
    return statistic(mixture.weights, mixture.means, mixture.covariances, *scores), fit


def front_door_statistic(prior, points, first):
    """The same by `fit_mixture`, in the unit of the points."""
    fit = fit_mixture(
        points.points,
        key=jax.random.key(0),
        mass=points.mass,
        scatter=points.scatter,
        prior=prior,
        start=first,
        settings=POLISHED,
    )
    mixture = fit.mixture
    scores = fit.message_length / 100, fit.log_likelihood / 50, 3 * fit.noise_share
    return statistic(mixture.weights, mixture.means, mixture.covariances, *scores), fit


gradient, front_door_gradient = (
    jax.jit(jax.value_and_grad(function, argnums=(0, 1), has_aux=True))
    for function in (fit_statistic, front_door_statistic)
)


def value(prior, points, first):
    return gradient(prior, points, first)[0][0]


def of_leaves(function, tree):
    """A function of a tree as one of the vector of its leaves, and that vector."""
    vector, unravel = ravel_pytree(tree)
    return lambda vector: function(unravel(vector)), vector


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "gradient"), [(2, gradient), (6, front_door_gradient)], ids=["2", "6"])
def test_gradients_of_prior_points_and_masses_equal_differences(float64, dimension, gradient):
    """Slots that died and one that never lived, padding, masses; in 6-D `fit_mixture`, with scatter of the points.

    Three dimensions are those of the joint mixture, in `tests/changes/test_joint_polish.py`.
    """
    points, first = stray_scene(dimension, seed=1, scatter=dimension == 6)
    prior = informative_prior(dimension)
    (_, end), (of_prior, of_points) = gradient(prior, points, first)
    assert end.result == FitStatus.converged
    assert 2 <= end.mixture.count < first.count
    by_prior, vector = of_leaves(lambda prior: gradient(prior, points, first)[0][0], prior)
    assert_derivatives(ravel_pytree(of_prior)[0], difference_gradient(by_prior, vector))
    used = np.asarray(points.mass) > 0
    assert not np.asarray(of_points.points)[~used].any()
    random = np.random.default_rng(dimension)
    by_points, vector = of_leaves(lambda points: gradient(prior, points, first)[0][0], points)
    for part in range(len(jax.tree.leaves(points))):
        directions = [np.zeros(leaf.shape) for leaf in jax.tree.leaves(points)]
        moved = random.standard_normal(directions[part].shape) * used.reshape(-1, *[1] * (directions[part].ndim - 1))
        directions[part] = moved + moved.swapaxes(1, 2) if moved.ndim == 3 else moved
        direction = ravel_pytree(jax.tree.map(jnp.asarray, directions))[0]
        expected = along(by_points, vector, direction, step=1e-4)
        assert_derivatives(ravel_pytree(of_points)[0] @ direction, expected)


def test_gradient_of_a_single_point_equals_differences(float64):
    """Of one within the cloud, and of the one that the noise component's box ends at."""
    (points, first), prior = stray_scene(2), informative_prior(2)
    _, (_, of_points) = gradient(prior, points, first)
    within, at_the_border = 7, int(jnp.argmax(points.points[:378, 0]))
    for index in (within, at_the_border):
        direction = jnp.zeros_like(points.points).at[index, 0].set(1.0)
        expected = along(
            lambda moved: value(prior, WeightedPoints(moved, points.mass), first), points.points, direction, 1e-3
        )
        assert_derivatives(of_points.points[index, 0], expected)


@pytest.mark.slow
def test_gradients_with_a_tied_covariance_equal_differences(float64):
    (points, first), prior = stray_scene(2), informative_prior(2)
    settings = FitSettings(polish=True, covariance_type="tied")
    tied = jax.jit(jax.value_and_grad(lambda prior: fit_statistic(prior, points, first, settings), has_aux=True))
    (_, end), of_prior = tied(prior)
    assert end.result == FitStatus.converged
    by_prior, vector = of_leaves(lambda prior: tied(prior)[0][0], prior)
    assert_derivatives(ravel_pytree(of_prior)[0], difference_gradient(by_prior, vector))


@pytest.mark.slow
def test_forward_and_second_derivatives_equal_differences(float64):
    """Of the statistic and of its gradient, along one direction in which all leaves of the prior move."""
    (points, first), prior = stray_scene(2), informative_prior(2)
    by_prior, vector = of_leaves(lambda prior: fit_statistic(prior, points, first)[0], prior)
    direction = 0.1 + jnp.abs(vector)
    both = jax.jit(lambda at: jax.jvp(jax.value_and_grad(by_prior), (at,), (direction,))[1])
    _, unravel = ravel_pytree(prior)

    def in_reverse(at):
        (value, _), (of_prior, _) = gradient(unravel(at), points, first)
        return jnp.concatenate([value[None], ravel_pytree(of_prior)[0]])

    expected = along(in_reverse, vector, direction, step=1e-3)
    first_order, second_order = both(vector)
    assert_derivatives(jnp.concatenate([first_order[None], second_order]), expected)


@pytest.fixture(scope="module")
def batch():
    """Derivatives of three lanes, of which the overlapping one, the second, was not given the steps that it needs."""
    with jax.enable_x64(True), pytest.MonkeyPatch.context() as patch:
        patch.setattr(polish, "MAX_ACCELERATED", 10)
        scenes = [stray_scene(2, seed=seed) for seed in (0, 1, 5)]
        prior = informative_prior(2)
        settings = FitSettings(polish=True, max_polish_steps=12)
        of_lane = jax.value_and_grad(fit_statistic, argnums=(0, 1), has_aux=True)
        lanes = jax.jit(jax.vmap(lambda points, first: of_lane(prior, points, first, settings)))
        yield scenes, prior, lanes(*jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes))


@pytest.mark.slow
def test_vmap_of_gradients_equals_a_loop(float64, batch):
    scenes, prior, (_, gradients) = batch
    for lane in (0, 2):
        _, expected = gradient(prior, *scenes[lane])
        own = jax.tree.map(lambda leaf, lane=lane: leaf[lane], gradients)
        for actual, wanted in zip(jax.tree.leaves(own), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(actual, wanted, rtol=0, atol=PRECISION * np.abs(wanted).max())


def test_a_lane_that_did_not_come_to_rest_has_a_status_and_no_derivatives(float64, batch):
    _, _, ((values, fits), gradients) = batch
    np.testing.assert_array_equal(fits.result == FitStatus.not_at_rest, [False, True, False])
    np.testing.assert_array_equal(fits.result == FitStatus.converged, [True, False, True])
    assert np.isfinite(values).all()
    for leaf in jax.tree.leaves(gradients[0]):
        assert np.isnan(leaf[1]).all()
    assert all(np.isfinite(leaf[np.array([0, 2])]).all() for leaf in jax.tree.leaves(gradients))


@pytest.mark.slow
def test_a_mixture_that_was_not_fitted_is_nan_in_values_and_derivatives(float64):
    good = np.random.default_rng(0).normal(size=(60, 2))
    lanes = jnp.stack([good, np.where(np.arange(60)[:, None] == 3, np.nan, good)])

    def squares(points, floor):
        prior = Prior.figueiredo_jain(2, floor)
        fit = fit_mixture(
            points, key=jax.random.key(0), max_components=1, prior=prior, settings=FitSettings(polish=True)
        )
        leaves = fit.mixture.weights, fit.mixture.means, fit.mixture.covariances
        own = jnp.stack([jnp.sum(leaf**2) for leaf in leaves])
        return own, own

    derivatives, values = jax.jit(jax.vmap(jax.jacrev(squares, argnums=1, has_aux=True), (0, None)))(lanes, 0.1)
    for leaves in (values, derivatives):
        np.testing.assert_array_equal(np.isnan(leaves), [[False] * 3, [True] * 3])


@pytest.mark.parametrize("argument", ["prior", "points"])
def test_without_polish_derivatives_are_an_error_that_says_so(float64, argument):
    (points, first), prior = stray_scene(2), informative_prior(2)
    settings = FitSettings()
    with pytest.raises(InputError, match="polish=True"):
        if argument == "prior":
            jax.jit(jax.grad(lambda prior: fit_statistic(prior, points, first, settings)[0]))(prior)
        else:
            jax.jit(jax.grad(lambda points: fit_statistic(prior, points, first, settings)[0]))(points)


@pytest.mark.slow
def test_float32_gradients_are_near_those_of_float64():
    """Each to 0.5 % of itself and 0.1 % of the largest: the parameters rest to 1e-4 of their component only."""
    with jax.enable_x64(True):
        (points, first), prior = stray_scene(2), informative_prior(2)
        expected = np.asarray(ravel_pytree(gradient(prior, points, first)[1][0])[0])
    single = jax.tree.map(
        lambda leaf: np.asarray(leaf, np.float32 if leaf.dtype == np.float64 else None), (prior, points, first)
    )
    (_, end), (of_prior, _) = gradient(*single)
    assert end.mixture.means.dtype == np.float32 and end.result == FitStatus.converged
    actual = np.asarray(ravel_pytree(of_prior)[0])
    np.testing.assert_allclose(actual, expected, rtol=5e-3, atol=1e-3 * np.abs(expected).max())


PRIOR = Prior(-3.5, 0.01, mean=np.zeros(3))


def overlapping(seed):
    """Six Gaussians that lie in one another, 600 points."""
    scene = random_scene(jax.random.key(seed), start=6, appeared=0, overlap="medium", points=100).before
    return weighted((scene - scene.mean(axis=0)) / scene.std())


@pytest.mark.slow
def test_polish_shortens_the_message_and_rests(float64):
    """On overlapping scenes: never longer than without polish, and one more step of EM moves nothing."""
    for seed in range(4):
        points = overlapping(seed)
        first = start(np.asarray(points.points), 10, seed=seed)
        rough, end = fit(points, first, PRIOR, FitSettings()), fit(points, first, PRIOR)
        assert end.result == FitStatus.converged
        # The noise floor, added after the M-step, is not part of what EM maximises: a hair's breadth is lost to it.
        assert end.message_length <= rough.message_length + 1e-4
        assert end.steps > rough.steps
        updated, log_likelihood = step(end.mixture, points, PRIOR)
        assert_mixtures_close(updated, end.mixture, atol=1e-9)
        np.testing.assert_allclose(end.log_likelihood, log_likelihood, rtol=1e-12)


def test_noise_component_rests_too(float64):
    (points, first), prior = stray_scene(2), informative_prior(2)
    (_, end), _ = gradient(prior, points, first)
    mixture = end.mixture
    whole = GaussianMixture(mixture.weights * (1 - end.noise_share), mixture.means, mixture.covariances, mixture.live)
    updated, _ = step(whole, points, prior, log_uniform_density(points))
    assert_mixtures_close(updated, whole, atol=1e-9)


@pytest.mark.slow
def test_padding_and_the_order_of_points_change_nothing(float64):
    points = overlapping(1)
    coordinates, mass = points.points, points.mass
    first = start(np.asarray(coordinates), 10, seed=1)
    bare = fit(points, first, PRIOR)
    padded = WeightedPoints(np.concatenate([coordinates, np.full((100, 3), 9.0)]), np.pad(mass, (0, 100)))
    of_padded = fit(padded, pad(first, 12), PRIOR)
    assert_mixtures_close(of_padded.mixture, pad(bare.mixture, 12), atol=1e-7)
    np.testing.assert_allclose(of_padded.message_length, bare.message_length, atol=1e-7)
    order = np.random.default_rng(0).permutation(len(mass))
    assert_mixtures_close(fit(weighted(coordinates[order]), first, PRIOR).mixture, bare.mixture, atol=1e-7)


def test_a_rigid_motion_moves_the_mixture(float64):
    points, rotation, shift = overlapping(2), random_rotation(), np.array([0.5, -1.0, 0.3])
    mean = np.array([0.2, -0.1, 0.4])
    prior = Prior(-3.5, 0.02, 0.2, 3.0, mean, 1.5)

    def moved(mixture):
        live = np.asarray(mixture.live, float)[:, None]
        covariances = rotation @ mixture.covariances @ rotation.T
        means = live * (mixture.means @ rotation.T + shift[None])
        return GaussianMixture(mixture.weights, means, covariances, mixture.live)

    first = start(np.asarray(points.points), 10, seed=2)
    end = fit(points, first, prior)
    turned = Prior(-3.5, 0.02, 0.2, 3.0, rotation @ mean + shift, 1.5)
    of_moved = fit(weighted(points.points @ rotation.T + shift[None]), moved(first), turned)
    assert end.result == FitStatus.converged
    assert_mixtures_close(of_moved.mixture, moved(end.mixture), atol=1e-7)
