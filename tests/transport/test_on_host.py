"""Exact transport of NumPy arrays: the kernel without a JAX program around it, with all that the program does."""

import importlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import InputError, earth_movers_distance, native
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport import TransportStatus, exact_transport, partial_transport, sinkhorn
from tests.transport.problems import random_problems

exact = importlib.import_module("gmmjax.transport.exact")
needs_kernels = pytest.mark.skipif(native.host_kernels() is None, reason="the kernels were not built")
KINDS = ["generic", "ties", "same_support", "dead", "unequal"]


def one(kind="unequal", shape=(5, 7), seed=0):
    return [array[0].copy() for array in random_problems(1, *shape, kind, seed)]


def assert_same(found, expected, tolerance=1e-12):
    for own, wanted in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert isinstance(own, np.ndarray) and own.dtype == wanted.dtype and own.shape == wanted.shape
        np.testing.assert_allclose(own, wanted, rtol=tolerance, atol=tolerance)


def in_jax(before, after, cost, **settings):
    """The same of JAX's arrays, in float64."""
    with jax.enable_x64(True):
        return exact_transport(jnp.asarray(before), jnp.asarray(after), jnp.asarray(cost), **settings)


@pytest.mark.slow
@needs_kernels
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (13, 16), (70, 90)], ids=str)
def test_is_what_the_program_gives(shape, monkeypatch):
    problems = [one(kind, shape, seed) for kind in KINDS for seed in range(3)]
    expected = [in_jax(*problem) for problem in problems]
    warm = [in_jax(*own, start=other.potentials[1]) for own, other in zip(problems, expected, strict=True)]
    # No program is run.
    monkeypatch.setattr(exact, "_solve", None)
    for problem, cold, started in zip(problems, expected, warm, strict=True):
        assert_same(exact_transport(*problem), cold)
        assert_same(exact_transport(*problem, start=np.asarray(cold.potentials[1])), started)


def wrong(name):
    before, after, cost = one()
    settings = {}
    if name == "NaN in a mass":
        before[1] = np.nan
    elif name == "infinite mass":
        after[0] = np.inf
    elif name == "negative mass":
        after[2] = -0.1
    elif name == "masses beyond all numbers":
        before[:2] = 1e308
    elif name == "NaN in a cost":
        cost[0, 1] = np.nan
    elif name == "no mass":
        after[:] = 0
    elif name == "unusable start":
        settings["start"] = np.full(7, np.nan)
    elif name == "cut short":
        settings["max_pivots"] = 0
        cost[:] = np.arange(7) + 0.1 * np.arange(5)[:, None] ** 2
    return (before, after, cost), settings


FAILURES = {
    **dict.fromkeys(["NaN in a mass", "infinite mass", "negative mass"], "invalid_input"),
    **dict.fromkeys(["masses beyond all numbers", "NaN in a cost"], "invalid_input"),
    **{"no mass": "no_mass", "unusable start": "optimal", "cut short": "pivot_limit"},
}


@pytest.mark.parametrize("kernels", [pytest.param(True, marks=needs_kernels), False])
@pytest.mark.parametrize("name", FAILURES)
def test_fails_as_the_program_does(name, kernels, monkeypatch):
    problem, settings = wrong(name)
    expected = in_jax(*problem, **settings)
    if not kernels:
        monkeypatch.setattr(native, "host_kernels", lambda: None)
    found = exact_transport(*problem, **settings)
    assert found.result == getattr(TransportStatus, FAILURES[name])
    assert_same(found, expected)


@pytest.mark.slow
@pytest.mark.parametrize("solve", [exact_transport, sinkhorn, lambda *own: partial_transport(*own, 0.5)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_numpy_arrays_are_solved_in_float64_whatever_their_type_and_layout(solve, dtype):
    before, after, cost = (np.asarray(array, dtype) for array in one("generic"))
    found = solve(before, after, cost)
    for leaf in (found.cost, found.plan, *found.potentials, *found.unmatched):
        assert isinstance(leaf, np.ndarray) and leaf.dtype == np.float64
    assert_same(solve(before[::-1], after, np.asfortranarray(cost)[::-1]).cost, found.cost, 1e-9)
    singles = [jnp.asarray(array, jnp.float32) for array in (before, after, cost)]
    assert isinstance(solve(*singles).cost, jax.Array) and solve(*singles).cost.dtype == np.float32


@pytest.mark.parametrize("solve", [exact_transport, sinkhorn, lambda *own: partial_transport(*own, 0.5)])
@pytest.mark.parametrize("convert", [np.asarray, jnp.asarray])
@pytest.mark.usefixtures("as_users")
def test_shapes_that_do_not_fit_are_refused(solve, convert):
    before, after, cost = one()
    for problem in ((before, after, cost.T), (before[:4], after, cost), (before[None], after[None], cost[None])):
        with pytest.raises(InputError, match="cost must be of shape"):
            solve(*(convert(array) for array in problem))
    if solve is exact_transport:
        with pytest.raises(InputError, match="start must have a potential"):
            solve(*(convert(array) for array in (before, after, cost)), start=convert(before))


@pytest.mark.parametrize("kernels", [pytest.param(True, marks=needs_kernels), False])
def test_mixtures_of_numpy_are_compared_as_those_of_jax(kernels, monkeypatch):
    random = np.random.default_rng(0)
    mixtures = [
        GaussianMixture(
            random.dirichlet(np.ones(size)) * (np.arange(size) < live),
            random.normal(size=(size, 3)),
            np.tile(np.eye(3), (size, 1, 1)),
            np.arange(size) < live,
        )
        for size, live in ((6, 6), (9, 5))
    ]
    with jax.enable_x64(True):
        expected = earth_movers_distance(*(jax.tree.map(jnp.asarray, own) for own in mixtures))
    if kernels:
        monkeypatch.setattr(exact, "_solve", None)
    else:
        monkeypatch.setattr(native, "host_kernels", lambda: None)
    assert_same(earth_movers_distance(*mixtures), expected)
