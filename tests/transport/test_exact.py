import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.transport import TransportStatus, exact_transport
from tests.differences import PRECISION, along, assert_derivatives
from tests.transport.problems import Problems, linear_programme, peer_distance, random_problems

pytestmark = pytest.mark.usefixtures("float64")

SHAPES = [(1, 1), (1, 7), (9, 1), (2, 3), (3, 5), (8, 8), (13, 16), (25, 32)]
KINDS = ["generic", "ties", "same_support", "dead", "unequal"]
solve_all = jax.jit(jax.vmap(exact_transport))
seeds = st.integers(0, 2**32 - 1)


def distance(before, after, cost):
    return exact_transport(before, after, cost).cost


value_and_gradients = jax.jit(jax.value_and_grad(distance, argnums=(0, 1, 2)))
all_values_and_gradients = jax.jit(jax.vmap(value_and_gradients))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_equals_pot_on_thousands_of_problems(shape):
    for kind in KINDS:
        problems = random_problems(60, *shape, kind)
        solved = solve_all(*problems)
        assert np.all(solved.result == TransportStatus.optimal)
        expected = [peer_distance(*problem) for problem in zip(*problems, strict=True)]
        np.testing.assert_allclose(solved.cost, expected, rtol=1e-9, atol=1e-12, err_msg=kind)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 7), (3, 5), (13, 16)], ids=str)
@pytest.mark.parametrize("kind", KINDS)
def test_equals_the_linear_programme_of_the_thesis(shape, kind):
    problems = random_problems(60, *shape, kind, seed=1)
    solved = solve_all(*problems)
    for index in range(60):
        before, after, cost = (array[index] for array in problems)
        flow = min(before.sum(), after.sum()) * (1 - 1e-15)
        assert solved.cost[index] == pytest.approx(linear_programme(before, after, cost, flow=flow) / flow, abs=1e-9)


def test_a_large_problem_with_every_cost_tied():
    solved = exact_transport(np.full(64, 1 / 64), np.full(64, 1 / 64), np.full((64, 64), 3.7))
    assert solved.result == TransportStatus.optimal
    assert solved.cost == pytest.approx(3.7, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kind", KINDS)
def test_plan_keeps_the_masses_and_prices_prove_it_optimal(kind, dtype):
    problems = random_problems(60, 13, 16, kind, seed=2).as_type(dtype)
    solved = solve_all(*problems)
    tolerance = 5e-5 if dtype == np.float32 else 1e-10
    plan, (left, right) = np.asarray(solved.plan), solved.unmatched
    assert solved.cost.dtype == dtype
    assert np.all(plan >= 0) and np.all(left >= 0) and np.all(right >= 0)
    np.testing.assert_allclose(plan.sum(2) + left, problems.before, atol=tolerance)
    np.testing.assert_allclose(plan.sum(1) + right, problems.after, atol=tolerance)
    np.testing.assert_allclose(
        plan.sum((1, 2)), np.minimum(problems.before.sum(1), problems.after.sum(1)), rtol=tolerance
    )
    rows, columns = (np.asarray(potentials) for potentials in solved.potentials)
    slack = problems.cost - rows[:, :, None] - columns[:, None]
    live = (problems.before > 0)[:, :, None] & (problems.after > 0)[:, None]
    assert np.all(slack[live] >= -tolerance)
    assert np.abs(plan * slack).max() <= tolerance
    work = (problems.before * rows).sum(1) + (problems.after * columns).sum(1)
    np.testing.assert_allclose(work, (plan * problems.cost).sum((1, 2)), atol=tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_single_precision_agrees_with_double(kind):
    problems = random_problems(60, 13, 16, kind, seed=3)
    single = solve_all(*problems.as_type(np.float32))
    assert np.all(single.result == TransportStatus.optimal)
    np.testing.assert_allclose(single.cost, solve_all(*problems).cost, rtol=5e-4, atol=5e-5)


@settings(max_examples=20, deadline=None)
@given(seeds, st.sampled_from(KINDS), st.floats(-1e30, 1e30))
def test_padding_changes_nothing(seed, kind, cost_of_padding):
    before, after, cost = (array[0] for array in random_problems(1, 3, 5, kind, seed))
    padded_cost = np.pad(cost, ((0, 5), (0, 3)), constant_values=cost_of_padding)
    bare = exact_transport(before, after, cost)
    padded = exact_transport(np.pad(before, (0, 5)), np.pad(after, (0, 3)), padded_cost)
    assert padded.cost == pytest.approx(float(bare.cost), rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(padded.plan[:3, :5], bare.plan, atol=1e-12)
    assert np.all(padded.plan[3:] == 0) and np.all(padded.plan[:, 5:] == 0)
    _, gradients = value_and_gradients(jnp.pad(before, (0, 5)), jnp.pad(after, (0, 3)), jnp.asarray(padded_cost))
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@settings(max_examples=20, deadline=None)
@given(seeds, st.sampled_from(["generic", "dead", "unequal"]))
def test_permutation_of_components_permutes_the_plan(seed, kind):
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, kind, seed))
    rng = np.random.default_rng(seed)
    rows, columns = rng.permutation(8), rng.permutation(8)
    plain, permuted = (
        exact_transport(before, after, cost),
        exact_transport(before[rows], after[columns], cost[np.ix_(rows, columns)]),
    )
    assert permuted.cost == pytest.approx(float(plain.cost), rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(permuted.plan, plain.plan[rows][:, columns], atol=1e-12)
    np.testing.assert_allclose(permuted.unmatched[0], plain.unmatched[0][rows], atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(seeds, st.sampled_from(KINDS), st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_symmetry_and_change_of_units(seed, kind, unit_of_mass, unit_of_cost):
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, kind, seed))
    plain = exact_transport(before, after, cost)
    swapped = exact_transport(after, before, cost.T)
    scaled = exact_transport(before * unit_of_mass, after * unit_of_mass, cost * unit_of_cost)
    assert swapped.cost == pytest.approx(float(plain.cost), rel=1e-9, abs=1e-12)
    assert scaled.cost == pytest.approx(float(plain.cost) * unit_of_cost, rel=1e-9, abs=1e-12 * unit_of_cost)
    assert scaled.plan.sum() == pytest.approx(float(plain.plan.sum()) * unit_of_mass, rel=1e-9)


def test_metric_between_equal_totals():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(40, 3, 8, 3))
    masses = rng.dirichlet(np.ones(8), (40, 3))

    def between(i, j):
        cost = np.linalg.norm(points[:, i, :, None] - points[:, j, None], axis=-1)
        return np.asarray(solve_all(masses[:, i], masses[:, j], cost).cost)

    np.testing.assert_allclose(between(0, 0), 0, atol=1e-14)
    assert np.all(between(0, 2) <= between(0, 1) + between(1, 2) + 1e-12)


def test_a_small_mass_beside_a_large_one_keeps_its_digits():
    solved = exact_transport(np.array([1e-9, 2e-9]), np.array([3e5, 1e-9]), np.array([[1.0, 0.5], [3.0, 7.0]]))
    assert solved.cost == pytest.approx((0.5 + 2 * 3) / 3, rel=1e-12)
    np.testing.assert_allclose(solved.unmatched[1], [3e5, 0], atol=1e-24)


@pytest.mark.slow
def test_transformations_agree_with_a_loop():
    problems = random_problems(6, 3, 5, "unequal", seed=5)
    looped = [value_and_gradients(*map(jnp.asarray, problem)) for problem in zip(*problems, strict=True)]
    looped = jax.tree.map(lambda *leaves: np.stack(leaves), *looped)
    nested = jax.tree.map(lambda array: array.reshape(2, 3, *array.shape[1:]), problems)
    by_vmap = all_values_and_gradients(*problems)
    by_nested = jax.vmap(all_values_and_gradients)(*nested)
    outside = jax.grad(lambda *stack: jax.vmap(distance)(*stack).sum(), argnums=(0, 1, 2))(*map(jnp.asarray, problems))
    for other in (by_vmap, jax.tree.map(lambda leaf: leaf.reshape(6, *leaf.shape[2:]), by_nested)):
        jax.tree.map(lambda one, two: np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-14), other, looped)
    jax.tree.map(lambda one, two: np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-14), outside, looped[1])


def test_vmap_over_some_arguments_only():
    before, after, cost = random_problems(70, 3, 5, "generic", seed=6)
    solved = jax.vmap(exact_transport, in_axes=(0, None, None))(before, after[0], cost[0])
    expected = [peer_distance(mass, after[0], cost[0]) for mass in before]
    np.testing.assert_allclose(solved.cost, expected, rtol=1e-9)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kind", ["generic", "dead", "unequal"])
def test_gradients_equal_central_differences(kind, dtype):
    problems = random_problems(20, 3, 5, kind, seed=7)
    _, gradients = all_values_and_gradients(*problems.as_type(dtype))
    rng = np.random.default_rng(8)
    ways = [rng.normal(size=array.shape) for array in problems]
    if kind == "dead":
        ways = [np.where(array > 0, way, 0) for way, array in zip(ways, problems, strict=True)]
    if kind != "unequal":
        live = [array > 0 for array in problems[:2]]
        for side in (0, 1):
            ways[side] -= live[side] * ways[side].sum(1, keepdims=True) / live[side].sum(1, keepdims=True)
    expected = along(lambda moved: solve_all(*moved).cost, problems, Problems(*ways), 1e-5)
    found = sum(
        (np.asarray(gradient) * way).reshape(20, -1).sum(1) for gradient, way in zip(gradients, ways, strict=True)
    )
    assert_derivatives(found, expected, precision=1e-5 if dtype == np.float32 else PRECISION)


@pytest.mark.parametrize("kind", ["generic", "unequal"])
def test_potentials_foretell_what_a_dead_component_would_change(kind):
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, kind, seed=9))
    before[2] = 0
    after *= 1 if kind == "unequal" else before.sum() / after.sum()
    gradient = value_and_gradients(jnp.asarray(before), jnp.asarray(after), jnp.asarray(cost))[1][0]
    step = 1e-8
    way = np.zeros(8)
    way[2], way[0] = step, -step
    change = distance(before + way, after, cost) - distance(before, after, cost)
    assert gradient[2] - gradient[0] == pytest.approx(float(change) / step, rel=1e-5)


def test_forward_mode_equals_reverse_mode():
    before, after, cost = (jnp.asarray(array[0]) for array in random_problems(1, 3, 5, "unequal", seed=10))
    _, forward = jax.jvp(distance, (before, after, cost), (after[:3], before.sum() * after, cost**2))
    _, reverse = value_and_gradients(before, after, cost)
    expected = reverse[0] @ after[:3] + before.sum() * (reverse[1] @ after) + (reverse[2] * cost**2).sum()
    assert float(forward) == pytest.approx(float(expected), rel=1e-12)


@pytest.mark.parametrize("where", ["before", "after", "cost"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0])
def test_bad_numbers_are_a_status(where, value):
    problem = random_problems(2, 3, 5, "generic", seed=11)
    getattr(problem, where)[1].flat[2] = value
    solved = solve_all(*problem)
    optimal = solved.result == TransportStatus.optimal
    assert optimal[0]
    if where == "cost" and value == -1:
        assert optimal[1]
        return
    assert (solved.result == TransportStatus.invalid_input)[1]
    assert np.isposinf(solved.cost[1])
    assert not any(np.any(np.isnan(leaf)) for leaf in jax.tree.leaves((solved.plan, solved.potentials)))


def test_no_mass_is_a_status_and_everything_stays():
    solved = exact_transport(np.zeros(2), np.array([1.0, 2.0, 3.0]), np.ones((2, 3)))
    assert solved.result == TransportStatus.no_mass
    assert np.isposinf(solved.cost) and np.all(solved.plan == 0)
    np.testing.assert_array_equal(solved.unmatched[1], [1, 2, 3])


def test_too_few_pivots_are_a_status():
    before, after, cost = (array[0] for array in random_problems(1, 13, 16, "generic", seed=12))
    cut_short = exact_transport(before, after, cost, max_pivots=2)
    assert cut_short.result == TransportStatus.pivot_limit
    assert np.all(np.isfinite(cut_short.plan)) and np.isnan(cut_short.cost)
