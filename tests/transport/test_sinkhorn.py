import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.errors import InputError
from gmmjax.transport import TransportStatus, exact_transport, sinkhorn
from tests.differences import along, assert_derivatives
from tests.transport.problems import random_problems

pytestmark = pytest.mark.usefixtures("float64")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["generic", "dead", "unequal"])
def test_falls_to_the_exact_distance_as_epsilon_falls(kind):
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, kind, seed=1))
    exact = float(exact_transport(before, after, cost).cost)
    gaps = []
    for epsilon in (0.3, 0.1, 0.03, 0.01):
        entropic = sinkhorn(before, after, cost, epsilon=epsilon, max_iterations=50_000)
        assert entropic.result == TransportStatus.optimal
        np.testing.assert_allclose(entropic.plan.sum(1) + entropic.unmatched[0], before, atol=1e-5)
        np.testing.assert_allclose(entropic.plan.sum(0) + entropic.unmatched[1], after, atol=1e-5)
        gaps.append(float(entropic.cost) / exact - 1)
    assert all(later < earlier for earlier, later in itertools.pairwise(gaps))
    assert abs(gaps[-1]) < 1e-3


@pytest.fixture(scope="module")
def gradients():
    """Value and gradients of a 3 x 5 problem by masses, costs and epsilon; None: the default."""

    def distance(before, after, cost, epsilon=None):
        return sinkhorn(before, after, cost, epsilon=epsilon).cost

    default, given = (jax.value_and_grad(distance, tuple(range(count))) for count in (3, 4))
    return {"default": jax.jit(default), "given": jax.jit(given)}


def directions(problem, kind, rng):
    """One way to move each argument in; equal totals stay equal, and what is dead stays dead."""
    ways = [rng.normal(size=array.shape) for array in problem]
    for side in (0, 1):
        live = np.asarray(problem[side]) > 0
        ways[side] = np.where(live, ways[side], 0)
        if kind not in ("unequal", "heavy"):
            ways[side] -= live * ways[side].sum() / live.sum()
    return ways


@pytest.mark.parametrize("epsilon", ["default", "given"])
@pytest.mark.parametrize("kind", ["generic", "dead", "unequal", "heavy", "equal"])
def test_gradient_by_each_argument_equals_central_differences(gradients, kind, epsilon):
    """Also of one component that outweighs the other side, and of equal masses, at which plain sweeps creep."""
    before, after, cost = (array[0] for array in random_problems(1, 3, 5, kind, seed=3))
    if kind == "heavy":
        before[0] = 9.0
    if kind == "equal":
        before, after = np.full(3, 1 / 3), np.full(5, 1 / 5)
    problem = [jnp.asarray(array) for array in (before, after, cost)]
    if epsilon == "given":
        problem.append(jnp.asarray(0.2))
    _, found = gradients[epsilon](*problem)
    for place, way in enumerate(directions(problem, kind, np.random.default_rng(4))):

        def moved(own, place=place):
            return gradients[epsilon](*problem[:place], own, *problem[place + 1 :])[0]

        assert_derivatives((found[place] * way).sum(), along(moved, problem[place], way, 1e-4))


def test_gradient_by_a_dead_component_is_what_its_first_mass_changes(gradients):
    before, after, cost = (array[0] for array in random_problems(1, 3, 5, "unequal", seed=5))
    for side in (0, 1):
        problem = [jnp.asarray(array) for array in (before, after, cost, 0.2)]
        problem[side] = problem[side].at[1].set(0)
        _, found = gradients["given"](*problem)
        values = []
        for step in (0, 1e-5, 2e-5):
            nearby = [*problem[:side], problem[side].at[1].set(step), *problem[side + 1 :]]
            values.append(float(gradients["given"](*nearby)[0]))
        expected = (-3 * values[0] + 4 * values[1] - values[2]) / 2e-5
        assert float(found[side][1]) == pytest.approx(expected, rel=1e-6)


def test_gradient_keeps_its_digits_where_hardly_anything_connects_the_parts(gradients):
    """Between equal mixtures: by the costs it is the plan, as of the exact distance."""
    points = np.array([[0.0, 0.0], [3.0, 1.0], [-2.0, 4.0]])
    cost = np.linalg.norm(points[:, None] - points[None], axis=2)
    masses = jnp.full(3, 1 / 3)
    _, found = gradients["given"](masses, masses, jnp.asarray(cost), jnp.asarray(0.03))
    np.testing.assert_allclose(found[2], np.eye(3) / 3, atol=1e-12)
    assert all(np.isfinite(gradient).all() for gradient in found)


@pytest.mark.slow
def test_forward_mode_and_vmap_equal_reverse_mode(gradients):
    problems = tuple(map(jnp.asarray, random_problems(3, 3, 5, "unequal", seed=6)))
    _, found = jax.vmap(gradients["default"])(*problems)

    def distances(*problems):
        return jax.vmap(lambda *own: sinkhorn(*own).cost)(*problems)

    _, forward = jax.jvp(distances, problems, problems)
    expected = sum((own * way).reshape(3, -1).sum(1) for own, way in zip(found, problems, strict=True))
    np.testing.assert_allclose(forward, expected, rtol=1e-10)


def test_second_derivatives_are_an_error():
    before, after, cost = (jnp.asarray(array[0]) for array in random_problems(1, 3, 5, "generic", seed=7))
    with pytest.raises(InputError, match="second derivatives"):
        jax.hessian(lambda epsilon: sinkhorn(before, after, cost, epsilon=epsilon).cost)(0.2)


@pytest.mark.slow
def test_padding_changes_neither_the_default_epsilon_nor_the_gradients_in_single_precision(gradients):
    """Which are those of double precision without padding."""
    before, after, cost = (jnp.asarray(array[0]) for array in random_problems(1, 3, 5, "unequal", seed=2))
    padded = jnp.pad(before, (0, 2)), jnp.pad(after, (0, 1)), jnp.pad(cost, ((0, 2), (0, 1)), constant_values=1e9)
    bare_cost, bare = gradients["default"](before, after, cost)
    padded_cost, found = gradients["default"](*(array.astype(jnp.float32) for array in padded))
    assert padded_cost.dtype == np.float32
    tolerance = 5e-4
    assert padded_cost == pytest.approx(float(bare_cost), rel=tolerance)
    assert all(np.all(np.isfinite(gradient)) for gradient in found)
    np.testing.assert_allclose(found[2][:3, :5], bare[2], atol=tolerance)
    np.testing.assert_allclose(found[0][:3], bare[0], atol=tolerance)


@pytest.mark.slow
def test_equals_ott_jax():
    from ott.geometry import geometry
    from ott.problems.linear import linear_problem
    from ott.solvers.linear import sinkhorn as ott

    before, after, cost = (array[0] for array in random_problems(1, 8, 12, "generic", seed=8))
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        problem = linear_problem.LinearProblem(geometry.Geometry(cost, epsilon=0.1), before, after)
        expected = ott.Sinkhorn(threshold=1e-10, max_iterations=20_000)(problem).matrix
    np.testing.assert_allclose(sinkhorn(before, after, cost, epsilon=0.1).plan, expected, atol=1e-9)


def test_too_few_iterations_are_a_status():
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, "generic", seed=5))
    assert sinkhorn(before, after, cost, epsilon=1e-3, max_iterations=10).result == TransportStatus.not_converged


def test_bad_numbers_and_missing_mass_are_statuses():
    nothing, something, cost = np.zeros(2), np.ones(2), np.ones((2, 2))
    assert sinkhorn(nothing, something, cost).result == TransportStatus.no_mass
    solved = sinkhorn(something, something, cost * np.nan)
    assert solved.result == TransportStatus.invalid_input
    assert not np.any(np.isnan(solved.plan))
    for epsilon in (0.0, -1.0, np.nan):
        solved = sinkhorn(something, something, cost, epsilon=epsilon)
        assert solved.result == TransportStatus.invalid_input and np.isinf(solved.cost)


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, 0, 0, None))
def solve_all(before, after, cost, epsilon):
    return sinkhorn(before, after, cost, epsilon=epsilon)


@pytest.mark.slow
@pytest.mark.parametrize("epsilon", [0.1, 0.03, 0.01])
def test_scenes_of_which_little_changed_converge(epsilon):
    """Clusters far from each other whose masses differ by a few per cent: hardly any mass connects them."""
    random = np.random.default_rng(0)
    before = random.dirichlet(np.full(10, 20.0), 20)
    after = before * random.uniform(0.97, 1.03, before.shape)
    after /= after.sum(axis=1, keepdims=True)
    places = random.uniform(-5, 5, (20, 10, 3))
    later = places + random.normal(0, 0.05, places.shape)
    later[:, 0] = random.uniform(-5, 5, (20, 3))
    cost = np.linalg.norm(places[:, :, None] - later[:, None], axis=-1)
    solved = solve_all(before, after, cost, epsilon)
    assert np.all(solved.result == TransportStatus.optimal)
    exact = jax.vmap(exact_transport)(before, after, cost).cost
    np.testing.assert_allclose(solved.cost, exact, atol=3 * epsilon)
