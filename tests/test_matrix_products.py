"""Accelerators round the factors of single-precision products unless they are told not to: all of ours tell them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import jaxprs_in_params

from gmmjax import FitSettings, Prior, earth_movers_distance, fit_mixture, native
from gmmjax._matrix_products import in_full_precision
from gmmjax.comparison.joint_mixture import intensities, responsibilities
from gmmjax.comparison.joint_mixture_model import (
    LabelledPoints,
    fit_joint_mixture,
    initial_joint_mixture,
    joint_prior,
)
from gmmjax.mixtures import GaussianMixture, WeightedPoints

POINTS = np.random.default_rng(0).normal(size=(60, 3)).astype(np.float32)
KEY = jax.random.key(0)


@pytest.fixture(autouse=True)
def _as_on_an_accelerator(monkeypatch):
    """Which has no kernels."""
    monkeypatch.setattr(native, "available", lambda: False)


def equations(jaxpr):
    """All of a program, those of its inner programs included."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in jaxprs_in_params(equation.params):
            yield from equations(inner)


def products(function, *arguments):
    """The precision of each matrix product of a program."""
    program = jax.make_jaxpr(function)(*arguments).jaxpr
    return [own.params["precision"] for own in equations(program) if own.primitive.name == "dot_general"]


def fitted(points, settings=FitSettings()):
    return fit_mixture(
        points, key=KEY, max_components=4, prior=Prior.figueiredo_jain(3, 1e-3), settings=settings
    ).mixture


def looked_at(points):
    mixture = fitted(points)
    return mixture.log_density(points), mixture.sample(KEY, 5)


def derivative(points):
    def total(points):
        mixture = fitted(points, FitSettings(polish=True))
        return jnp.sum(mixture.means) + jnp.sum(mixture.covariances)

    return jax.grad(total)(points)


def component_wise(points):
    return fitted(points, FitSettings(step="component-wise"))


def tied(points):
    return fitted(points, FitSettings(covariance_type="tied"))


def joint(points):
    after = (jnp.arange(len(points)) < 20).astype(points.dtype)
    both = LabelledPoints(WeightedPoints(points, jnp.ones_like(after)), after)
    prior = jax.tree.map(jnp.float32, dataclasses.replace(joint_prior(1e-3, 0.0), noise_share=0.01))
    start = initial_joint_mixture(both, 4, prior, KEY)
    fit = fit_joint_mixture(both, start, prior, FitSettings(patience=0.05))
    return intensities(fit.mixture, points), responsibilities(fit.mixture, points, True)


def distance(solver, points):
    def cost(points):
        live, covariances = jnp.ones(4, bool), jnp.broadcast_to(jnp.eye(3, dtype=points.dtype), (4, 3, 3))
        weights = jnp.full(4, 0.25, points.dtype)
        both = (GaussianMixture(weights, points[own : own + 4], covariances, live) for own in (0, 4))
        return earth_movers_distance(*both, solver=solver, ground_cost="bures_wasserstein").cost

    return jax.grad(cost)(points)


@pytest.mark.slow
@pytest.mark.parametrize("function", [looked_at, derivative, component_wise, tied, joint])
def test_fits_multiply_with_all_digits(function):
    found = products(function, POINTS)
    assert found and set(found) == {(jax.lax.Precision.HIGHEST,) * 2}


@pytest.mark.parametrize("solver", ["exact", "sinkhorn"])
def test_transport_multiplies_with_all_digits(solver):
    found = products(lambda points: distance(solver, points), POINTS)
    assert found and set(found) == {(jax.lax.Precision.HIGHEST,) * 2}


def test_the_setting_ends_with_the_function():
    assert products(in_full_precision(jnp.matmul), POINTS.T, POINTS) == [(jax.lax.Precision.HIGHEST,) * 2]
    assert products(jnp.matmul, POINTS.T, POINTS) == [None]
