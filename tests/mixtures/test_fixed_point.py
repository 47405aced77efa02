"""Fixed points of small maps whose fixed point and derivatives are known."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.mixtures.fixed_point import fixed_point

SIZE = 5


def linear(parameters, arguments):
    """x = A x + b, in two parts of a tree."""
    matrix, offset = arguments
    image = matrix @ jnp.concatenate([parameters["first"], parameters["rest"]]) + offset
    return {"first": image[:2], "rest": image[2:]}


@functools.partial(jax.jit, static_argnames=("max_steps", "tolerance"))
def solve(arguments, max_steps=200, tolerance=1e-12):
    start = {"first": jnp.zeros(2), "rest": jnp.ones(SIZE - 2)}
    return fixed_point(linear, start, arguments, tolerance=tolerance, max_steps=max_steps)


def at_rest(arguments, max_steps=200, tolerance=1e-12):
    parameters = solve(arguments, max_steps, tolerance).parameters
    return jnp.concatenate([parameters["first"], parameters["rest"]])


def problem(rate=0.8, seed=0):
    """A map that shrinks errors by this factor at the slowest."""
    random = np.random.default_rng(seed)
    basis = np.linalg.qr(random.standard_normal((SIZE, SIZE)))[0]
    rates = np.linspace(-rate / 2, rate, SIZE)
    return jnp.asarray(basis @ np.diag(rates) @ basis.T), jnp.asarray(random.standard_normal(SIZE))


def answer(arguments):
    matrix, offset = arguments
    return jnp.linalg.solve(jnp.eye(SIZE) - matrix, offset)


def assert_trees_close(actual, expected, tolerance=1e-7):
    for ours, theirs in zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=tolerance)


def test_of_a_linear_map(float64):
    found = solve(problem())
    assert found.converged
    parameters = np.concatenate([found.parameters["first"], found.parameters["rest"]])
    np.testing.assert_allclose(parameters, answer(problem()), atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev])
def test_derivatives_of_a_linear_map(float64, jacobian):
    assert_trees_close(jax.jit(jacobian(at_rest))(problem()), jacobian(answer)(problem()))


@pytest.mark.slow
def test_second_derivatives_of_a_linear_map(float64):
    """Of its size, by the factors of the matrix and of the offset."""
    matrix, offset = problem()

    def slope(function):
        def size(factors):
            return jnp.sum(function((factors[0] * matrix, factors[1] * offset)) ** 2)

        return jax.jvp(jax.grad(size), (jnp.array([1.0, 2.0]),), (jnp.array([1.0, -0.5]),))[1]

    np.testing.assert_allclose(jax.jit(lambda: slope(at_rest))(), slope(answer), rtol=1e-6)


def test_a_lane_that_had_too_few_steps_has_no_derivatives_and_spoils_no_other(float64):
    """Reverse derivatives of maps of different speeds, of which the second is the slowest."""
    problems = [problem(0.01, 0), problem(0.95, 1), problem(0.02, 2)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *problems)
    jacobians = jax.jit(jax.vmap(jax.jacrev(lambda arguments: at_rest(arguments, max_steps=5, tolerance=1e-6))))(batch)
    for lane in (0, 2):
        own = jax.tree.map(lambda leaf, lane=lane: leaf[lane], jacobians)
        assert_trees_close(own, jax.jacrev(answer)(problems[lane]), 1e-5)
    assert all(np.isnan(leaf[1]).all() for leaf in jax.tree.leaves(jacobians))


def test_too_few_steps_are_said(float64):
    end = solve(problem(0.95), max_steps=3)
    assert not end.converged and end.steps == 3
    tangent = jax.jvp(lambda arguments: at_rest(arguments, max_steps=3), (problem(0.95),), (problem(0.95),))[1]
    assert np.isnan(tangent).all()


def slow(parameters, offset):
    """A rotation that shrinks by 1 % a step."""
    turned = jnp.stack([parameters[1], -parameters[0], 0.5 * parameters[2]])
    return 0.99 * jnp.sin(turned) + offset


def test_a_slow_contraction_takes_few_steps(float64):
    """Forty times fewer than the iteration itself."""
    offset = jnp.array([1e-3, -2e-3, 0.1])
    found = fixed_point(slow, jnp.ones(3) / 2, offset, tolerance=1e-11, max_steps=500)
    plain, steps = jnp.ones(3) / 2, 0
    step = jax.jit(slow)
    while np.abs(step(plain, offset) - plain).max() > 1e-11:
        plain, steps = step(plain, offset), steps + 1
    assert found.converged and int(found.steps) < steps / 20
    np.testing.assert_allclose(found.parameters, plain, atol=1e-8)


def test_an_extrapolation_that_goes_astray_is_taken_back(float64):
    """Newton's map for a square root is far from linear where it starts, and not a number at a step below zero."""

    def root(parameters, square):
        return jnp.where(parameters > 0, (parameters + square / parameters) / 2, jnp.nan)

    squares = jnp.array([2.0, 3e-4, 5e5])
    found = fixed_point(root, jnp.ones(3), squares, tolerance=1e-9, max_steps=200)
    assert found.converged
    np.testing.assert_allclose(found.parameters, np.sqrt(squares), rtol=1e-9)


def test_a_cotangent_of_nan_does_not_raise(float64):
    """What a loss that is NaN asks for."""
    _, pull = jax.vjp(jax.jit(at_rest), problem())
    assert all(np.isnan(leaf).any() for leaf in jax.tree.leaves(pull(jnp.full(SIZE, jnp.nan))))


def test_a_singular_system_has_no_derivatives(float64):
    """Every point is at rest: which one is chosen has no derivative by the offset."""
    identity, offset = jnp.eye(SIZE), jnp.zeros(SIZE)
    assert solve((identity, offset)).converged
    _, tangent = jax.jvp(lambda offset: at_rest((identity, offset)), (offset,), (jnp.ones(SIZE),))
    assert np.isnan(tangent).all()


def test_nothing_is_differentiated_by_the_start(float64):
    start = {"first": jnp.zeros(2), "rest": jnp.ones(SIZE - 2)}

    def rest(start):
        return fixed_point(linear, start, problem(), tolerance=1e-12, max_steps=200).parameters["rest"]

    assert not any(np.any(leaf) for leaf in jax.tree.leaves(jax.jvp(rest, (start,), (start,))[1]))


def test_in_float32():
    arguments = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), jnp.float32), problem(0.5))
    found = solve(arguments, tolerance=1e-5)
    assert found.converged and found.parameters["rest"].dtype == jnp.float32
    np.testing.assert_allclose(found.parameters["rest"], answer(arguments)[2:], atol=1e-4)
