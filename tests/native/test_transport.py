"""The kernel of exact transport against the dual simplex in plain JAX, and against what makes a solution optimal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax import native
from gmmjax.transport import exact_transport
from gmmjax.transport.balanced import _plain_transport, balanced_transport, pivot_limit

pytestmark = pytest.mark.skipif(not native.available(), reason="the kernels were not built")
solve = balanced_transport
plain = jax.jit(_plain_transport)
TOLERANCE = {"float64": 1e-12, "float32": 1e-5}


def problem(rows, columns, dtype="float64", seed=0, dead=0.3, levels=None):
    """Balanced masses, some of them 0; with `levels` costs and masses are small integers, so that many optima tie."""
    random = np.random.default_rng(seed)
    masses = [random.uniform(0.01, 1, size) for size in (rows, columns)]
    cost = random.uniform(0, 3, (rows, columns))
    if levels:
        masses = [random.integers(1, 1 + levels, size).astype(float) for size in (rows, columns)]
        cost = random.integers(0, levels, (rows, columns)).astype(float)
    for mass in masses:
        mass[1:] *= random.uniform(size=len(mass) - 1) >= dead
    supply, demand = (mass / mass.sum() for mass in masses)
    none = np.full(columns, np.inf)
    arrays = [jnp.asarray(array, dtype) for array in (supply, demand, cost, none)]
    return (*arrays, jnp.asarray(pivot_limit(rows, columns), jnp.int32))


def assert_optimal(solution, supply, demand, cost, tolerance):
    """Feasible, with feasible potentials, and flow on tight arcs alone: the optimality conditions of the programme."""
    plan, rows, columns = (np.asarray(part, np.float64) for part in solution[:3])
    assert bool(solution.optimal)
    assert (plan >= 0).all()
    np.testing.assert_allclose(plan.sum(axis=1), supply, rtol=0, atol=tolerance)
    np.testing.assert_allclose(plan.sum(axis=0), demand, rtol=0, atol=tolerance)
    live = np.outer(np.asarray(supply) > 0, np.asarray(demand) > 0)
    reduced = np.asarray(cost) - rows[:, None] - columns[None]
    assert reduced[live].min() > -tolerance * 10
    assert np.abs(reduced[(plan > 0) & live]).max() < tolerance * 10


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), dtype=st.sampled_from(["float64", "float32"]), levels=st.sampled_from([None, 3]))
@pytest.mark.parametrize("shape", [(7, 9), (25, 25)])
def test_as_plain(shape, seed, dtype, levels):
    with jax.enable_x64(True):
        supply, demand, cost, *rest = problem(*shape, dtype, seed, levels=levels)
        ours, theirs = solve(supply, demand, cost, *rest), plain(supply, demand, cost, *rest)
        assert_optimal(ours, supply, demand, cost, TOLERANCE[dtype])
        work = [float(jnp.sum(solution.plan * cost)) for solution in (ours, theirs)]
    assert work[0] == pytest.approx(work[1], abs=TOLERANCE[dtype] * 3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 1), (70, 90)])
def test_any_shape(shape):
    """More rows than bits in a word, more columns than lanes, and single ones."""
    with jax.enable_x64(True):
        supply, demand, cost, *rest = problem(*shape)
        assert_optimal(solve(supply, demand, cost, *rest), supply, demand, cost, 1e-12)


def test_dead_components_have_the_price_of_their_first_mass():
    with jax.enable_x64(True):
        supply, demand, cost, *rest = problem(9, 9, seed=4)
        solution = solve(supply, demand, cost, *rest)
        dead = np.flatnonzero(np.asarray(supply) == 0)
        live = np.asarray(demand) > 0
        assert len(dead)
        cheapest = (np.asarray(cost)[dead] - np.asarray(solution.column_potentials))[:, live].min(axis=1)
        np.testing.assert_allclose(np.asarray(solution.row_potentials)[dead], cheapest)


def test_without_mass_nothing_moves():
    with jax.enable_x64(True):
        _, _, cost, *rest = problem(4, 5)
        solution = solve(jnp.zeros(4), jnp.zeros(5), cost, *rest)
    assert bool(solution.optimal)
    assert not np.asarray(solution.plan).any()
    assert np.isfinite(np.asarray(solution.row_potentials)).all()


def test_any_start_leads_to_an_optimum():
    with jax.enable_x64(True):
        supply, demand, cost, _, limit = problem(25, 25, seed=2)
        cold = solve(supply, demand, cost, jnp.full(25, jnp.inf), limit)
        wild = solve(supply, demand, cost, jnp.asarray(np.random.default_rng(0).normal(size=25)), limit)
        warm = solve(supply, demand, cost, cold.column_potentials, limit)
        for solution in (wild, warm):
            assert_optimal(solution, supply, demand, cost, 1e-12)
    assert int(warm.pivots) < int(cold.pivots)


@pytest.mark.slow
@pytest.mark.parametrize("kernels", [True, False])
def test_potentials_of_a_similar_problem_are_a_start(kernels, monkeypatch):
    """What was found before a removal is the start after it, in the compiled kernel and in plain JAX."""
    if not kernels:
        monkeypatch.setattr(native, "available", lambda: False)
    # Of a shape that no other test has: a program that was compiled with the other code would be taken.
    size = 8 if kernels else 13
    with jax.enable_x64(True):
        supply, demand, cost, *_ = problem(size, size, dead=0)
        before = exact_transport(supply, demand, cost)
        fewer = supply.at[2].set(0) / (1 - supply[2])
        cold, warm = (
            exact_transport(fewer, demand, cost),
            exact_transport(fewer, demand, cost, start=before.potentials[1]),
        )
        assert float(warm.cost) == pytest.approx(float(cold.cost), abs=1e-12)
        unusable = exact_transport(fewer, demand, cost, start=before.potentials[1].at[3].set(jnp.nan))
        assert float(unusable.cost) == pytest.approx(float(cold.cost), abs=1e-12)


def test_stacks_share_what_is_not_stacked():
    with jax.enable_x64(True):
        supply, demand, cost, *rest = problem(6, 7, dead=0)
        supplies = jnp.stack([supply, supply[::-1]])
        stacked = jax.vmap(solve, (0, None, None, None, None))(supplies, demand, cost, *rest)
        for index in range(2):
            own = jax.tree.map(lambda leaf, index=index: leaf[index], stacked)
            assert_optimal(own, supplies[index], demand, cost, 1e-12)


def test_costs_may_be_negative_and_far_from_zero():
    with jax.enable_x64(True):
        supply, demand, cost, *rest = problem(25, 25)
        for shifted in (cost - 1e3, -cost):
            assert_optimal(solve(supply, demand, shifted, *rest), supply, demand, shifted, 1e-10)


def test_gives_up_at_the_limit():
    with jax.enable_x64(True):
        supply, demand, cost, none, _ = problem(25, 25)
        assert not bool(solve(supply, demand, cost, none, jnp.asarray(1, jnp.int32)).optimal)
