import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.transport import TransportStatus, partial_transport
from tests.differences import along, assert_derivatives
from tests.transport.problems import linear_programme, random_problems

pytestmark = pytest.mark.usefixtures("float64")

KINDS = ["generic", "ties", "same_support", "dead", "unequal"]


solve_all = jax.jit(jax.vmap(partial_transport))


def objective(before, after, cost, penalty):
    return partial_transport(before, after, cost, penalty).cost


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (8, 8)], ids=str)
@pytest.mark.parametrize("kind", KINDS)
def test_equals_the_linear_programme(shape, kind):
    problems = random_problems(8, *shape, kind)
    penalties = np.array([0, 0.1, 0.4, 0.7, 1, 1.5, 2, 10.0])
    solved = solve_all(*problems, penalties)
    assert np.all(solved.result == TransportStatus.optimal)
    expected = [
        linear_programme(*problem, penalty=penalty) for *problem, penalty in zip(*problems, penalties, strict=True)
    ]
    np.testing.assert_allclose(solved.cost, expected, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(solved.plan.sum(2) + solved.unmatched[0], problems.before, atol=1e-12)
    np.testing.assert_allclose(solved.plan.sum(1) + solved.unmatched[1], problems.after, atol=1e-12)


def test_mass_moves_only_for_less_than_twice_the_penalty():
    cost = np.array([[1.9, 5.0], [5.0, 2.1]])
    solved = partial_transport(np.array([3.0, 4.0]), np.array([2.0, 4.0]), cost, 1.0)
    np.testing.assert_allclose(solved.plan, [[2, 0], [0, 0]], atol=1e-14)
    np.testing.assert_allclose(solved.unmatched[0], [1, 4])
    np.testing.assert_allclose(solved.unmatched[1], [0, 4])
    assert solved.cost == pytest.approx(2 * 1.9 + 9)


def test_removing_an_unmatched_component_saves_its_penalty_and_moves_nothing_else():
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, "unequal", seed=1))
    cost[3] += 100
    whole = partial_transport(before, after, cost, 0.7)
    less = partial_transport(np.where(np.arange(8) == 3, 0, before), after, cost, 0.7)
    np.testing.assert_allclose(less.plan, whole.plan, atol=1e-12)
    assert whole.cost - less.cost == pytest.approx(0.7 * before[3])


@pytest.mark.parametrize("side", [0, 1])
def test_a_side_without_mass_leaves_everything_unmatched(side):
    masses = [np.array([1.0, 2.0]), np.array([3.0, 4.0])]
    masses[side] = np.zeros(2)
    solved = partial_transport(*masses, np.ones((2, 2)), 0.5)
    assert solved.result == TransportStatus.optimal
    assert solved.cost == pytest.approx(0.5 * sum(mass.sum() for mass in masses))
    np.testing.assert_allclose(solved.unmatched[1 - side], masses[1 - side])


@pytest.mark.parametrize("kind", ["generic", "unequal"])
def test_gradients_equal_central_differences(kind):
    problems = random_problems(16, 3, 5, kind, seed=2)
    arguments = (*map(jnp.asarray, problems), jnp.full(16, 0.8))
    gradients = jax.jit(jax.vmap(jax.grad(objective, argnums=(0, 1, 2, 3))))(*arguments)
    rng = np.random.default_rng(3)
    ways = tuple(rng.normal(size=array.shape) for array in arguments)
    found = sum(np.reshape(gradient * way, (16, -1)).sum(1) for gradient, way in zip(gradients, ways, strict=True))
    assert_derivatives(found, along(lambda moved: solve_all(*moved).cost, arguments, ways, 1e-5))


def test_padding_changes_nothing():
    before, after, cost = (array[0] for array in random_problems(1, 3, 5, "unequal", seed=4))
    bare = partial_transport(before, after, cost, 0.8)
    padded_cost = np.pad(cost, ((0, 2), (0, 3)), constant_values=1e30)
    padded = partial_transport(np.pad(before, (0, 2)), np.pad(after, (0, 3)), padded_cost, 0.8)
    assert padded.cost == pytest.approx(float(bare.cost), rel=1e-12)
    np.testing.assert_allclose(padded.plan[:3, :5], bare.plan, atol=1e-13)


@pytest.mark.parametrize("penalty", [-1.0, np.nan, np.inf])
def test_bad_penalty_is_a_status(penalty):
    solved = partial_transport(np.ones(2), np.ones(2), np.ones((2, 2)), penalty)
    assert solved.result == TransportStatus.invalid_input
    assert np.isposinf(solved.cost) and not np.any(np.isnan(solved.plan))
