"""Derivatives of what the joint mixture says of a change, through where its fit comes to rest."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gmmjax import FitSettings, FitStatus, InputError
from gmmjax.comparison.joint_mixture import density_ratio, intensities
from gmmjax.comparison.joint_mixture_model import (
    JointMixtureModel,
    LabelledPoints,
    fit_joint_mixture,
    initial_joint_mixture,
    joint_prior,
)
from gmmjax.mixtures import WeightedPoints
from tests.differences import along, assert_derivatives, difference_gradient
from tests.mixtures.differentiation import statistic

POLISHED = FitSettings(polish=True, patience=0.05)


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def changed_scene(seed=0):
    """Two Gaussians in both clouds, the second twice as dense later, one that is new, a few stray points, padding."""
    random = np.random.default_rng(seed)
    parts = [
        (random.standard_normal((240, 3)) * 0.3 - 1, 120),
        (random.standard_normal((150, 3)) * np.array([0.2, 0.4, 0.3]) + np.array([1.0, -0.5, 0]), 50),
        (random.standard_normal((80, 3)) * 0.25 + np.array([0.2, 0.4, 0.3]), 0),
        (random.uniform(-2, 2, (10, 3)), 5),
    ]
    coordinates = np.concatenate([points for points, _ in parts])
    after = np.concatenate([np.arange(len(points)) >= before for points, before in parts]).astype(float)
    points = LabelledPoints(WeightedPoints(coordinates, np.ones(len(coordinates))), after)
    return jax.tree.map(jnp.asarray, points.padded())


def informative_prior():
    prior = dataclasses.replace(
        joint_prior(0.03, 0.05),
        scale=0.4,
        degrees_of_freedom=4.0,
        mean=np.array([0.3, -0.2, 0.1]),
        mean_strength=1.5,
        noise_share=0.03,
        noise_strength=15.0,
    )
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), prior)


def posterior(prior, points, settings=POLISHED):
    """The probability that what is at some points of the after cloud is new, as one number, and the fit."""
    start = initial_joint_mixture(points, 6, prior, jax.random.key(0))
    fit = fit_joint_mixture(points, start, prior, settings)
    before, after = intensities(fit.mixture, points.points.points[:480:7])
    new = jnp.maximum(0, 1 - density_ratio(fit.mixture) * before / after)
    return statistic(new, fit.message_length / 100), (fit, new)


gradient = jax.jit(jax.value_and_grad(posterior, argnums=(0, 1), has_aux=True))


@pytest.mark.slow
def test_gradients_of_the_posterior_equal_differences():
    """By every leaf of the prior, and along directions of points and masses."""
    points, prior = changed_scene(), informative_prior()
    (_, (fit, new)), (of_prior, of_points) = gradient(prior, points)
    assert fit.result == FitStatus.converged
    live = fit.mixture.mixture.live
    assert 3 <= live.sum() < len(live)
    assert (new > 0.9).any() and ((0.01 < new) & (new < 0.9)).any()
    vector, unravel = ravel_pytree(prior)
    expected = difference_gradient(lambda vector: gradient(unravel(vector), points)[0][0], vector, step=1e-3)
    assert_derivatives(ravel_pytree(of_prior)[0], expected)
    used = np.asarray(points.points.mass) > 0
    random = np.random.default_rng(0)
    moves = {
        "points": random.standard_normal(points.points.points.shape) * used[:, None] / 10,
        "mass": random.standard_normal(used.shape) * used,
    }
    for name, move in moves.items():

        def moved(leaf, name=name):
            return LabelledPoints(dataclasses.replace(points.points, **{name: leaf}), points.after)

        leaf = getattr(points.points, name)
        expected = along(lambda leaf, moved=moved: gradient(prior, moved(leaf))[0][0], leaf, jnp.asarray(move), 1e-3)
        assert_derivatives(jnp.sum(getattr(of_points.points, name) * move), expected)
        assert not np.asarray(of_points.points.points)[~used].any()


def test_the_joint_mixture_rests():
    points, prior = changed_scene(), informative_prior()
    (_, (fit, _)), _ = gradient(prior, points)

    @jax.jit
    def step(joint):
        model = JointMixtureModel.of(points, prior, POLISHED)
        sums, _ = model.expectation(joint)
        return model.annihilating_maximisation(joint, sums)

    updated = step(fit.mixture)
    for before, after in zip(jax.tree.leaves(fit.mixture), jax.tree.leaves(updated), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_without_polish_derivatives_are_an_error_that_says_so():
    points, prior = changed_scene(), informative_prior()
    with pytest.raises(InputError, match="polish=True"):
        jax.jit(jax.grad(lambda prior: posterior(prior, points, FitSettings())[0]))(prior)
